#include "repository/sampling/tree_text.h"

#include <array>
#include <cinttypes>
#include <cstdio>
#include <string_view>
#include <utility>

namespace repository {
namespace {

constexpr const char* kTree = ",\n\"tree\": \"";
constexpr const char* kGrowth = "\",\n\"growth\": [";
constexpr const char* kEnd = "\n}\n";

std::string rowOf(const TreeGrowth& g) {
  std::array<char, 256> text{};
  std::snprintf(text.data(), text.size(),
                R"({"cell": %)" PRIu32 R"(, "cells": %)" PRIu64 R"(, "points": %)" PRIu64 R"(, "bytes": %)" PRIu64
                R"(, "psnr_db": %.2f, "worst_psnr_db": %.2f, "split": %)" PRIu64 "}",
                g.cell, g.cells, g.points, g.bytes, g.psnr_db, g.worst_psnr_db, g.split);
  return text.data();
}

}  // namespace

std::string withTree(const std::string& parameters, const SampleTree& tree, const std::vector<TreeGrowth>& growth) {
  std::string rows;
  for (const TreeGrowth& g : growth) rows += (rows.empty() ? "" : ", ") + rowOf(g);
  const std::string front = parameters.substr(0, parameters.rfind(kEnd));
  return front + kTree + base::hexOf(tree.encode()) + kGrowth + rows + "]" + kEnd;
}

std::string withoutTree(const std::string& text) {
  const std::size_t at = text.find(kTree);
  return at == std::string::npos ? text : text.substr(0, at) + kEnd;
}

base::Result<std::optional<SampleTree>> treeFromText(const std::string& text, const Grid& grid,
                                                     const std::string& name) {
  std::size_t begin = text.find(kTree);
  if (begin == std::string::npos) return std::optional<SampleTree>();
  begin += std::string(kTree).size();
  const std::size_t end = text.find('"', begin);
  const auto bytes = base::bytesOfHex(std::string_view(text).substr(begin, end == std::string::npos ? 0 : end - begin));
  auto tree = SampleTree::decode(grid, bytes ? *bytes : base::Bytes());
  if (!tree) {
    base::Error error = base::within(name, tree.error());
    error.message += "; build the images again with `lumigrid build --force`";
    return error;
  }
  return std::optional(std::move(*tree));
}

std::vector<TreeGrowth> growthFromText(const std::string& text) {
  std::vector<TreeGrowth> growth;
  std::size_t at = text.find(kGrowth);
  if (at == std::string::npos) return growth;
  for (at = text.find('{', at); at != std::string::npos; at = text.find('{', at + 1)) {
    TreeGrowth g;
    if (std::sscanf(text.c_str() + at,
                    R"({"cell": %)" SCNu32 R"(, "cells": %)" SCNu64 R"(, "points": %)" SCNu64 R"(, "bytes": %)" SCNu64
                    R"(, "psnr_db": %lf, "worst_psnr_db": %lf, "split": %)" SCNu64,
                    &g.cell, &g.cells, &g.points, &g.bytes, &g.psnr_db, &g.worst_psnr_db, &g.split) != 7)
      break;
    growth.push_back(g);
  }
  return growth;
}

}  // namespace repository
