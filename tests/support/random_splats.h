#pragma once
// Makes small random trees of splats from a seed, and walks over the decoded nodes of a file.
#include <random>
#include <string>
#include <vector>

#include "base/check.h"
#include "base/file.h"
#include "lod/qsplat/builder/tree_writer.h"
#include "lod/qsplat/format.h"

namespace support {

/// Writes a valid file with a tree of at most `levels` levels to `path`; its nodes have random codes.
inline lod::qsplat::Header writeRandomSplats(const std::string& path, unsigned seed, bool colors, bool wide_pointers,
                                             int levels = 6) {
  using lod::qsplat::Node;
  std::mt19937 random(seed);
  const auto below = [&](std::uint32_t n) { return std::uniform_int_distribution<std::uint32_t>(0, n - 1)(random); };
  auto writer =
      lod::qsplat::builder::TreeWriter::create(path, colors, wide_pointers, base::Sphere{{1.0F, 2.0F, 3.0F}, 4.0F});
  LUMIGRID_CHECK(static_cast<bool>(writer));
  // Groups wait with the codes that their parents have for them.
  struct WaitingNode {
    std::uint32_t nodes = 1;
    bool leaves = false;
    int level = 0;
  };
  std::vector<WaitingNode> queue{{1, levels <= 1, 0}};
  for (std::size_t i = 0; i < queue.size(); ++i) {
    const WaitingNode waiting = queue[i];
    lod::qsplat::GroupNodes group;
    group.count = waiting.nodes;
    group.has_pointer = !waiting.leaves;
    for (std::uint32_t n = 0; n < group.count; ++n) {
      // A group whose nodes are not all leaves has at least one inner node.
      const bool inner = !waiting.leaves && (n == 0 || below(3) > 0);
      const std::uint32_t children = inner ? 2 + below(3) : 0;
      const bool last = inner && (waiting.level + 2 >= levels || below(4) == 0);
      const std::uint32_t sphere = i == 0 ? lod::qsplat::kWholeParent : below(lod::qsplat::kSphereCodes);
      const std::uint32_t normal = below(lod::qsplat::kNormalCodes);
      group.nodes[n] = {waiting.leaves ? lod::qsplat::packLeaf(sphere, normal, below(lod::qsplat::kLeafConeCodes))
                                       : lod::qsplat::packNode(sphere, normal, below(4), children, last),
                        static_cast<std::uint16_t>(below(65536))};
      if (inner) queue.push_back({children, last, waiting.level + 1});
    }
    LUMIGRID_CHECK(static_cast<bool>(writer->add(group)));
  }
  const auto header = writer->finish();
  LUMIGRID_CHECK(static_cast<bool>(header));
  return *header;
}

inline base::Bytes randomSplats(unsigned seed, bool colors, bool wide_pointers, const std::string& scratch,
                                int levels = 6) {
  writeRandomSplats(scratch, seed, colors, wide_pointers, levels);
  base::Bytes bytes = *base::readFile(scratch);
  std::remove(scratch.c_str());
  return bytes;
}

struct DecodedNode {
  base::Sphere sphere;
  lod::qsplat::Node node;
  bool leaf = false;
  bool among_leaves = false;  ///< its group has no pointer
  std::uint32_t parent = 0;   ///< place among the nodes; the root's own
  std::uint32_t level = 0;
};

/// Returns all nodes of a file without faults, breadth first.
inline std::vector<DecodedNode> decodeSplats(base::ByteView file) {
  using namespace lod::qsplat;
  const Header header = *readHeader(file);
  const GroupLayout layout(header);
  std::vector<DecodedNode> nodes;
  std::uint64_t end = kBlockBytes;
  const auto readGroup = [&](std::uint32_t parent, std::uint32_t count, bool has_pointer, std::uint32_t level,
                             const base::Sphere& around) {
    const std::uint32_t bytes = layout.bytes(count, has_pointer);
    const std::uint64_t offset = groupPlace(end, bytes);
    for (std::uint32_t i = 0; i < count; ++i) {
      const Node node = readNode(file.data() + offset, i, layout);
      nodes.push_back({decodeSphere(around, sphereTable()[node.sphereCode()]), node, !has_pointer || node.isLeaf(),
                       !has_pointer, parent, level});
    }
    end = offset + bytes;
  };
  readGroup(0, 1, header.nodes > 1, 0, header.root);
  for (std::uint32_t i = 0; i < nodes.size(); ++i) {
    const DecodedNode parent = nodes[i];
    if (!parent.leaf)
      readGroup(i, parent.node.children(), !parent.node.childrenAreLeaves(), parent.level + 1, parent.sphere);
  }
  return nodes;
}

}  // namespace support
