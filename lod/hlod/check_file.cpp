#include "lod/hlod/check_file.h"

#include <algorithm>
#include <optional>

#include "lod/hlod/block.h"

namespace lod::hlod {
namespace {

constexpr std::size_t kMaxFaults = 10;

class Checker {
 public:
  explicit Checker(const FileBytes& file) : file_(file) {}

  std::vector<std::string> run() {
    if (readFront())
      for (std::uint32_t node = 0; node < nodes_.size() && faults_.size() < kMaxFaults; ++node) checkNode(node);
    return std::move(faults_);
  }

 private:
  void fault(const std::string& text) {
    if (faults_.size() < kMaxFaults) faults_.push_back(text);
  }
  void nodeFault(std::uint32_t node, const std::string& text) { fault("node " + std::to_string(node) + ": " + text); }

  // readTable() refuses a table whose boxes and errors do not contain those of children, and wrong sums.
  bool readFront() {
    base::Bytes front(static_cast<std::size_t>(std::min<std::uint64_t>(file_.size(), kHeaderBytes)));
    if (!file_.read(0, front)) return fault("cannot be read; copy the file again"), false;
    const auto header = readHeader(front);
    if (!header) return fault(header.error().message), false;
    header_ = *header;
    if (header_.file_bytes != file_.size()) {
      fault("has " + std::to_string(file_.size()) + " bytes, its header says " + std::to_string(header_.file_bytes));
      return false;
    }
    base::Bytes table(header_.table_bytes);
    if (!file_.read(kHeaderBytes, table)) return fault("table: cannot be read; copy the file again"), false;
    auto nodes = readTable(header_, table);
    if (!nodes) return fault(nodes.error().message), false;
    nodes_ = std::move(*nodes);
    return true;
  }

  void checkNode(std::uint32_t node) {
    checkBlock(node, nodes_[node].picture, false);
    if (!nodes_[node].isLeaf()) checkBlock(node, nodes_[node].caster, true);
  }

  void checkBlock(std::uint32_t node, const BlockPlace& place, bool is_caster) {
    const std::string name = is_caster ? "caster" : "picture";
    const auto geometry = readBlock(node, place, is_caster);
    if (!geometry) return nodeFault(node, "its " + name + " is damaged; copy the file again");
    checkPlaces(node, name, *geometry);
    if (hasFlatTriangle(*geometry)) nodeFault(node, name + ": a triangle has two corners at one place");
  }

  std::optional<NodeGeometry> readBlock(std::uint32_t node, const BlockPlace& place, bool is_caster) const {
    base::Bytes bytes(place.bytes);
    if (!file_.read(place.offset, bytes)) return std::nullopt;
    auto geometry = decodeBlock(bytes, nodes_[node], {header_.colors, is_caster});
    return geometry ? std::optional(std::move(*geometry)) : std::nullopt;
  }

  void checkPlaces(std::uint32_t node, const std::string& name, const NodeGeometry& geometry) {
    bool in_box = true;
    for (const auto* list : {&geometry.vertices, &geometry.points}) {
      for (const NodeVertex& vertex : *list) {
        const glm::ivec3 place = vertex.place * (1 << nodes_[node].step_bits);
        in_box &= nodes_[node].box.contains(header_.lattice.position(place));
      }
    }
    if (!in_box) nodeFault(node, name + ": a place lies outside the node's box");
  }

  static bool hasFlatTriangle(const NodeGeometry& geometry) {
    for (std::size_t i = 0; i < geometry.triangles.size(); i += 3) {
      const auto at = [&](std::size_t k) { return geometry.vertices[geometry.triangles[i + k]].place; };
      if (at(0) == at(1) || at(1) == at(2) || at(2) == at(0)) return true;
    }
    return false;
  }

  const FileBytes& file_;
  Header header_;
  std::vector<Node> nodes_;
  std::vector<std::string> faults_;
};

}  // namespace

std::vector<std::string> checkFile(const FileBytes& file) {
  return Checker(file).run();
}

}  // namespace lod::hlod
