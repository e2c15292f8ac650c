#include "lod/qsplat/traverse.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <utility>

namespace lod::qsplat {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
// Subtrees to cut off, and pieces of them to hand out: enough to keep many cores evenly busy, few enough to cost
// nothing.
constexpr std::size_t kSubtrees = 512;
constexpr std::size_t kPieces = 64;
// Groups between two looks at how many nodes all threads together have met.
constexpr std::uint32_t kGroupsPerLook = 1024;

constexpr float kLensMagnifies = 3.0F;
constexpr float kFinestThroughLens = 0.5F;  // pixels; smaller splats look the same

// The six planes of the frustum and the section's.
constexpr std::size_t kPlanes = 7;
constexpr std::uint32_t kAllSides = 0x3F;
constexpr std::uint32_t kSectionSide = 0x40;

/// What all nodes are judged by. Parallel views fit the same formulas: there every depth is 1 and the eye is a
/// direction.
struct View {
  std::array<glm::vec4, kPlanes> planes;  ///< normals inside, unit
  std::uint32_t sides = 0;                ///< planes that nodes are tested against
  glm::vec4 eye{0.0F};                    ///< homogeneous
  glm::vec4 depth{0.0F};                  ///< depth of p = dot(depth.xyz, p) + depth.w
  glm::mat4 clip{1.0F};                   ///< from the scene
  float fineness = 0.0F;                  ///< a node is fine enough where radius · fineness <= depth
  float lens_fineness = 0.0F;             ///< the same of what is seen through the lens
  bool cull_back_faces = false;

  explicit View(const TraverseRequest& request) {
    clip = request.camera.clipFromScene();
    const base::Frustum frustum(clip);
    std::copy(frustum.planes.begin(), frustum.planes.end(), planes.begin());
    planes[kPlanes - 1] = glm::vec4(-glm::vec3(request.section), request.section.w);
    const bool cut = glm::vec3(request.section) != glm::vec3(0.0F);
    sides = (request.cull ? kAllSides : 0U) | (cut ? kSectionSide : 0U);
    cull_back_faces = request.cull_back_faces && !cut;
    eye = request.camera.homogeneousEye();
    depth = glm::vec4(clip[0][3], clip[1][3], clip[2][3], clip[3][3]);
    fineness = 2.0F * request.camera.pixelsPerUnitAtOne() / request.cutoff_px;
    lens_fineness = 2.0F * request.camera.pixelsPerUnitAtOne() / cutoffThroughLens(request.cutoff_px);
  }
};

/// A group of siblings that is to be looked into.
struct Group {
  const std::uint8_t* bytes = nullptr;
  std::uint64_t offset = 0;  ///< in the file
  base::Sphere parent;
  std::uint32_t nodes = 0;
  std::uint32_t level = 0;
  std::uint32_t sides = 0;  ///< planes that cross the parent
  bool has_pointer = false;
  bool may_face_away = false;
};

/// Squared, and a hair more: rounding must not turn anything away. Any direction: never reached.
ConeSines squared(ConeSines sines) {
  for (float& sine : sines) sine *= sine * (1.0F + 1e-5F);
  return sines;
}

/// Nodes that all threads together have met: a tree has as many as its header says, and what has more goes round in
/// circles.
struct Budget {
  std::atomic<std::uint64_t> nodes{0};
  std::uint64_t most = 0;
};

class Walk {
 public:
  Walk(Blocks& blocks, const TraverseRequest& request, const Priority& priority, Budget& budget, Traversal empty)
      : blocks_(blocks),
        header_(blocks.header()),
        layout_(header_),
        camera_(request.camera),
        lens_(request.lens),
        view_(request),
        priority_(priority),
        budget_(budget),
        found_(std::move(empty)) {}

  /// The root's group; without block 1 it is wanted, and nothing is returned.
  std::vector<Group> begin() {
    const std::uint8_t* block = blocks_.find(1);
    if (block == nullptr) {
      found_.wanted.push_back({1, kInfinity});
      return {};
    }
    const bool has_pointer = header_.nodes > 1;
    return {{block, kBlockBytes, header_.root, 1, 0, view_.sides, has_pointer, view_.cull_back_faces}};
  }

  /// Level by level until there are many groups; these are left.
  std::vector<Group> cutOff(std::vector<Group> groups) {
    while (!groups.empty() && groups.size() < kSubtrees) {
      for (const Group& group : groups) look(group);
      groups = std::exchange(stack_, {});
    }
    return groups;
  }

  void walk(const Group& top) {
    stack_.assign(1, top);
    std::uint32_t until_look = kGroupsPerLook;
    while (!stack_.empty()) {
      const Group group = stack_.back();
      stack_.pop_back();
      look(group);
      if (--until_look != 0) continue;
      until_look = kGroupsPerLook;
      if (spendBudget()) break;
    }
    spendBudget();
  }

  /// All that was found, in the order in which it was.
  Traversal take() { return std::move(found_); }

 private:
  bool spendBudget() {
    const std::uint64_t met = found_.nodes - std::exchange(spent_, found_.nodes);
    const bool over = budget_.nodes.fetch_add(met, std::memory_order_relaxed) + met > budget_.most;
    found_.damaged |= over;
    return over;
  }

  // Where the next of the groups of children lies: they follow each other in the order of their parents.
  struct ChildPlaces {
    std::uint64_t end = 0;
    std::uint64_t next(std::uint32_t bytes) {
      const std::uint64_t at = groupPlace(end, bytes);
      end = at + bytes;
      return at;
    }
  };

  void look(const Group& group) {
    found_.nodes += group.nodes;
    ChildPlaces places{group.has_pointer ? readPointer(group.bytes, group.nodes, layout_) : 0};
    if (group.has_pointer && places.end <= group.offset) {
      found_.damaged = true;
      places.end = header_.file_bytes;  // where nothing can be
    }
    for (std::uint32_t i = 0; i < group.nodes; ++i) {
      const Node node = readNode(group.bytes, i, layout_);
      const bool inner = group.has_pointer && !node.isLeaf();
      found_.damaged |= group.has_pointer ? !node.valid() : !node.hasCodes();
      const std::uint64_t child = inner ? places.next(layout_.childBytes(node)) : 0;
      consider(group, node, child);
    }
  }

  // child: offset of the group of its children; 0: a leaf.
  void consider(const Group& group, const Node& node, std::uint64_t child) {
    const base::Sphere sphere = decodeSphere(group.parent, spheres_[node.sphereCode()]);

    std::uint32_t sides = group.sides;
    if (sides != 0 && outside(sphere, sides)) {
      ++found_.outside;
      return;
    }
    bool may_face_away = group.may_face_away;
    if (may_face_away && facesAway(sphere, node, group.has_pointer ? sines_ : leaf_sines_, may_face_away)) {
      ++found_.facing_away;
      return;
    }

    if (child == 0) return draw(sphere, node, Splat::kLeaf);
    if (isFineEnough(sphere)) return draw(sphere, node, 0);
    descend(group, node, sphere, child, sides, may_face_away);
  }

  // Takes the planes that the sphere is wholly inside of out of `sides`.
  bool outside(const base::Sphere& sphere, std::uint32_t& sides) const {
    for (std::uint32_t left = sides; left != 0; left &= left - 1) {
      const std::uint32_t side = left & (~left + 1);
      const glm::vec4& plane = view_.planes[static_cast<std::size_t>(__builtin_ctz(left))];
      const float distance = glm::dot(glm::vec3(plane), sphere.center) + plane.w;
      if (distance < -sphere.radius) return true;
      if (distance > sphere.radius) sides &= ~side;
    }
    return false;
  }

  // With v from the eye to the centre and a the cone's half-angle: all of the surface in the sphere is turned away
  // where n·v − R > |v| sin a, and all of it faces the eye where −n·v − R > |v| sin a. (A direction at an angle of at
  // most a from n makes at least |v| cos(t + a) with v, t being n's angle; that is no less than |v| (cos t − sin a)
  // where cos t >= sin a, and elsewhere the test fails.) What faces the eye wholly has children that need not be asked.
  bool facesAway(const base::Sphere& sphere, const Node& node, const ConeSines& sines, bool& may_face_away) const {
    const glm::vec3 v = view_.eye.w * sphere.center - glm::vec3(view_.eye);
    const float along = glm::dot(normals_[node.normalCode()], v);
    const float beyond = std::abs(along) - view_.eye.w * sphere.radius;
    if (!(beyond > 0.0F) || !(beyond * beyond > sines[node.coneField()] * glm::dot(v, v))) return false;
    if (along > 0.0F) return true;
    may_face_away = false;
    return false;
  }

  bool isFineEnough(const base::Sphere& sphere) const {
    const float depth = glm::dot(glm::vec3(view_.depth), sphere.center) + view_.depth.w;
    if (sphere.radius * view_.fineness > depth) return false;
    if (!lens_ || sphere.radius * view_.lens_fineness <= depth) return true;
    const Projection seen = project(sphere);
    return !isSeenThrough(*lens_, seen.at_px, seen.size_px);
  }

  struct Projection {
    float size_px = kInfinity;
    glm::vec2 at_px{0.0F};
  };
  Projection project(const base::Sphere& sphere) const {
    const glm::vec4 clip = view_.clip * glm::vec4(sphere.center, 1.0F);
    if (!(clip.w > 0.0F)) return {};
    return {2.0F * sphere.radius * camera_.pixelsPerUnitAtOne() / clip.w,
            glm::vec2(0.5F * (1.0F + clip.x / clip.w) * static_cast<float>(camera_.width),
                      0.5F * (1.0F - clip.y / clip.w) * static_cast<float>(camera_.height))};
  }

  void draw(const base::Sphere& sphere, const Node& node, std::uint16_t flags) {
    found_.splats.push_back({sphere.center, sphere.radius, static_cast<std::uint16_t>(node.normalCode() | flags),
                             header_.colors ? node.color : kWhite565});
  }

  void descend(const Group& group, const Node& node, const base::Sphere& sphere, std::uint64_t child,
               std::uint32_t sides, bool may_face_away) {
    const std::uint64_t number = child / kBlockBytes;
    if (number >= header_.blocks() || group.level + 1 >= kMaxLevels) {
      found_.damaged = true;
      return draw(sphere, node, Splat::kStandIn);
    }
    const std::uint8_t* block = blocks_.find(number);
    if (block == nullptr) {
      want(number, sphere, group.level);
      return draw(sphere, node, Splat::kStandIn);
    }
    const std::uint8_t* bytes = block + child % kBlockBytes;
    __builtin_prefetch(bytes);
    stack_.push_back(
        {bytes, child, sphere, node.children(), group.level + 1, sides, !node.childrenAreLeaves(), may_face_away});
  }

  void want(std::uint64_t number, const base::Sphere& sphere, std::uint32_t level) {
    const Projection seen = project(sphere);
    float priority = priority_({number, level, sphere.radius, seen.size_px, seen.at_px});
    if (std::isnan(priority))
      priority = -kInfinity;  // of a file whose spheres are no places; it must not spoil the order
    // Neighbours tend to want the same block.
    if (!found_.wanted.empty() && found_.wanted.back().block == number)
      found_.wanted.back().priority = std::max(found_.wanted.back().priority, priority);
    else
      found_.wanted.push_back({number, priority});
  }

  Blocks& blocks_;
  const Header& header_;
  const GroupLayout layout_;
  const base::Camera& camera_;
  const std::optional<Lens>& lens_;
  const View view_;
  const Priority& priority_;
  Budget& budget_;
  const SphereTable& spheres_ = sphereTable();
  const NormalTable& normals_ = normalTable();
  const ConeSines sines_ = squared(coneSines(true));
  const ConeSines leaf_sines_ = squared(coneSines(false));
  std::vector<Group> stack_;
  Traversal found_;  ///< `wanted` not settled yet
  std::uint64_t spent_ = 0;
};

/// Nothing, with the memory of what was there.
Traversal recycled(Traversal& used) {
  Traversal empty;
  empty.splats = std::move(used.splats);
  empty.wanted = std::move(used.wanted);
  empty.splats.clear();
  empty.wanted.clear();
  return empty;
}

/// One part behind the other; splats in parallel, into memory of `result` that is not cleared first.
void concatenate(const std::vector<Traversal>& parts, const ForEach& for_each, Traversal& result) {
  std::vector<std::size_t> begins;
  std::size_t splats = 0;
  Traversal sums;
  for (const Traversal& part : parts) {
    begins.push_back(splats);
    splats += part.splats.size();
    sums.wanted.insert(sums.wanted.end(), part.wanted.begin(), part.wanted.end());
    sums.nodes += part.nodes;
    sums.outside += part.outside;
    sums.facing_away += part.facing_away;
    sums.damaged |= part.damaged;
  }
  sums.splats = std::move(result.splats);
  sums.splats.resize(splats);
  for_each(parts.size(), [&](std::size_t i) {
    std::copy(parts[i].splats.begin(), parts[i].splats.end(),
              sums.splats.begin() + static_cast<std::ptrdiff_t>(begins[i]));
  });
  result = std::move(sums);
}

// Each block once, the most urgent first.
void settle(std::vector<WantedBlock>& wanted) {
  const auto urgent = [](const WantedBlock& a, const WantedBlock& b) {
    return a.priority != b.priority ? a.priority > b.priority : a.block < b.block;
  };
  std::sort(wanted.begin(), wanted.end(), [&](const WantedBlock& a, const WantedBlock& b) {
    return a.block != b.block ? a.block < b.block : urgent(a, b);
  });
  wanted.erase(std::unique(wanted.begin(), wanted.end(),
                           [](const WantedBlock& a, const WantedBlock& b) { return a.block == b.block; }),
               wanted.end());
  std::sort(wanted.begin(), wanted.end(), urgent);
}

}  // namespace

bool isSeenThrough(const Lens& lens, const glm::vec2& at_px, float size_px) {
  if (!(size_px < kInfinity)) return true;  // around the eye: anywhere on the screen
  const float reach = lens.radius_px + 0.5F * size_px;
  const glm::vec2 off = at_px - lens.center_px;
  return glm::dot(off, off) <= reach * reach;
}

float cutoffThroughLens(float cutoff_px) {
  return std::min(cutoff_px, std::max(cutoff_px / kLensMagnifies, kFinestThroughLens));
}

Priority sweepPriority(int picture_height) {
  const float height = static_cast<float>(std::max(picture_height, 1));
  return [height](const MissingChildren& missing) {
    if (!(missing.size_px < kInfinity)) return kInfinity;
    const float up = std::clamp(1.0F - missing.at_px.y / height, 0.0F, 0.999F);
    return std::ceil(2.0F * std::log2(std::max(missing.size_px, 1e-6F))) * 1000.0F + 1000.0F * up;
  };
}

float projectedDiameter(const glm::vec3& center, float radius, const base::Camera& camera) {
  const glm::mat4 clip = camera.clipFromScene();
  const float depth = clip[0][3] * center.x + clip[1][3] * center.y + clip[2][3] * center.z + clip[3][3];
  return depth > 0.0F ? 2.0F * radius * camera.pixelsPerUnitAtOne() / depth : kInfinity;
}

void traverse(Blocks& blocks, const TraverseRequest& request, Traversal& result) {
  const Priority priority = request.priority ? request.priority : sweepPriority(request.camera.height);
  Budget budget;
  budget.most = blocks.header().nodes;

  // What is found above the subtrees comes first, then theirs in their order, whoever walks them.
  Walk top(blocks, request, priority, budget, request.for_each ? Traversal() : recycled(result));
  const std::vector<Group> subtrees = top.cutOff(top.begin());
  if (!request.for_each) {
    for (const Group& subtree : subtrees) top.walk(subtree);
    result = top.take();
  } else {
    const std::size_t pieces = std::min(subtrees.size(), kPieces);
    std::vector<Traversal> parts(1 + pieces);
    parts[0] = top.take();
    request.for_each(pieces, [&](std::size_t i) {
      Walk walk(blocks, request, priority, budget, {});
      for (std::size_t s = i * subtrees.size() / pieces; s < (i + 1) * subtrees.size() / pieces; ++s)
        walk.walk(subtrees[s]);
      parts[1 + i] = walk.take();
    });
    concatenate(parts, request.for_each, result);
  }
  settle(result.wanted);
}

Traversal traverse(Blocks& blocks, const TraverseRequest& request) {
  Traversal result;
  traverse(blocks, request, result);
  return result;
}

}  // namespace lod::qsplat
