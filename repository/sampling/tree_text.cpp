#include "repository/sampling/tree_text.h"

#include <string_view>
#include <utility>

namespace repository {
namespace {

constexpr const char* kTree = ",\n\"tree\": \"";
constexpr const char* kEnd = "\n}\n";

}  // namespace

std::string withTree(const std::string& parameters, const SampleTree& tree) {
  return parameters.substr(0, parameters.rfind(kEnd)) + kTree + base::hexOf(tree.encode()) + "\"" + kEnd;
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

}  // namespace repository
