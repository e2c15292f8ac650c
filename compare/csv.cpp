#include "compare/csv.h"

#include <sstream>

namespace compare {
namespace {

std::vector<std::string> cellsOf(const std::string& line) {
  std::vector<std::string> cells;
  std::istringstream in(line + ",");
  for (std::string cell; std::getline(in, cell, ',');) cells.push_back(cell);
  return cells;
}

}  // namespace

std::optional<CsvTable> parseCsv(const std::string& text) {
  std::istringstream in(text);
  std::string line;
  if (!std::getline(in, line)) return std::nullopt;
  CsvTable table{cellsOf(line), {}};
  while (std::getline(in, line)) {
    const std::vector<std::string> cells = cellsOf(line);
    if (cells.size() != table.columns.size()) return std::nullopt;
    auto& row = table.rows.emplace_back();
    for (std::size_t i = 0; i < cells.size(); ++i) row[table.columns[i]] = cells[i];
  }
  return table;
}

}  // namespace compare
