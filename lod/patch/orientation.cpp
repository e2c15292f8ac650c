#include "lod/patch/orientation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/gtc/constants.hpp>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "base/camera.h"
#include "lod/patch/hull.h"
#include "lod/patch/proxy_sight.h"
#include "lod/patch/traverse.h"

namespace lod::patch {
namespace {

// Triangles of the coarse cut that is looked at. A choice: statues keep their faces, and it takes a tenth of a second.
constexpr std::uint64_t kTriangles = 20'000;
// Normals within 20 degrees of an axis face it.
constexpr float kFacing = 0.94F;
// Rays begin so far from the surface, over the diagonal of its box.
constexpr float kClearance = 2e-3F;
// A base is flat within ten degrees, and lies in the lowest part of so much of the extent.
constexpr float kBaseFacing = 0.985F;
constexpr float kBaseDepth = 0.02F;
// The weights of the signs. They were chosen by looking at the scans of docs/decisions/first-view.md; each of them
// decides some of those alone.
constexpr float kBaseWeight = 2.0F;
constexpr float kFlatWeight = 0.15F;
// Floors and ceilings of an interior weigh the same, but what stands in it is low. It decides between those alone.
constexpr float kLowWeight = 0.1F;
// The axis of floors and ceilings is told by its levels, for which the extent is cut into so many slices.
constexpr float kLevelWeight = 1.0F;
constexpr int kLevelSlices = 100;
// Few models stand head down along their axes.
constexpr float kHeadDown = 0.002F;
// Floors and ceilings of passages are alike, so little else tells up. Caves and mines are surveyed with z up.
constexpr float kHeadDownPassages = 0.1F;
constexpr float kSurveyedWeight = 0.15F;
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

int axisOf(const glm::vec3& up) {
  return std::abs(up.x) > 0.5F ? 0 : std::abs(up.y) > 0.5F ? 1 : 2;
}

bool isFlat(const glm::vec3& size, int axis) {
  return size[axis] <= kFlat * std::min(size[(axis + 1) % 3], size[(axis + 2) % 3]);
}

// The share of the footprint across `axis` that a flat base fills at its lower end; the share of all area that faces
// up, less what faces down; and how far the mean height lies below the middle, over half the extent. `base_area`: the
// base's share of all area. `closed`: the part of what faces down that something above it faces up for.
struct Signs {
  float base = 0.0F;
  float base_area = 0.0F;
  float ground = 0.0F;
  float low = 0.0F;
  float closed = 0.0F;
};
Signs signsOf(const Surface& surface, int axis, float sign) {
  const glm::vec3 size = surface.box.size();
  const float lowest = sign > 0.0F ? surface.box.min[axis] : -surface.box.max[axis];
  Signs signs;
  float height = 0.0F;
  float facing_up = 0.0F;
  float facing_down = 0.0F;
  for (const Face& face : surface.faces) {
    const float faces = sign * face.normal[axis];
    (faces > 0.0F ? facing_up : facing_down) += face.area * std::abs(faces);
    height += face.area / surface.area * (sign * face.center[axis] - lowest);
    const bool is_low = sign * face.center[axis] - lowest < kBaseDepth * size[axis];
    if (is_low && faces < -kBaseFacing) signs.base_area += face.area / surface.area;
    if (faces < -kFacing) signs.ground -= face.area / surface.area;
    if (faces > kFacing) signs.ground += face.area / surface.area;
  }
  const float footprint = size[(axis + 1) % 3] * size[(axis + 2) % 3];
  signs.base = std::min(1.0F, signs.base_area * surface.area / std::max(1e-30F, footprint));
  signs.low = size[axis] > 0.0F ? 1.0F - 2.0F * height / size[axis] : 0.0F;
  signs.closed = facing_down > 0.0F ? std::min(1.0F, facing_up / facing_down) : 0.0F;
  return signs;
}

// How much of the footprint the levels across `axis` fill, in the mean over their area: what faces one way within 20
// degrees, in a slice and its two neighbours, is a level. In an interior all floors of a storey lie at one height, and
// its ceilings at another; the walls of its rooms stand at many places, and have doors.
float levelsOf(const Surface& surface, int axis) {
  const glm::vec3 size = surface.box.size();
  if (!(size[axis] > 0.0F)) return 0.0F;
  std::array<std::array<float, kLevelSlices + 2>, 2> slices{};  // with an empty one before and behind
  for (const Face& face : surface.faces) {
    if (std::abs(face.normal[axis]) < kFacing) continue;
    const float along = (face.center[axis] - surface.box.min[axis]) / size[axis];
    const int slice = std::clamp(static_cast<int>(along * kLevelSlices), 0, kLevelSlices - 1);
    slices[face.normal[axis] > 0.0F ? 0 : 1][static_cast<std::size_t>(slice) + 1] += face.area;
  }
  const float footprint = size[(axis + 1) % 3] * size[(axis + 2) % 3];
  float area = 0.0F;
  float filled = 0.0F;
  for (const auto& areas : slices)
    for (std::size_t i = 1; i <= kLevelSlices; ++i) {
      area += areas[i];
      filled += areas[i] * std::min(1.0F, (areas[i - 1] + areas[i] + areas[i + 1]) / footprint);
    }
  return area > 0.0F ? filled / area : 0.0F;
}

// By axis, upwards and downwards.
using AllSigns = std::array<std::array<Signs, 2>, 3>;

// Takes away the bases that tell nothing. Nobody sees the lower side of a building, so a flat end is its roof where the
// other is open. Two opposite flat ends are those of a column, whichever it stands on, but the walls of a house where
// another axis has two as well. A base that tells something is no ground that faces down.
void keepBasesThatTell(AllSigns& all) {
  std::array<float, 3> both{};
  for (std::size_t axis = 0; axis < 3; ++axis) both[axis] = std::min(all[axis][0].base, all[axis][1].base);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const float others = std::max(both[(axis + 1) % 3], both[(axis + 2) % 3]);
    for (Signs& signs : all[axis]) {
      const float kept = (signs.base - both[axis]) * signs.closed + std::max(0.0F, both[axis] - others);
      if (signs.base > 0.0F) signs.ground += signs.base_area * kept / signs.base;
      signs.base = kept;
    }
  }
}

// Passages are enclosed nearly everywhere, but for what the scanner missed, and narrow for their length. So are few
// objects whose triangles are all turned over, and those cannot be told apart. Scans of rooms have more holes. Measured
// on the scans of docs/decisions/first-view.md.
constexpr float kEnclosed = 0.9F;
constexpr float kNarrow = 0.05F;
constexpr float kRoomsEnclosed = 0.75F;

// The share of the surface whose front looks at another front, as all of a cave's does and little of what is seen from
// outside; and how far away that is in the mean, over the diagonal of the box.
struct Enclosure {
  float share = 0.0F;
  float width = 0.0F;

  bool isWhole() const { return share >= kEnclosed; }
  bool hasPassages() const { return isWhole() && width <= kNarrow; }
  bool hasRooms() const { return share >= kRoomsEnclosed; }
};
constexpr std::size_t kEnclosureRays = 4'000;
Enclosure enclosureOf(const Surface& surface) {
  const float far = surface.box.diagonal();
  const std::size_t stride = surface.faces.size() / kEnclosureRays + 1;
  float all = 0.0F;
  Enclosure sum;
  for (std::size_t i = 0; i < surface.faces.size(); i += stride) {
    const Face& face = surface.faces[i];
    all += face.area;
    const auto hit = surface.sight->nearest(face.center + kClearance * far * face.normal, face.normal, far);
    if (!hit || glm::dot(hit->normal, face.normal) >= 0.0F) continue;
    sum.share += face.area;
    sum.width += face.area * hit->distance;
  }
  return {sum.share / all, sum.share > 0.0F ? sum.width / (sum.share * far) : 0.0F};
}

void findUp(const Surface& surface, const Enclosure& enclosure, Orientation& out) {
  const glm::vec3 size = surface.box.size();
  const float head_down = enclosure.hasPassages() ? kHeadDownPassages : kHeadDown;
  AllSigns all;
  for (int axis = 0; axis < 3; ++axis)
    all[static_cast<std::size_t>(axis)] = {signsOf(surface, axis, 1.0F), signsOf(surface, axis, -1.0F)};
  keepBasesThatTell(all);
  float best = 0.0F;
  float next = 0.0F;
  for (int axis = 0; axis < 3; ++axis) {
    const float levels = enclosure.hasRooms() ? kLevelWeight * levelsOf(surface, axis) : 0.0F;
    for (const float sign : {1.0F, -1.0F}) {
      const Signs& signs = all[static_cast<std::size_t>(axis)][sign > 0.0F ? 0 : 1];
      const float flat = isFlat(size, axis) ? kFlatWeight : 0.0F;
      const float surveyed = enclosure.hasPassages() && axis == 2 && sign > 0.0F ? kSurveyedWeight : 0.0F;
      // Nothing is seen of what rooms stand on: what faces down at their end is the back of furniture.
      const float base = enclosure.hasRooms() ? 0.0F : kBaseWeight * signs.base;
      const float score =
          base + levels + signs.ground + flat + surveyed + kLowWeight * signs.low - (sign < 0.0F ? head_down : 0.0F);
      if (score <= best) {
        next = std::max(next, score);
        continue;
      }
      next = std::exchange(best, score);
      out.up = glm::vec3(0.0F);
      out.up[axis] = sign;
      out.reason = levels > std::max(signs.ground, flat + surveyed)         ? "its floors and ceilings lie across it"
                   : signs.ground >= base && signs.ground > flat + surveyed ? "the ground faces it"
                   : base > flat + surveyed                                 ? "a base lies under it"
                   : flat > 0.0F                                            ? "the scan is flattest across it"
                                                                            : "surveys have it so";
    }
  }
  out.is_sure = best >= kLeast && best - next >= kSure;
  if (best >= kLeast) return;
  out.up = {0.0F, 1.0F, 0.0F};
  out.reason = "nothing tells, and most models have it so";
}

// An interior is seen from above through the backs of its ceilings. It is one where so much of what the sky sees is
// such a back, with a floor beneath it, and one of both is level: the ceiling may be a vault, or the floor a ramp. Else
// a statue whose triangles are turned over would be a cave. In passages neither need be level.
constexpr float kCeilings = 0.6F;
constexpr float kCeilingFacing = 0.26F;  // 15 degrees from upright; a wall is no ceiling
constexpr int kColumns = 64;             // along each side of the footprint
constexpr int kSections = 48;            // heights that are tried
// A section that opens nearly as many rooms as the best, higher up, leaves more of the walls.
constexpr float kNearlyAsMany = 0.95F;
// … but one that opens less of them shows little else than the backs of the others. Choices.
constexpr float kOpened = 0.5F;

/// From a room's floor to its ceiling, scene units along up.
struct Room {
  float floor = 0.0F, ceiling = 0.0F;
};

/// The rooms beneath what the sky sees, one for each of many columns that meet one.
struct Rooms {
  std::vector<Room> rooms;
  float share = 0.0F;  ///< of the columns that meet anything
};

/// `up`: along an axis. `are_rough`: neither ceilings nor floors need be level.
Rooms findRooms(const Surface& surface, const glm::vec3& up, bool are_rough) {
  const glm::vec3 size = surface.box.size();
  const int axis = axisOf(up);
  const float clearance = kClearance * surface.box.diagonal();
  std::vector<Room> rooms;
  std::size_t seen = 0;
  for (int i = 0; i < kColumns * kColumns; ++i) {
    glm::vec3 sky = up[axis] > 0.0F ? surface.box.max : surface.box.min;
    const auto place = [&](int side, int column) {
      sky[side] = surface.box.min[side] + size[side] * (static_cast<float>(column) + 0.5F) / kColumns;
    };
    place((axis + 1) % 3, i % kColumns);
    place((axis + 2) % 3, i / kColumns);
    sky += clearance * up;
    const auto first = surface.sight->nearest(sky, -up, size[axis] + 2.0F * clearance);
    if (!first) continue;
    ++seen;
    const float ceiling_faces = -glm::dot(first->normal, up);
    if (ceiling_faces < kCeilingFacing) continue;
    const float ceiling = glm::dot(sky, up) - first->distance;
    const glm::vec3 beneath = sky - (first->distance + clearance) * up;
    const auto floor = surface.sight->nearest(beneath, -up, size[axis]);
    const float least = ceiling_faces < kFacing && !are_rough ? kFacing : 0.0F;
    if (floor && glm::dot(floor->normal, up) > least) rooms.push_back({ceiling - clearance - floor->distance, ceiling});
  }
  return {rooms, static_cast<float>(rooms.size()) / static_cast<float>(std::max<std::size_t>(seen, 1))};
}

/// The height along `up` of the highest section that opens nearly as many rooms as any; nothing where that is but a
/// part of them, as of a cave that goes up and down.
std::optional<float> sectionHeight(const Surface& surface, const std::vector<Room>& rooms, const glm::vec3& up) {
  const float top = std::max(glm::dot(surface.box.min, up), glm::dot(surface.box.max, up));
  const float height = surface.box.size()[axisOf(up)];
  std::array<float, kSections> heights{};
  std::array<std::ptrdiff_t, kSections> opened{};
  for (std::size_t i = 0; i < kSections; ++i) {
    heights[i] = top - height * static_cast<float>(i + 1) / (kSections + 1);
    opened[i] = std::count_if(rooms.begin(), rooms.end(),
                              [&](const Room& room) { return room.floor < heights[i] && heights[i] < room.ceiling; });
  }
  const auto most = static_cast<float>(*std::max_element(opened.begin(), opened.end()));
  if (most < kOpened * static_cast<float>(rooms.size())) return std::nullopt;
  const float enough = kNearlyAsMany * most;
  std::size_t best = 0;
  while (static_cast<float>(opened[best]) < enough) ++best;
  return heights[best];
}

// A face that is seen from behind counts by so much. A choice: enough that the front of a wall outweighs its back,
// whose letters are mirrored, and still something, since in many meshes some faces are turned over.
constexpr float kFromBehind = 0.7F;

// How much of the surface a far eye sees that looks along `direction`: faces count by their area and each by itself,
// since simplification leaves more of them where there is more to see; seen at a slant or from behind they count less.
// Every `stride`th face that the section leaves is looked at.
float shownFrom(const Surface& surface, const glm::vec3& direction, std::size_t stride, const glm::vec4& section) {
  const float far = surface.box.diagonal();
  const float clearance = kClearance * far;
  const auto count = static_cast<float>(surface.faces.size());
  float shown = 0.0F;
  for (std::size_t i = 0; i < surface.faces.size(); i += stride) {
    const Face& face = surface.faces[i];
    const float away = glm::dot(face.normal, direction);
    const float slant = std::abs(away);
    const float below = section.w - glm::dot(face.center, glm::vec3(section));
    const float climb = -glm::dot(direction, glm::vec3(section));  // of the line of sight, for each unit
    if (slant < 0.05F || below <= 0.0F) continue;
    const float length = climb > 0.0F ? std::min(far, below / climb) : far;
    if (surface.sight->isBlocked(face.center, face.center - length * direction, clearance)) continue;
    shown += (away > 0.0F ? kFromBehind : 1.0F) * slant * (face.area / surface.area + 1.0F / count);
  }
  return shown;
}

glm::vec3 findDirection(const Surface& surface, const glm::vec3& up, float elevation, const glm::vec4& section) {
  const int axis = axisOf(up);
  glm::vec3 side(0.0F);
  side[(axis + 1) % 3] = 1.0F;
  side = glm::normalize(side - glm::dot(side, up) * up);
  const glm::vec3 across = glm::cross(up, side);
  struct View {
    glm::vec3 direction{0.0F};
    float shown = 0.0F;
  };
  std::array<View, kHeadings> views;
  for (std::size_t h = 0; h < kHeadings; ++h) {
    const float angle = glm::two_pi<float>() * static_cast<float>(h) / static_cast<float>(kHeadings);
    const glm::vec3 from = std::cos(angle) * side + std::sin(angle) * across;
    views[h].direction = -(std::cos(elevation) * from + std::sin(elevation) * up);
    views[h].shown = shownFrom(surface, views[h].direction, surface.faces.size() / kFewFaces + 1, section);
  }
  const auto shows_more = [](const View& a, const View& b) { return a.shown > b.shown; };
  std::stable_sort(views.begin(), views.end(), shows_more);
  const std::span<View> finalists = std::span(views).first(kFinalists);
  for (View& view : finalists) view.shown = shownFrom(surface, view.direction, 1, section);
  return std::max_element(finalists.begin(), finalists.end(),
                          [&](const View& a, const View& b) { return shows_more(b, a); })
      ->direction;
}

void findFirstView(const Surface& surface, InteriorChoice interior, bool has_passages, Orientation& out) {
  glm::vec4 section = base::kNoSection;
  float elevation = isFlat(surface.box.size(), axisOf(out.up)) ? kFlatElevation : kElevation;
  const bool is_along_axis = std::abs(out.up[axisOf(out.up)]) > 0.9999F;
  out.is_interior = interior == InteriorChoice::kOn;
  if (is_along_axis && interior != InteriorChoice::kOff) {
    const Rooms found = findRooms(surface, out.up, has_passages || out.is_interior);
    out.is_interior = out.is_interior || found.share > kCeilings;
    if (out.is_interior && !found.rooms.empty()) out.section_height = sectionHeight(surface, found.rooms, out.up);
  }
  if (out.section_height) {
    section = glm::vec4(out.up, *out.section_height);
    elevation = kFlatElevation;
  }
  out.direction = findDirection(surface, out.up, elevation, section);
}

}  // namespace

base::Result<Orientation> findOrientation(const PatchFile& patches, const glm::vec3* up, InteriorChoice interior) {
  LUMIGRID_ASSIGN_OR_RETURN(const Surface surface, coarseSurface(patches));
  Orientation found;
  found.reason = "nothing tells, and most models have it so";
  const Enclosure enclosure = surface.faces.empty() ? Enclosure() : enclosureOf(surface);
  found.is_enclosed = enclosure.isWhole();
  if (!surface.faces.empty()) findUp(surface, enclosure, found);
  if (up != nullptr) {
    found.up = *up;
    found.is_sure = true;
    found.reason = "it was said so";
  }
  if (!surface.faces.empty()) findFirstView(surface, interior, enclosure.hasPassages(), found);
  found.hull = findHull(surface.parts);
  return found;
}

}  // namespace lod::patch
