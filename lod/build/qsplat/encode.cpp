#include "lod/build/qsplat/encode.h"

#include <cstring>

namespace lod::build::qsplat {

using lod::qsplat::Node;

void appendGroup(Run& run, std::span<const Node> group, bool colors) {
  const std::size_t node_bytes = colors ? 6 : 4;
  std::size_t at = run.size();
  run.resize(at + 1 + node_bytes * group.size());
  run[at++] = static_cast<std::uint8_t>(group.size());
  for (const Node& node : group) {
    std::memcpy(run.data() + at, &node.bits, sizeof(node.bits));
    if (colors) std::memcpy(run.data() + at + sizeof(node.bits), &node.color, sizeof(node.color));
    at += node_bytes;
  }
}

std::span<const Node> nextGroup(base::ByteView run, std::size_t& at, bool colors,
                                std::array<Node, lod::qsplat::kMostChildren>& room) {
  const std::size_t node_bytes = colors ? 6 : 4;
  if (at >= run.size()) return {};
  const std::size_t count = run[at];
  if (count > room.size() || run.size() - at < 1 + node_bytes * count) return {};
  ++at;
  for (std::size_t i = 0; i < count; ++i, at += node_bytes) {
    room[i] = {};
    std::memcpy(&room[i].bits, run.data() + at, sizeof(room[i].bits));
    if (colors) std::memcpy(&room[i].color, run.data() + at + sizeof(room[i].bits), sizeof(room[i].color));
  }
  return std::span(room).first(count);
}

std::vector<Run> encodeSubtree(std::span<const TreeNode> nodes, const base::Sphere& root, bool colors) {
  const lod::qsplat::SphereTable& table = lod::qsplat::sphereTable();
  std::vector<Run> runs;
  std::vector<base::Sphere> level{root};  // decoded
  std::vector<base::Sphere> next;
  std::array<Node, lod::qsplat::kMostChildren> group;
  std::size_t first = 0;  // of the level
  while (true) {
    next.clear();
    Run run;
    std::size_t child = first + level.size();
    for (std::size_t i = 0; i < level.size(); ++i) {
      const std::uint32_t count = Node{nodes[first + i].bits, 0}.children();
      if (count == 0) continue;
      for (std::uint32_t c = 0; c < count; ++c, ++child) {
        const std::uint32_t code = lod::qsplat::encodeSphere(level[i], nodes[child].sphere);
        group[c] = {nodes[child].bits | code, nodes[child].color};
        next.push_back(lod::qsplat::decodeSphere(level[i], table[code]));
      }
      appendGroup(run, std::span(group).first(count), colors);
    }
    if (next.empty()) return runs;
    runs.push_back(std::move(run));
    first += level.size();
    std::swap(level, next);
  }
}

}  // namespace lod::build::qsplat
