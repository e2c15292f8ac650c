#include "lod/ingest/record_log.h"

#include <cstring>

#include "base/crc32c.h"

namespace lod::ingest {
namespace {

// The magic number reads "LGWK"; crc is the payload's checksum.
struct RecordHeader {
  std::uint32_t magic = 0x4B57474CU;
  std::uint32_t crc = 0;
  std::uint64_t bytes = 0;
};
// At most this many bytes are lost in a power failure. A process that is killed loses none that it wrote.
// The number is a choice: less is lost when the log is synced more often, which makes slow disks wait more often.
constexpr std::uint64_t kSyncBytes = std::uint64_t{64} << 20;

}  // namespace

base::Result<RecordLog> RecordLog::open(const std::string& path, bool resume, const RecordHandler& handler) {
  LUMIGRID_ASSIGN_OR_RETURN(auto file, resume ? SpoolFile::open(path) : SpoolFile::create(path));
  std::uint64_t offset = 0;
  base::Bytes payload;
  while (offset + sizeof(RecordHeader) <= file.size()) {
    RecordHeader header;
    const RecordHeader expected;
    std::uint8_t bytes[sizeof(header)];
    LUMIGRID_TRY(file.readAt(offset, bytes));
    std::memcpy(&header, bytes, sizeof(header));
    if (header.magic != expected.magic || header.bytes > file.size() - offset - sizeof(header)) break;
    payload.resize(static_cast<std::size_t>(header.bytes));
    LUMIGRID_TRY(file.readAt(offset + sizeof(header), payload));
    if (base::crc32c(payload) != header.crc || !handler(offset + sizeof(header), payload)) break;
    offset += sizeof(header) + header.bytes;
  }
  LUMIGRID_TRY(file.truncate(offset));
  RecordLog log;
  log.synced_ = offset;
  log.file_ = std::move(file);
  return log;
}

base::Result<std::uint64_t> RecordLog::add(base::ByteView payload) {
  RecordHeader header;
  header.crc = base::crc32c(payload);
  header.bytes = payload.size();
  std::uint8_t bytes[sizeof(header)];
  std::memcpy(bytes, &header, sizeof(header));

  const std::lock_guard lock(*mutex_);
  const std::uint64_t offset = file_.size() + sizeof(header);
  LUMIGRID_TRY(file_.append(bytes));
  LUMIGRID_TRY(file_.append(payload));
  LUMIGRID_TRY(file_.flush());
  if (file_.size() - synced_ > kSyncBytes) {
    synced_ = file_.size();
    LUMIGRID_TRY(file_.sync());
  }
  return offset;
}

}  // namespace lod::ingest
