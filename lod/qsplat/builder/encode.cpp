#include "lod/qsplat/builder/encode.h"

namespace lod::qsplat::builder {

namespace {
constexpr std::uint8_t kPointerBit = 0x80;
}

void appendGroup(Run& run, const GroupNodes& group, bool colors) {
  const GroupLayout layout(colors, false);
  const std::size_t at = run.size();
  run.resize(at + 1 + layout.bytes(group.count, false));
  run[at] = static_cast<std::uint8_t>(group.count | (group.has_pointer ? kPointerBit : 0U));
  writeNodes(group, layout, &run[at + 1]);
}

GroupNodes readGroup(base::ByteView run, std::size_t& at, bool colors) {
  const GroupLayout layout(colors, false);
  if (at >= run.size()) return {};
  GroupNodes group;
  group.count = run[at] & (kPointerBit - 1U);
  group.has_pointer = (run[at] & kPointerBit) != 0;
  if (group.count > group.nodes.size() || run.size() - at < 1 + layout.bytes(group.count, false)) return {};
  for (std::uint32_t i = 0; i < group.count; ++i) group.nodes[i] = readNode(&run[at + 1], i, layout);
  at += 1 + layout.bytes(group.count, false);
  return group;
}

std::vector<Run> encodeSubtree(std::span<const TreeNode> nodes, const base::Sphere& root, bool colors,
                               LeafCones leaf_cones) {
  const SphereTable& table = sphereTable();
  std::vector<Run> runs;
  std::vector<base::Sphere> level{root};  // the decoded spheres of a level
  std::vector<base::Sphere> next;
  GroupNodes group;
  std::size_t first = 0;  // number of the level's first node
  while (true) {
    next.clear();
    Run run;
    std::size_t child = first + level.size();
    for (std::size_t i = 0; i < level.size(); ++i) {
      const Node parent{nodes[first + i].bits, 0};
      group.count = parent.children();
      group.has_pointer = !parent.childrenAreLeaves();
      if (group.count == 0) continue;
      for (std::uint32_t c = 0; c < group.count; ++c, ++child) {
        const std::uint32_t code = encodeSphere(level[i], nodes[child].sphere);
        group.nodes[c] = nodes[child].encoded(code, group.has_pointer, leaf_cones);
        next.push_back(decodeSphere(level[i], table[code]));
      }
      appendGroup(run, group, colors);
    }
    if (next.empty()) return runs;
    runs.push_back(std::move(run));
    first += level.size();
    std::swap(level, next);
  }
}

}  // namespace lod::qsplat::builder
