#pragma once
// Plays methods over paths and links for scenes, and writes the report.
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "compare/sim/play.h"
#include "server/views/camera_paths.h"

namespace compare {

/// Every path over every link.
struct MatrixPart {
  std::vector<std::string> paths;  ///< of server::pathNames()
  std::vector<LinkProfile> links;
  bool sweep = false;  ///< all values of each method's knob, not the default alone
};

/// "quick": two paths over two links. "full": every path and every link, each method at all values of its knob, but
/// not the whole product, which would take days (docs/formats/comparison.md, "Methods, paths and links"). Anything
/// else: an orbit over 20 Mbit/s and 40 ms.
std::vector<MatrixPart> matrixParts(const std::string& preset);

struct MatrixOptions {
  std::vector<std::string> scenes;      ///< directories
  std::vector<std::string> methods;     ///< of methodNames(); empty: all
  std::vector<MatrixPart> parts;        ///< one or more; what several have is played once
  std::vector<std::string> path_files;  ///< used in place of the parts' paths when there are any
  std::string report;                   ///< directory
  int truth_supersampling = 4;
  double stop_seconds = 2.0;  ///< for path_files
  unsigned jobs = 1;          ///< processes at a time, each with a scene; 1: this one. No figure depends on it.
  bool pictures = true;
  std::optional<std::uint64_t> idle_bytes;  ///< Stage::idle_bytes
  std::string command;                      ///< for the page: how it was called
  server::PathOptions path;
  PlayOptions play;  ///< `pictures` is set for each run
  Costs costs;
};

/// `log` gets a line for each run, from the process that plays it. Errors name the scene.
base::Result<std::vector<PlayedRun>> playMatrix(const MatrixOptions& options,
                                                const std::function<void(const std::string&)>& log);

}  // namespace compare
