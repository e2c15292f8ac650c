#pragma once
// A small patch hierarchy built by hand, with geometry: a bumpy square whose leaves are n × n square patches. Groups
// regroup from level to level as the real builder's do, so the hierarchy is a DAG in which a group has several parents.
//
//   leaves      n × n patches of 4 × 4 units
//   level 1     groups of 2 × 2 patches; each makes three: two 4 × 4 on the left, one 4 wide and 8 tall on the right
//   level 2     columns 0 | 1 2 | 3 4 | … | n−1 of two such rows; each makes two patches, one above the other
//   level 3     one group of all: the root patch
//   group 0     consumes the root patch
//
// Each patch is a rectangle, triangulated as a fan around its middle. The points along a group's outer border stay as
// they were; the borders between the patches that it makes keep every 2nd, 4th … point. So a cut that mixes levels
// wrongly has open edges.
#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "lod/patch/codec.h"
#include "lod/patch/format.h"
#include "lod/patch/hierarchy.h"
#include "tests/support/quantized_normal.h"

namespace support {

/// The rectangle is in units and half open.
struct Rectangle {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
};

struct SyntheticHierarchy {
  lod::patch::Hierarchy hierarchy;
  std::vector<lod::patch::PatchGeometry> geometry;  ///< per patch
  std::vector<Rectangle> regions;                   ///< per patch: the part of the square that it covers
  int side = 0;                                     ///< of the square, units
};

namespace synthetic {

using Points = std::set<std::pair<int, int>>;

inline constexpr int kLeafUnits = 4;
inline constexpr int kLatticePerUnit = 64;

struct DraftPatch {
  Rectangle region;
  Points border;
  int producer = -1;
  int consumer = -1;
};

struct DraftGroup {
  Rectangle region;
  std::vector<int> consumed;
  std::uint32_t level = 0;
  float error = 0.0F;
};

struct Draft {
  std::vector<DraftPatch> patches;
  std::vector<DraftGroup> groups;  // children first
};

inline bool onBorder(const Rectangle& r, const std::pair<int, int>& p) {
  const auto [x, y] = p;
  if (x < r.x0 || x > r.x1 || y < r.y0 || y > r.y1) return false;
  return x == r.x0 || x == r.x1 || y == r.y0 || y == r.y1;
}

inline Points everyPoint(const Rectangle& r) {
  Points points;
  for (int x = r.x0; x <= r.x1; ++x)
    for (int y = r.y0; y <= r.y1; ++y)
      if (onBorder(r, {x, y})) points.insert({x, y});
  return points;
}

inline bool inside(const Rectangle& inner, const Rectangle& outer) {
  return inner.x0 >= outer.x0 && inner.x1 <= outer.x1 && inner.y0 >= outer.y0 && inner.y1 <= outer.y1;
}

/// Merges all patches of `level` − 1 inside `region` and makes `parts` from them.
inline void addDraftGroup(Draft& draft, std::uint32_t level, const Rectangle& region,
                          const std::vector<Rectangle>& parts) {
  DraftGroup group{region, {}, level, 0.0F};
  const int index = static_cast<int>(draft.groups.size());
  Points known;
  float child_error = 0.0F;
  for (int i = 0; i < static_cast<int>(draft.patches.size()); ++i) {
    DraftPatch& patch = draft.patches[static_cast<std::size_t>(i)];
    if (patch.consumer >= 0 || !inside(patch.region, region)) continue;
    patch.consumer = index;
    group.consumed.push_back(i);
    known.insert(patch.border.begin(), patch.border.end());
    if (patch.producer >= 0)
      child_error = std::max(child_error, draft.groups[static_cast<std::size_t>(patch.producer)].error);
  }
  // Errors grow upwards, and differ within a level.
  group.error = child_error * 2.0F + 0.01F + 0.001F * static_cast<float>(index % 7);
  draft.groups.push_back(group);

  // The outer border is locked: all known points on it stay. Borders between parts keep every 2^level-th point.
  const int stride = std::min(1 << level, kLeafUnits);
  for (const Rectangle& part : parts) {
    DraftPatch patch{part, {}, index, -1};
    for (const auto& point : everyPoint(part)) {
      const bool outer = onBorder(region, point);
      const bool corner =
          (point.first == part.x0 || point.first == part.x1) && (point.second == part.y0 || point.second == part.y1);
      const bool keep = outer ? known.contains(point) : (point.first % stride == 0 && point.second % stride == 0);
      if (keep || corner) patch.border.insert(point);
    }
    draft.patches.push_back(patch);
  }
}

inline Draft drawDraft(int n) {
  Draft draft;
  const int side = n * kLeafUnits;
  for (int y = 0; y < side; y += 4)
    for (int x = 0; x < side; x += 4) {
      const Rectangle region{x, y, x + 4, y + 4};
      draft.patches.push_back({region, everyPoint(region), -1, -1});
    }
  for (int y = 0; y < side; y += 8)
    for (int x = 0; x < side; x += 8)
      addDraftGroup(draft, 1, {x, y, x + 8, y + 8},
                    {{x, y, x + 4, y + 4}, {x, y + 4, x + 4, y + 8}, {x + 4, y, x + 8, y + 8}});
  for (int y = 0; y < side; y += 16)
    for (int x = -4; x < side; x += 8) {
      const int x0 = std::max(x, 0);
      const int x1 = std::min(x + 8, side);
      addDraftGroup(draft, 2, {x0, y, x1, y + 16}, {{x0, y, x1, y + 8}, {x0, y + 8, x1, y + 16}});
    }
  addDraftGroup(draft, 3, {0, 0, side, side}, {{0, 0, side, side}});
  addDraftGroup(draft, 4, {0, 0, side, side}, {});
  return draft;
}

/// The height of the bumps depends on the place alone, so that shared points agree.
inline glm::ivec3 latticePoint(int x, int y) {
  const auto h = static_cast<std::uint32_t>(x * 7349 + y * 3121) * 2654435761U;
  return {x * kLatticePerUnit, y * kLatticePerUnit, static_cast<int>(h >> 27U)};
}

/// Returns the points of the border, counter-clockwise seen from +z.
inline std::vector<std::pair<int, int>> ring(const DraftPatch& patch) {
  const Rectangle& r = patch.region;
  const auto along = [&](const std::pair<int, int>& p) {
    const auto [x, y] = p;
    if (y == r.y0 && x < r.x1) return x - r.x0;
    if (x == r.x1 && y < r.y1) return 1000 + y - r.y0;
    if (y == r.y1 && x > r.x0) return 2000 + r.x1 - x;
    return 3000 + r.y1 - y;
  };
  std::vector<std::pair<int, int>> points(patch.border.begin(), patch.border.end());
  std::sort(points.begin(), points.end(), [&](const auto& a, const auto& b) { return along(a) < along(b); });
  return points;
}

inline lod::patch::PatchGeometry fan(const DraftPatch& patch, bool colors) {
  lod::patch::PatchGeometry geometry;
  const auto add = [&](const glm::ivec3& q) {
    geometry.positions.push_back(q);
    geometry.normals.push_back(support::quantizedNormal(
        glm::vec3(static_cast<float>(q.x % 5) - 2.0F, static_cast<float>(q.y % 3) - 1.0F, 4.0F)));
    if (colors) geometry.colors.push_back(glm::u8vec4(q.x % 256, q.y % 256, q.z * 8 % 256, 255));
  };
  const auto points = ring(patch);
  const Rectangle& r = patch.region;
  add(latticePoint((r.x0 + r.x1) / 2, (r.y0 + r.y1) / 2));
  for (const auto& [x, y] : points) add(latticePoint(x, y));
  const auto count = static_cast<std::uint16_t>(points.size());
  for (std::uint16_t i = 0; i < count; ++i) {
    const std::array<std::uint16_t, 3> triangle{0, static_cast<std::uint16_t>(1 + i),
                                                static_cast<std::uint16_t>(1 + (i + 1) % count)};
    geometry.indices.insert(geometry.indices.end(), triangle.begin(), triangle.end());
  }
  return *lod::patch::decodePatch(lod::patch::encodePatch(geometry));
}

inline lod::patch::Patch record(const lod::patch::PatchGeometry& geometry, const lod::Lattice& lattice) {
  lod::patch::Patch row;
  std::vector<glm::vec3> positions;
  for (const glm::ivec3& q : geometry.positions) positions.push_back(lattice.position(q));
  std::vector<glm::vec3> facets;
  for (std::size_t t = 0; t < geometry.indices.size(); t += 3) {
    const glm::vec3 a = positions[geometry.indices[t]];
    facets.push_back(
        glm::normalize(glm::cross(positions[geometry.indices[t + 1]] - a, positions[geometry.indices[t + 2]] - a)));
  }
  for (const glm::vec3& p : positions) row.box.add(p);
  row.bounds = base::boundingSphere(positions);
  row.cone = base::boundingCone(facets);
  row.triangles = static_cast<std::uint32_t>(geometry.indices.size() / 3);
  row.vertices = static_cast<std::uint32_t>(positions.size());
  return row;
}

/// Numbers groups from the top down, and patches in their consumers' order.
inline SyntheticHierarchy numbered(const Draft& draft, bool colors) {
  SyntheticHierarchy scene;
  lod::patch::Hierarchy& h = scene.hierarchy;
  h.lattice = {glm::dvec3(-0.5, 0.25, 0.0), 1.0 / kLatticePerUnit};
  h.has_colors = colors;
  const auto last = static_cast<int>(draft.groups.size()) - 1;
  for (int d = last; d >= 0; --d) {
    const DraftGroup& source = draft.groups[static_cast<std::size_t>(d)];
    lod::patch::Group group;
    group.error = d == last ? std::numeric_limits<float>::infinity() : source.error;
    group.visible_error = group.error;
    group.typical_error = group.error / lod::patch::kVisibleRatio;
    group.attribute_error = d == last ? 1.0F : 0.125F * static_cast<float>(source.level);
    group.level = source.level;
    group.first_patch = static_cast<std::uint32_t>(h.patches.size());
    group.patch_count = static_cast<std::uint32_t>(source.consumed.size());
    for (const int p : source.consumed) {
      const DraftPatch& patch = draft.patches[static_cast<std::size_t>(p)];
      scene.geometry.push_back(fan(patch, colors));
      scene.regions.push_back(patch.region);
      h.patches.push_back(record(scene.geometry.back(), h.lattice));
      h.patches.back().consumer = static_cast<std::uint32_t>(last - d);
      if (patch.producer >= 0) h.patches.back().producer = static_cast<std::uint32_t>(last - patch.producer);
      h.patches.back().level = patch.producer >= 0 ? draft.groups[static_cast<std::size_t>(patch.producer)].level : 0;
      if (patch.producer < 0) h.source_triangles += h.patches.back().triangles;
    }
    h.groups.push_back(group);
  }
  return scene;
}

inline void linkParents(lod::patch::Hierarchy& h) {
  std::vector<std::set<std::uint32_t>> parents(h.groups.size());
  for (const lod::patch::Patch& patch : h.patches)
    if (patch.producer != lod::patch::kNoGroup) parents[patch.producer].insert(patch.consumer);
  for (std::size_t g = 0; g < h.groups.size(); ++g) {
    h.groups[g].first_parent = static_cast<std::uint32_t>(h.parents.size());
    h.groups[g].parent_count = static_cast<std::uint32_t>(parents[g].size());
    h.parents.insert(h.parents.end(), parents[g].begin(), parents[g].end());
  }
}

/// Computes spheres bottom up: a group's holds its patches' spheres and its children groups'.
inline void boundGroups(lod::patch::Hierarchy& h) {
  for (std::size_t g = h.groups.size(); g-- > 0;) {
    lod::patch::Group& group = h.groups[g];
    std::vector<base::Sphere> below;
    for (std::uint32_t p = group.first_patch; p < group.first_patch + group.patch_count; ++p) {
      below.push_back(h.patches[p].bounds);
      if (h.patches[p].producer != lod::patch::kNoGroup) below.push_back(h.groups[h.patches[p].producer].bounds);
    }
    group.bounds = base::boundingSphere(below);
  }
}

}  // namespace synthetic

/// n: 4, 8, 16 …: leaves per side. Its errors range from 0.01 to about 0.1 units of a square of 4 n units.
inline SyntheticHierarchy syntheticHierarchy(int n, bool colors = false) {
  SyntheticHierarchy scene = synthetic::numbered(synthetic::drawDraft(n), colors);
  scene.side = n * synthetic::kLeafUnits;
  synthetic::linkParents(scene.hierarchy);
  synthetic::boundGroups(scene.hierarchy);
  return scene;
}

/// The blocks of a group in the form that writePatchFile needs.
inline base::Result<std::vector<base::Bytes>> encodedBlock(const SyntheticHierarchy& scene, std::uint32_t group) {
  const lod::patch::Group& row = scene.hierarchy.groups[group];
  std::vector<base::Bytes> patches;
  for (std::uint32_t p = row.first_patch; p < row.first_patch + row.patch_count; ++p)
    patches.push_back(lod::patch::encodePatch(scene.geometry[p]));
  return patches;
}

inline base::Result<void> writeSynthetic(const SyntheticHierarchy& scene, const std::string& path) {
  return lod::patch::writePatchFile(path, scene.hierarchy,
                                    [&](std::uint32_t group) { return encodedBlock(scene, group); });
}

}  // namespace support
