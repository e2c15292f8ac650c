#pragma once
// Opens and checks the one file of a method from which a scene is drawn.
#include <cstdint>
#include <memory>
#include <string>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "lod/disk_bytes.h"
#include "lod/patch/format.h"

namespace server {

/// Limits for what is kept for the next picture, decoded and on the GPU. What one picture needs is drawn whatever its
/// size, up to the first of them.
inline constexpr std::uint64_t kStreamedDecodedBytes = std::uint64_t{4} << 30;
inline constexpr std::uint64_t kStreamedGpuBytes = 512 << 20;

/// Opens the patches of the scene in `directory`. kNotFound if it was built without: the message says how to, and with
/// which --method the scene can be drawn as it is.
base::Result<lod::patch::PatchFile> openPatchFile(const std::string& directory, const base::Scene& scene);

struct OpenStreamedFile {
  std::string path;
  std::shared_ptr<const lod::FileBytes> bytes;  ///< not null
};
/// Opens the file of the method in a scene's `directory`. Errors name it: kNotFound if the scene was built without (the
/// message says how to), kIo.
base::Result<OpenStreamedFile> openStreamedFile(const std::string& directory, const base::Scene& scene,
                                                const base::StreamedMethod& method);

/// Options for streams of files that are here whole: all that a picture needs is decoded for it.
template <class Options>
Options wholeFile() {
  Options options;
  options.memory_bytes = kStreamedDecodedBytes;
  options.decode_per_frame = 0;
  return options;
}

/// Nothing while all is well; else what is wrong with the file. The stream says so without the file's name.
template <class Stream>
base::Result<void> checkStream(const Stream& stream, const std::string& path) {
  const std::string& problem = stream.problem();
  const std::string fault = problem.empty() ? stream.warning() : problem;
  if (fault.empty()) return {};
  return base::Error{base::ErrorCode::kInvalidInput, path + ": " + fault};
}

/// The error for a tolerance that is not above 0.
base::Result<void> checkTolerance(float tolerance);

}  // namespace server
