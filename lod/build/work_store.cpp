#include "lod/build/work_store.h"

#include <cstring>

#include "base/crc32c.h"

namespace lod::build {
namespace {

// "LGWK", then the payload's length and checksum.
struct RecordHeader {
  std::uint32_t magic = 0x4B57474CU;
  std::uint32_t crc = 0;
  std::uint64_t bytes = 0;
};
// So many bytes may be lost to a power cut. A killed process loses none that were written.
constexpr std::uint64_t kSyncBytes = std::uint64_t{64} << 20;

base::Bytes payloadOf(const WorkUnit& unit, const std::vector<NewPatch>& patches) {
  base::ByteWriter out;
  out.u32(unit.level);
  out.u32(unit.index);
  out.write(unit.group);
  out.u32(static_cast<std::uint32_t>(patches.size()));
  for (const NewPatch& patch : patches) {
    out.write(patch.record);
    out.u32(static_cast<std::uint32_t>(patch.border.size()));
    out.u32(static_cast<std::uint32_t>(patch.encoded.size()));
    out.u32(static_cast<std::uint32_t>(patch.errors.size()));
    out.bytes(base::ByteView(reinterpret_cast<const std::uint8_t*>(patch.border.data()), 8 * patch.border.size()));
    out.bytes(patch.encoded);
    out.bytes(patch.errors);
  }
  return out.take();
}

// `offset` is where the payload lies in the file. False when it is no payload.
bool readPayload(base::ByteView payload, std::uint64_t offset, WorkUnit& unit, std::vector<WorkPatch>& patches) {
  base::ByteReader in(payload);
  unit.level = in.u32();
  unit.index = in.u32();
  unit.group = in.read<lod::patch::Group>();
  const std::uint32_t count = in.u32();
  if (!in.ok() || count > in.remaining() / sizeof(lod::patch::Patch)) return false;
  patches.resize(count);
  for (WorkPatch& patch : patches) {
    patch.record = in.read<lod::patch::Patch>();
    const std::uint32_t border = in.u32();
    patch.encoded_bytes = in.u32();
    patch.error_bytes = in.u32();
    const base::ByteView codes = in.bytes(8 * std::size_t{border});
    if (!in.ok()) return false;
    patch.border.resize(border);
    if (border > 0) std::memcpy(patch.border.data(), codes.data(), codes.size());
    patch.offset = offset + in.offset();
    (void)in.bytes(std::size_t{patch.encoded_bytes} + patch.error_bytes);
  }
  return in.atEnd();
}

}  // namespace

base::Result<WorkStore> WorkStore::open(const std::string& path, bool resume,
                                        const std::function<void(const WorkUnit&, std::vector<WorkPatch>)>& found) {
  auto file = resume ? SpoolFile::open(path) : SpoolFile::create(path);
  if (!file) return file.error();
  WorkStore store;
  std::uint64_t offset = 0;
  base::Bytes payload;
  while (offset + sizeof(RecordHeader) <= file->size()) {
    RecordHeader header;
    const RecordHeader expected;
    std::uint8_t bytes[sizeof(header)];
    LUMIGRID_TRY(file->readAt(offset, bytes));
    std::memcpy(&header, bytes, sizeof(header));
    if (header.magic != expected.magic || header.bytes > file->size() - offset - sizeof(header)) break;
    payload.resize(static_cast<std::size_t>(header.bytes));
    LUMIGRID_TRY(file->readAt(offset + sizeof(header), payload));
    WorkUnit unit;
    std::vector<WorkPatch> patches;
    if (base::crc32c(payload) != header.crc || !readPayload(payload, offset + sizeof(header), unit, patches)) break;
    found(unit, std::move(patches));
    offset += sizeof(header) + header.bytes;
  }
  LUMIGRID_TRY(file->truncate(offset));
  store.synced_ = offset;
  store.file_ = std::move(*file);
  return store;
}

base::Result<std::vector<WorkPatch>> WorkStore::add(const WorkUnit& unit, std::vector<NewPatch> patches) {
  const base::Bytes payload = payloadOf(unit, patches);
  RecordHeader header;
  header.crc = base::crc32c(payload);
  header.bytes = payload.size();
  base::Bytes bytes(sizeof(header));
  std::memcpy(bytes.data(), &header, sizeof(header));

  std::uint64_t offset = 0;
  {
    const std::lock_guard lock(*mutex_);
    offset = file_.size();
    LUMIGRID_TRY(file_.append(bytes));
    LUMIGRID_TRY(file_.append(payload));
    LUMIGRID_TRY(file_.flush());
    if (file_.size() - synced_ > kSyncBytes) {
      synced_ = file_.size();
      LUMIGRID_TRY(file_.sync());
    }
  }
  WorkUnit again;
  std::vector<WorkPatch> stored;
  (void)readPayload(payload, offset + sizeof(header), again, stored);
  return stored;
}

base::Result<base::Bytes> WorkStore::encoded(const WorkPatch& patch) const {
  base::Bytes bytes(patch.encoded_bytes);
  LUMIGRID_TRY(file_.readAt(patch.offset, bytes));
  return bytes;
}

base::Result<void> WorkStore::readWhole(const WorkPatch& patch, base::Bytes& bytes) const {
  bytes.resize(std::size_t{patch.encoded_bytes} + patch.error_bytes);
  return file_.readAt(patch.offset, bytes);
}

}  // namespace lod::build
