#pragma once
// Plays scenes in several processes at a time. Mesa's llvmpipe keeps one core busy with what it does before it paints
// pixels, and threads of one process must not draw side by side (docs/decisions/one-drawing-context.md).
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "compare/sim/play.h"

namespace compare {

/// The runs of a scene, and what drew them (GL_RENDERER).
struct PlayedScene {
  std::string renderer;
  std::vector<PlayedRun> runs;
};
using PlayScene = std::function<base::Result<PlayedScene>(std::size_t scene)>;
using SceneDone = std::function<base::Result<void>(std::size_t scene, PlayedScene played)>;

/// Calls `play` for each scene of 0 … `scenes` − 1 in a process of its own, at most `jobs` of them at a time, in order,
/// and `done` here with what each has played, in the order in which they end. No GL context may exist and no other
/// thread run when it is called. The first error ends all processes. Also kIo: a process died; `folder`, which exists,
/// cannot be written.
base::Result<void> playInProcesses(std::size_t scenes, unsigned jobs, const std::string& folder, const PlayScene& play,
                                   const SceneDone& done);

/// A played scene as bytes, for another process of the same program.
base::Bytes encodeScene(const PlayedScene& scene);
/// Nothing when the bytes are not those of encodeScene().
std::optional<PlayedScene> decodeScene(base::ByteView bytes);

}  // namespace compare
