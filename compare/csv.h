#pragma once
// Tables of comma-separated values, as this program writes them: without quotes, the columns' names in the first line.
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace compare {

struct CsvTable {
  std::vector<std::string> columns;
  std::vector<std::map<std::string, std::string>> rows;  ///< by column
};

/// Nothing where the text is empty, or a row has more or fewer cells than there are columns.
std::optional<CsvTable> parseCsv(const std::string& text);

}  // namespace compare
