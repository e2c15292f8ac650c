#pragma once
// Where the units of the source's JPEGs begin: a work file, so that pictures that were read for the colours of vertices
// need not be gone through again when they are cut up. What is not in it is found again.
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <tuple>

#include "base/bytes.h"
#include "lod/ingest/record_log.h"
#include "mesh/stream_mesh.h"

namespace lod::ingest {

class PictureUnits {
 public:
  static constexpr const char* kName = "units";  ///< of the file in the work directory

  /// Creates the file in `directory`. Errors: kNoSpace, kIo.
  static base::Result<PictureUnits> create(const std::string& directory);
  /// Opens what an earlier run, or an earlier stage, has left; there may be nothing. Errors: kIo.
  static base::Result<PictureUnits> open(const std::string& directory);
  PictureUnits() = default;

  /// Keeps what mesh::KeepUnits gets. Where the disk refuses it, that and all that follows is left out. Safe from
  /// several threads.
  void add(const mesh::SourcePicture& picture, base::ByteView units);
  /// Empty where nothing is known of the picture. Safe from several threads.
  base::Bytes of(const mesh::SourcePicture& picture) const;

 private:
  struct Place {
    std::uint64_t offset = 0, bytes = 0;
  };
  using Key = std::tuple<std::string, std::uint64_t, std::uint64_t>;  // the picture's path, offset and bytes

  std::unique_ptr<RecordLog> log_;                                      // null: nothing is kept
  std::map<Key, Place> places_;                                         // without meaning where they are written
  std::unique_ptr<std::mutex> mutex_ = std::make_unique<std::mutex>();  // of both, while they are written
};

}  // namespace lod::ingest
