#pragma once
// Charts as SVG text, one per file: lines with markers, axes with round ticks, a legend.
#include <string>
#include <utility>
#include <vector>

namespace compare {

struct Series {
  std::string name;
  std::vector<std::pair<double, double>> points;  ///< x, y; drawn in order
  bool is_line = true;                            ///< else markers alone
};

struct Chart {
  std::string title, x_label, y_label;
  bool log_x = false;  ///< points with x ≤ 0 are left out then
  std::vector<Series> series;
};

std::string formatChart(const Chart& chart);

/// Writes &, < and > as entities of HTML and SVG.
std::string escapeMarkup(const std::string& text);

}  // namespace compare
