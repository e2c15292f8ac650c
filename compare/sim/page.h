#pragma once
// The report of a matrix as one HTML file that needs no other: charts, tables that can be sorted, and for each method
// its worst and its median picture with their errors.
#include <string>
#include <vector>

#include "compare/sim/play.h"

namespace compare {

struct PageContext {
  std::string machine, commit, renderer, command;
  PlayOptions play;
  Costs costs;
};

std::string formatPage(const PageContext& context, const std::vector<PlayedRun>& runs);

}  // namespace compare
