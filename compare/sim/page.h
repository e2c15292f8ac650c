#pragma once
// The report of a matrix as one HTML file that needs no other: charts, a table that can be sorted, and for each run its
// worst and its median picture with what is wrong in them.
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
