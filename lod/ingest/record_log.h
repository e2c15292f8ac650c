#pragma once
// The journal of a build's stage: a file of records that is only appended to. Each record has a checksum, so a builder
// that was killed goes on behind the last complete record.
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string>

#include "lod/ingest/spool.h"

namespace lod::ingest {

class RecordLog {
 public:
  /// Gets a payload and where it lies in the file. Returns false where no writer wrote such a payload: the log then
  /// ends before it.
  using RecordHandler = std::function<bool(std::uint64_t offset, base::ByteView payload)>;

  /// Creates `path`, or with `resume` continues it behind its last complete record and passes every record to
  /// `handler`, in the order in which they were written. Errors: kNoSpace, kIo.
  static base::Result<RecordLog> open(const std::string& path, bool resume, const RecordHandler& handler);

  /// Appends a record and flushes it. Returns where its payload lies. Safe from several threads.
  base::Result<std::uint64_t> add(base::ByteView payload);
  /// Reads the file's bytes from `offset` on. Safe from several threads.
  base::Result<void> readAt(std::uint64_t offset, std::span<std::uint8_t> out) const {
    return file_.readAt(offset, out);
  }
  void forget(std::uint64_t offset, std::uint64_t length) const { file_.forget(offset, length); }  ///< as SpoolFile's
  std::uint64_t size() const { return file_.size(); }

 private:
  SpoolFile file_;
  std::uint64_t synced_ = 0;
  std::unique_ptr<std::mutex> mutex_ = std::make_unique<std::mutex>();
};

}  // namespace lod::ingest
