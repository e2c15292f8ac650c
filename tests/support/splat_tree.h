#pragma once
// This is a second, simple way from a mesh to a qsplat.lgq in memory. Tests of drawing need no builder then, and tests
// of the builder have something to compare with.
#include <algorithm>
#include <cstdint>
#include <numeric>
#include <vector>

#include "lod/qsplat/format.h"
#include "tests/support/decoded_splats.h"
#include "tests/support/mesh.h"

namespace support {

namespace splat_tree {

struct Leaf {
  base::Sphere sphere;
  glm::vec3 normal{0.0F};
  std::uint16_t color = 0xFFFF;
  std::vector<glm::vec3> facets;  ///< unit normals around the vertex
};

/// Returns the radius of the smallest sphere around a triangle.
inline float circumscribed(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c) {
  const glm::dvec3 ab(b - a), ac(c - a), bc(c - b);
  const double x = glm::dot(ab, ab), y = glm::dot(ac, ac), z = glm::dot(bc, bc);
  const double longest = std::max({x, y, z});
  const double area = glm::length(glm::cross(ab, ac));
  if (x + y + z <= 2.0 * longest || area == 0.0) return static_cast<float>(0.5 * std::sqrt(longest));
  return static_cast<float>(std::sqrt(x * y * z) / (2.0 * area));
}

inline std::vector<Leaf> leavesOf(const support::Mesh& mesh) {
  std::vector<Leaf> leaves(mesh.positions.size());
  for (std::size_t v = 0; v < leaves.size(); ++v) {
    leaves[v].sphere.center = mesh.positions[v];
    if (!mesh.colors.empty()) leaves[v].color = lod::qsplat::encodeColor(glm::u8vec3(mesh.colors[v]));
  }
  for (std::size_t t = 0; t + 2 < mesh.indices.size(); t += 3) {
    const std::uint32_t* corner = &mesh.indices[t];
    const glm::vec3 &a = mesh.positions[corner[0]], &b = mesh.positions[corner[1]], &c = mesh.positions[corner[2]];
    const glm::vec3 cross = glm::cross(b - a, c - a);
    for (int k = 0; k < 3; ++k) {
      Leaf& leaf = leaves[corner[k]];
      leaf.sphere.radius = std::max(leaf.sphere.radius, circumscribed(a, b, c) * (1.0F + 1e-5F));
      leaf.normal += cross;
      if (glm::length(cross) > 0.0F) leaf.facets.push_back(glm::normalize(cross));
    }
  }
  std::erase_if(leaves, [](const Leaf& leaf) { return leaf.sphere.radius == 0.0F; });
  return leaves;
}

struct Tree {
  std::vector<Leaf> leaves;
  std::vector<std::uint32_t> order;  ///< of the leaves
  struct TrueNode {
    std::uint32_t begin = 0, end = 0;  ///< in `order`
    base::Sphere sphere;
    std::vector<std::uint32_t> children;
    glm::vec3 normal{0.0F}, color{0.0F};
  };
  std::vector<TrueNode> nodes;

  std::uint32_t split(std::uint32_t begin, std::uint32_t end) {
    base::Aabb box;
    for (std::uint32_t i = begin; i < end; ++i) box.add(leaves[order[i]].sphere.center);
    const glm::vec3 size = box.size();
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    const std::uint32_t middle = begin + (end - begin) / 2;
    std::nth_element(order.begin() + begin, order.begin() + middle, order.begin() + end,
                     [&](std::uint32_t a, std::uint32_t b) {
                       return leaves[a].sphere.center[axis] < leaves[b].sphere.center[axis];
                     });
    return middle;
  }

  std::uint32_t build(std::uint32_t begin, std::uint32_t end) {
    const auto number = static_cast<std::uint32_t>(nodes.size());
    nodes.push_back({begin, end, {}, {}});
    if (end - begin == 1) {
      const Leaf& leaf = leaves[order[begin]];
      nodes[number].sphere = leaf.sphere;
      nodes[number].normal = leaf.normal;
      nodes[number].color = glm::vec3(support::decodeColor(leaf.color));
      return number;
    }
    std::vector<std::uint32_t> cuts{begin, split(begin, end), end};
    if (cuts[2] - cuts[1] > 1) cuts.insert(cuts.end() - 1, split(cuts[1], cuts[2]));
    if (cuts[1] - cuts[0] > 1) cuts.insert(cuts.begin() + 1, split(cuts[0], cuts[1]));
    std::vector<base::Sphere> spheres;
    glm::vec3 color(0.0F);
    for (std::size_t i = 0; i + 1 < cuts.size(); ++i) {
      const std::uint32_t child = build(cuts[i], cuts[i + 1]);
      nodes[number].children.push_back(child);
      spheres.push_back(nodes[child].sphere);
      nodes[number].normal += nodes[child].normal;
      color += nodes[child].color * static_cast<float>(cuts[i + 1] - cuts[i]);
    }
    nodes[number].sphere = base::boundingSphere(spheres);
    nodes[number].color = color / static_cast<float>(end - begin);
    return number;
  }

  /// Returns the cosine of the largest angle between the normal of this code and those of the surface below.
  double leastCosine(const TrueNode& node, std::uint32_t normal_code) const {
    const glm::dvec3 axis(lod::qsplat::normalTable()[normal_code]);
    double least = 1.0;
    for (std::uint32_t i = node.begin; i < node.end; ++i)
      for (const glm::vec3& facet : leaves[order[i]].facets) least = std::min(least, glm::dot(axis, glm::dvec3(facet)));
    return least;
  }
};

struct Group {
  std::vector<std::uint32_t> nodes;
  std::vector<base::Sphere> decoded;
  base::Sphere parent;
  std::uint64_t offset = 0, pointer = 0;
};

}  // namespace splat_tree

/// Returns the whole file, as docs/formats/qsplat.md defines it.
inline base::Bytes splatFile(const support::Mesh& mesh, bool wide_pointers = false) {
  using namespace lod::qsplat;
  splat_tree::Tree tree;
  tree.leaves = splat_tree::leavesOf(mesh);
  tree.order.resize(tree.leaves.size());
  std::iota(tree.order.begin(), tree.order.end(), 0U);
  tree.build(0, static_cast<std::uint32_t>(tree.order.size()));
  const auto isLeaf = [&](std::uint32_t n) { return tree.nodes[n].children.empty(); };
  const auto hasPointer = [&](const splat_tree::Group& g) {
    return !std::all_of(g.nodes.begin(), g.nodes.end(), isLeaf);
  };

  Header header;
  header.colors = !mesh.colors.empty();
  header.wide_pointers = wide_pointers;
  header.nodes = tree.nodes.size();
  header.leaves = tree.leaves.size();
  header.root = tree.nodes[0].sphere;
  const GroupLayout layout(header);

  // Breadth first: where the groups lie, and what a reader decodes.
  std::vector<splat_tree::Group> groups(1);
  groups[0].nodes = {0};
  groups[0].parent = header.root;
  std::uint64_t end = kBlockBytes;
  std::size_t level_end = 1;
  for (std::size_t g = 0; g < groups.size(); ++g) {
    if (g == level_end || g == 0) ++header.levels, level_end = groups.size();
    const std::uint32_t bytes = layout.bytes(static_cast<std::uint32_t>(groups[g].nodes.size()), hasPointer(groups[g]));
    groups[g].offset = groupPlace(end, bytes);
    end = groups[g].offset + bytes;
    if (hasPointer(groups[g])) ++header.pointers;
    for (std::size_t i = 0; i < groups[g].nodes.size(); ++i) {
      const splat_tree::Tree::TrueNode& node = tree.nodes[groups[g].nodes[i]];
      const std::uint32_t code = g == 0 ? kWholeParent : encodeSphere(groups[g].parent, node.sphere);
      groups[g].decoded.push_back(decodeSphere(groups[g].parent, sphereTable()[code]));
      if (node.children.empty()) continue;
      if (groups[g].pointer == 0) groups[g].pointer = groups.size();  // a number until all have places
      const base::Sphere parent = groups[g].decoded.back();
      groups.push_back({node.children, {}, parent});
    }
  }
  header.groups = groups.size();
  header.file_bytes = (end + kBlockBytes - 1) / kBlockBytes * kBlockBytes;

  base::Bytes file(header.file_bytes, 0);
  for (const splat_tree::Group& group : groups) {
    std::uint64_t at = group.offset;
    for (std::size_t i = 0; i < group.nodes.size(); ++i) {
      const splat_tree::Tree::TrueNode& node = tree.nodes[group.nodes[i]];
      const std::uint32_t normal = encodeNormal(node.normal);
      const bool leaf = node.children.empty();
      const bool above_leaves = !leaf && std::all_of(node.children.begin(), node.children.end(), isLeaf);
      const std::uint32_t sphere = group.offset == kBlockBytes ? kWholeParent : encodeSphere(group.parent, node.sphere);
      const double least = tree.leastCosine(node, normal);
      const std::uint32_t bits = hasPointer(group)
                                     ? packNode(sphere, normal, encodeCone(least),
                                                static_cast<std::uint32_t>(node.children.size()), above_leaves)
                                     : packLeaf(sphere, normal, encodeLeafCone(least));
      std::memcpy(&file[at], &bits, sizeof(bits));
      const std::uint16_t color = encodeColor(glm::u8vec3(node.color + 0.5F));
      if (header.colors) std::memcpy(&file[at + sizeof(bits)], &color, sizeof(color));
      at += layout.node_bytes;
    }
    if (!hasPointer(group)) continue;
    const std::uint64_t half = groups[group.pointer].offset / 2;
    std::memcpy(&file[at], &half, layout.pointer_bytes);
  }
  const base::Bytes front = headerBytes(header);
  std::copy(front.begin(), front.end(), file.begin());
  for (std::uint64_t b = 1; b < header.blocks(); ++b) sealBlock(&file[b * kBlockBytes], static_cast<std::uint32_t>(b));
  return file;
}

}  // namespace support
