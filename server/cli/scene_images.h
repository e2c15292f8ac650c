#pragma once
// The images of a scene directory as the commands see them: how they are divided, which are missing, and which stores
// do not belong there.
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "repository/repository.h"

namespace server::cli {

/// scene.json's parameter that says into how many shards the images are divided; absent when they are not.
inline constexpr const char* kShardsParameter = "shards";

/// Its value, 0 when absent; an error for what is no number of shards.
base::Result<std::uint32_t> shardsOf(const base::Scene& scene);
/// Stores below images/ that are of no or another division than `shards`, by their directories.
base::Result<std::vector<std::string>> orphanStores(const std::string& images, std::uint32_t shards);

/// The parts that a scene lacks.
struct MissingParts {
  bool hierarchy = false;
  bool splats = false;
  bool umbrellas = false;
  bool hlod = false;
  std::uint32_t shards = 0;                   ///< the division; 0: none
  bool methods = false;                       ///< --methods auto has not measured yet whether there are to be images
  bool points = false;                        ///< --views has not selected points yet: all of the grid count
  std::vector<repository::ShardGaps> images;  ///< shards that lack faces
  /// The light of the images that are there, where it is no longer the scene's: all faces are to be drawn again.
  std::optional<base::Light> images_light;
  /// All is there, but nobody has checked that and written scene.json: any command that builds the scene does.
  bool declaration = false;
  bool files() const { return hierarchy || splats || umbrellas || hlod; }
  bool any() const { return files() || methods || declaration || !images.empty(); }
};
/// Prints the missing parts, for people or as JSON; returns the exit status.
int reportMissing(const std::string& scene, const MissingParts& missing, bool json);
/// Indices of the shards as a Slurm array takes them: "0,2-5".
std::string arrayOf(const std::vector<repository::ShardGaps>& shards);

}  // namespace server::cli
