#pragma once
// The files of a matrix's report (docs/formats/comparison.md): results.csv with a row for each judged frame,
// summary.csv with a row for each scene, method, knob, path and link, results.json, and index.html.
#include <string>
#include <vector>

#include "compare/sim/matrix.h"

namespace compare {

std::string resultsCsv(const std::vector<PlayedRun>& runs);
std::string summaryCsv(const std::vector<PlayedRun>& runs);

/// Writes all four into options.report, and the charts beside them. `renderer`: GL_RENDERER.
base::Result<void> writeResults(const MatrixOptions& options, const std::string& renderer,
                                const std::vector<PlayedRun>& runs);

}  // namespace compare
