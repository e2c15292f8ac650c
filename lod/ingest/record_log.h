#pragma once
// A file of records that is only ever appended to: the journal of a stage of a build. Each record has its checksum and
// is there whole or not at all, so a builder that was killed goes on behind the last whole one.
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string>

#include "lod/ingest/spool.h"

namespace lod::ingest {

class RecordLog {
 public:
  /// One payload found, and where it lies in the file. False: it is none that its writer wrote, the log ends before it.
  using Found = std::function<bool(std::uint64_t offset, base::ByteView payload)>;

  /// `path` is created, or continued behind its last whole record when `resume`. Every record found is told to `found`
  /// in the order in which they were written. Errors: kNoSpace, kIo.
  static base::Result<RecordLog> open(const std::string& path, bool resume, const Found& found);

  /// Appends a record, and flushes it; safe from several threads. Returns where its payload lies.
  base::Result<std::uint64_t> add(base::ByteView payload);
  /// Fills `out` from `offset` of the file on; safe from several threads.
  base::Result<void> readAt(std::uint64_t offset, std::span<std::uint8_t> out) const {
    return file_.readAt(offset, out);
  }
  std::uint64_t size() const { return file_.size(); }

 private:
  SpoolFile file_;
  std::uint64_t synced_ = 0;
  std::unique_ptr<std::mutex> mutex_ = std::make_unique<std::mutex>();
};

}  // namespace lod::ingest
