#include "lod/patch/orientation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/gtc/constants.hpp>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "lod/patch/hull.h"
#include "lod/patch/proxy_sight.h"
#include "lod/patch/traverse.h"

namespace lod::patch {
namespace {

// Triangles of the coarse cut that is looked at. A choice: statues keep their faces, and it takes a tenth of a second.
constexpr std::uint64_t kTriangles = 20'000;
// Normals within 20 degrees of an axis face it.
constexpr float kFacing = 0.94F;
// A base is flat within ten degrees, and lies in the lowest part of so much of the extent.
constexpr float kBaseFacing = 0.985F;
constexpr float kBaseDepth = 0.02F;
// The weights of the signs. They were chosen by looking at the scans of docs/decisions/first-view.md; each of them
// decides some of those alone.
constexpr float kBaseWeight = 2.0F;
constexpr float kFlatWeight = 0.15F;
// Floors and ceilings of an interior weigh the same, but what stands in it is low. It decides between those alone.
constexpr float kLowWeight = 0.1F;
constexpr float kFlat = 0.5F;   // the shortest side of a flat scan over the next one
constexpr float kLeast = 0.1F;  // signs that count less say nothing
constexpr float kSure = 0.15F;  // by so much the best axis is ahead of the next
// The first view looks down by this angle; where the scan is flat by the larger one, or it would be seen edge on.
constexpr float kElevation = 0.35F;
constexpr float kFlatElevation = 0.75F;
constexpr std::size_t kHeadings = 24;
// From so many faces all headings are compared, and the best of them from all faces. Casting all lines of sight for all
// headings would take a fifth of a small scan's build.
constexpr std::size_t kFewFaces = 2'000;
constexpr std::size_t kFinalists = 6;

struct Face {
  glm::vec3 center{0.0F};
  glm::vec3 normal{0.0F};
  float area = 0.0F;
};

struct Surface {
  std::vector<Face> faces;
  std::vector<SurfacePart> parts;  ///< all triangles, those without area included
  base::Aabb box;
  float area = 0.0F;
  std::optional<ProxySight> sight;

  void add(const Lattice& lattice, const PatchGeometry& geometry) {
    for (std::size_t i = 0; i + 2 < geometry.indices.size(); i += 3) {
      std::array<glm::vec3, 3> p;
      for (std::size_t k = 0; k < 3; ++k) {
        p[k] = lattice.position(geometry.positions[geometry.indices[i + k]]);
        box.add(p[k]);
      }
      parts.push_back(trianglePart(p));
      const glm::vec3 n = glm::cross(p[1] - p[0], p[2] - p[0]);
      const float length = glm::length(n);
      if (!(length > 0.0F)) continue;
      faces.push_back({(p[0] + p[1] + p[2]) / 3.0F, n / length, 0.5F * length});
      area += 0.5F * length;
    }
  }
};

base::Result<Surface> coarseSurface(const PatchFile& patches) {
  const Hierarchy& hierarchy = patches.hierarchy();
  const UniformCut cut = selectFinestUniformCut(hierarchy, kTriangles);
  Surface surface;
  LUMIGRID_ASSIGN_OR_RETURN(surface.sight,
                            ProxySight::ofPatches(hierarchy, cut.cut.patches, cut.error,
                                                  [&](std::uint32_t patch) -> base::Result<PatchGeometry> {
                                                    LUMIGRID_ASSIGN_OR_RETURN(auto geometry, patches.geometry(patch));
                                                    surface.add(hierarchy.lattice, geometry);
                                                    return geometry;
                                                  }));
  return surface;
}

bool isFlat(const glm::vec3& size, int axis) {
  return size[axis] <= kFlat * std::min(size[(axis + 1) % 3], size[(axis + 2) % 3]);
}

// The share of the footprint across `axis` that a flat base fills at its lower end, and the share of all area that
// faces up, without that base, less what faces down; and how far the mean height lies below the middle, over half the
// extent.
struct Signs {
  float base = 0.0F;
  float ground = 0.0F;
  float low = 0.0F;
};
Signs signsOf(const Surface& surface, int axis, float sign) {
  const glm::vec3 size = surface.box.size();
  const float lowest = sign > 0.0F ? surface.box.min[axis] : -surface.box.max[axis];
  Signs signs;
  float base_area = 0.0F;
  float height = 0.0F;
  for (const Face& face : surface.faces) {
    const float faces = sign * face.normal[axis];
    height += face.area / surface.area * (sign * face.center[axis] - lowest);
    const bool is_low = sign * face.center[axis] - lowest < kBaseDepth * size[axis];
    const bool is_base = is_low && faces < -kBaseFacing;
    if (is_base) base_area += face.area;
    if (faces < -kFacing && !is_base) signs.ground -= face.area / surface.area;
    if (faces > kFacing) signs.ground += face.area / surface.area;
  }
  signs.base = std::min(1.0F, base_area / std::max(1e-30F, size[(axis + 1) % 3] * size[(axis + 2) % 3]));
  signs.low = size[axis] > 0.0F ? 1.0F - 2.0F * height / size[axis] : 0.0F;
  return signs;
}

void findUp(const Surface& surface, Orientation& out) {
  const glm::vec3 size = surface.box.size();
  float best = 0.0F;
  float next = 0.0F;
  for (int axis = 0; axis < 3; ++axis)
    for (const float sign : {1.0F, -1.0F}) {
      const Signs signs = signsOf(surface, axis, sign);
      const float flat = isFlat(size, axis) ? kFlatWeight : 0.0F;
      const float score = kBaseWeight * signs.base + signs.ground + flat + kLowWeight * signs.low;
      if (score <= best) {
        next = std::max(next, score);
        continue;
      }
      next = std::exchange(best, score);
      out.up = glm::vec3(0.0F);
      out.up[axis] = sign;
      out.reason = signs.ground >= kBaseWeight * signs.base && signs.ground > flat ? "the ground faces it"
                   : kBaseWeight * signs.base > flat                               ? "a base lies under it"
                                                                                   : "the scan is flattest across it";
    }
  out.is_sure = best >= kLeast && best - next >= kSure;
  if (best >= kLeast) return;
  out.up = {0.0F, 1.0F, 0.0F};
  out.reason = "nothing tells, and most models have it so";
}

// A face that is seen from behind counts by so much. A choice: enough that the front of a wall outweighs its back,
// whose letters are mirrored, and still something, since in many meshes some faces are turned over.
constexpr float kFromBehind = 0.7F;

// How much of the surface a far eye sees that looks along `direction`: faces count by their area and each by itself,
// since simplification leaves more of them where there is more to see; seen at a slant or from behind they count less.
// Every `stride`th face is looked at.
float shownFrom(const Surface& surface, const glm::vec3& direction, std::size_t stride) {
  const float far = surface.box.diagonal();
  const float clearance = 2e-3F * far;
  const auto count = static_cast<float>(surface.faces.size());
  float shown = 0.0F;
  for (std::size_t i = 0; i < surface.faces.size(); i += stride) {
    const Face& face = surface.faces[i];
    const float away = glm::dot(face.normal, direction);
    const float slant = std::abs(away);
    if (slant < 0.05F || surface.sight->isBlocked(face.center, face.center - far * direction, clearance)) continue;
    shown += (away > 0.0F ? kFromBehind : 1.0F) * slant * (face.area / surface.area + 1.0F / count);
  }
  return shown;
}

void findDirection(const Surface& surface, Orientation& out) {
  const glm::vec3 size = surface.box.size();
  const int axis = std::abs(out.up.x) > 0.5F ? 0 : std::abs(out.up.y) > 0.5F ? 1 : 2;
  const float elevation = isFlat(size, axis) ? kFlatElevation : kElevation;
  glm::vec3 side(0.0F);
  side[(axis + 1) % 3] = 1.0F;
  side = glm::normalize(side - glm::dot(side, out.up) * out.up);
  const glm::vec3 across = glm::cross(out.up, side);
  struct View {
    glm::vec3 direction{0.0F};
    float shown = 0.0F;
  };
  std::array<View, kHeadings> views;
  for (std::size_t h = 0; h < kHeadings; ++h) {
    const float angle = glm::two_pi<float>() * static_cast<float>(h) / static_cast<float>(kHeadings);
    const glm::vec3 from = std::cos(angle) * side + std::sin(angle) * across;
    views[h].direction = -(std::cos(elevation) * from + std::sin(elevation) * out.up);
    views[h].shown = shownFrom(surface, views[h].direction, surface.faces.size() / kFewFaces + 1);
  }
  const auto shows_more = [](const View& a, const View& b) { return a.shown > b.shown; };
  std::stable_sort(views.begin(), views.end(), shows_more);
  const std::span<View> finalists = std::span(views).first(kFinalists);
  for (View& view : finalists) view.shown = shownFrom(surface, view.direction, 1);
  out.direction = std::max_element(finalists.begin(), finalists.end(), [&](const View& a, const View& b) {
                    return shows_more(b, a);
                  })->direction;
}

}  // namespace

base::Result<Orientation> findOrientation(const PatchFile& patches, const glm::vec3* up) {
  LUMIGRID_ASSIGN_OR_RETURN(const Surface surface, coarseSurface(patches));
  Orientation found;
  found.reason = "nothing tells, and most models have it so";
  if (!surface.faces.empty()) findUp(surface, found);
  if (up != nullptr) {
    found.up = *up;
    found.is_sure = true;
    found.reason = "it was said so";
  }
  if (!surface.faces.empty()) findDirection(surface, found);
  found.hull = findHull(surface.parts);
  return found;
}

}  // namespace lod::patch
