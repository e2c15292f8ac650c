#include "server/render/streamed_scene.h"

#include <utility>

#include "base/file.h"

namespace server {

base::Result<lod::patch::PatchFile> openPatchFile(const std::string& directory, const base::Scene& scene) {
  auto file = lod::patch::PatchFile::open(base::patchPath(directory, scene));
  if (file || file.error().code != base::ErrorCode::kNotFound || base::partFile(scene, "patch", ".lgp")) return file;
  const base::StreamedMethod* instead = base::methodWithoutPatches(scene);
  const std::string other = instead != nullptr ? "draw it with --method " + std::string(instead->name) + ", or " : "";
  return base::Error{base::ErrorCode::kNotFound,
                     directory + " has no patches; " + other + "build them with `lumigrid build ... --methods patch`"};
}

base::Result<OpenStreamedFile> openStreamedFile(const std::string& directory, const base::Scene& scene,
                                                const base::StreamedMethod& method) {
  const std::string path = base::streamedPath(directory, scene, method);
  auto file = base::PositionedFile::open(path);
  if (!file && file.error().code == base::ErrorCode::kNotFound)
    return base::Error{
        base::ErrorCode::kNotFound,
        directory + " has no " + method.file() + "; build it with `lumigrid build ... --methods " + method.name + "`"};
  if (!file) return file.error();
  return OpenStreamedFile{path, std::make_shared<lod::DiskBytes>(std::move(*file))};
}

base::Result<void> checkTolerance(float tolerance) {
  if (tolerance > 0.0F) return {};
  return base::Error{base::ErrorCode::kInvalidInput,
                     "render: a tolerance of " + std::to_string(tolerance) + " pixels; it must be above 0"};
}

}  // namespace server
