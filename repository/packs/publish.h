#pragma once
// Writes a repository as packs and an index (docs/formats/packs.md).
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "repository/objects/objects.h"
#include "repository/store.h"

namespace repository {

inline constexpr std::uint64_t kMinPackTarget = std::uint64_t{1} << 20;
inline constexpr std::uint64_t kMaxPackTarget = std::uint64_t{64} << 20;

struct PublishOptions {
  /// Packs are filled up to this size; kMinPackTarget … kMaxPackTarget. docs/formats/packs.md says why 16 MB.
  std::uint64_t pack_bytes = std::uint64_t{16} << 20;
  unsigned jobs = 4;     ///< packs hashed and written in parallel, 1 or more; each takes 2 · pack_bytes of memory
  bool rewrite = false;  ///< also write objects that are there already, which repairs a damaged place
};

struct PublishProgress {
  std::uint64_t keys_done = 0, keys_total = 0;
  std::uint64_t bytes = 0;  ///< bytes of the packs made so far
};

struct PublishedImages {
  std::string index;         ///< the index object's name
  std::string index_sha256;  ///< digest of the whole object, lower-case hex
  std::uint64_t index_bytes = 0;
  std::uint64_t index_front_bytes = 0;  ///< IndexRoot::frontBytes()
  std::vector<std::string> pack_names;  ///< in order of keys
  std::uint64_t keys = 0, empty = 0;
  std::uint64_t pack_bytes = 0;     ///< all packs
  std::uint64_t packs_written = 0;  ///< the others were there
  std::uint64_t bytes_written = 0;  ///< packs and index
};

/// Streams the store's values into packs and writes those that `sink` lacks, then the index. Existing objects never
/// change, so publishing may be stopped at any moment and run again. The objects depend only on the values, the
/// parameters and pack_bytes. `go_on` is called after each pack; when it returns false, publishing ends with
/// kCancelled. Errors: the store's and the sink's; kInvalidInput for a damaged value; kUnsupported for one beyond 64
/// MiB.
base::Result<PublishedImages> publishImages(const Store& store, ObjectSink& sink, const PublishOptions& options,
                                            const std::function<bool(const PublishProgress&)>& go_on = {});

}  // namespace repository
