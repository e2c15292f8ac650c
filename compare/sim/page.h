#pragma once
// The report of a matrix as one HTML file that needs no other: charts, tables that can be sorted, and for each method
// its worst and its median picture with their errors.
#include <string>
#include <vector>

#include "compare/sim/play.h"

namespace compare {

struct PartCosts {
  std::string name;  ///< "patch.lgp", "qsplat.lgq", "images"
  std::uint64_t bytes = 0;
  double build_seconds = -1.0;  ///< below 0: not known
};
struct SceneCosts {
  std::string scene;  ///< as in the runs
  std::vector<PartCosts> parts;
  double peak_memory_bytes = 0.0;  ///< of the builds; 0: not known
};

struct PageContext {
  std::string machine, commit, renderer, command;
  PlayOptions play;
  Costs costs;
  std::vector<SceneCosts> scenes;  ///< as far as they are known
};

std::string formatPage(const PageContext& context, const std::vector<PlayedRun>& runs);

/// A chart of the page as a file of its own: "statue_orbit_20Mbit-40ms_bytes.svg". The last word is bytes (accuracy
/// against bytes), or accuracy, arrived (bytes) or draw_wall (time to draw), along the path.
struct ChartFile {
  std::string name, svg;
};
std::vector<ChartFile> chartFiles(const std::vector<PlayedRun>& runs);

}  // namespace compare
