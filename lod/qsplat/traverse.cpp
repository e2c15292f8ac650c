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
// Subtrees into which the tree is divided, and portions of them for threads: enough to keep many cores evenly busy, few
// enough to cost nothing.
constexpr std::size_t kSubtrees = 512;
constexpr std::size_t kPortions = 64;
// Groups that a thread visits between two checks of how many nodes all threads have visited. A choice: a traversal may
// exceed its limit by so many groups a thread, and each check shares one counter.
constexpr std::uint32_t kGroupsPerCheck = 1024;

// The cut-off inside of the magnifying glass is finer by this factor. A choice: a larger one needs more blocks for it.
constexpr float kLensMagnifies = 3.0F;
constexpr float kFinestThroughLens = 0.5F;  // pixels; smaller splats look the same

// The frustum's six planes and the section's plane.
constexpr std::size_t kPlanes = 7;
constexpr std::uint32_t kAllSides = 0x3F;
constexpr std::uint32_t kSectionSide = 0x40;

/// The view, prepared for testing nodes. The same formulas serve parallel views: every depth is 1 there, and the eye is
/// a direction.
struct NodeTests {
  std::array<glm::vec4, kPlanes> planes;  ///< unit normals that point inside
  std::uint32_t sides = 0;                ///< planes that nodes are tested against
  glm::vec4 eye{0.0F};                    ///< homogeneous
  glm::vec4 depth{0.0F};                  ///< depth of p = dot(depth.xyz, p) + depth.w
  glm::mat4 clip{1.0F};                   ///< from the scene
  float fineness = 0.0F;                  ///< a node is fine enough where radius · fineness <= depth
  float lens_fineness = 0.0F;             ///< the same for nodes seen through the lens
  bool cull_back_faces = false;

  explicit NodeTests(const TraverseRequest& request) {
    clip = request.camera.clipFromScene();
    const base::Frustum frustum(clip);
    std::copy(frustum.planes.begin(), frustum.planes.end(), planes.begin());
    planes[kPlanes - 1] = glm::vec4(-glm::vec3(request.camera.section), request.camera.section.w);
    const bool cut = request.camera.hasSection();
    sides = (request.cull ? kAllSides : 0U) | (cut ? kSectionSide : 0U);
    cull_back_faces = request.cull_back_faces && !cut;
    eye = request.camera.homogeneousEye();
    depth = glm::vec4(clip[0][3], clip[1][3], clip[2][3], clip[3][3]);
    fineness = 2.0F * request.camera.pixelsPerUnitAtOne() / request.cutoff_px;
    lens_fineness = 2.0F * request.camera.pixelsPerUnitAtOne() / cutoffThroughLens(request.cutoff_px);
  }
};

/// A group of siblings that is to be visited.
struct PendingGroup {
  const std::uint8_t* bytes = nullptr;
  std::uint64_t offset = 0;  ///< in the plain file
  base::Sphere parent;
  std::uint32_t nodes = 0;
  std::uint32_t level = 0;
  std::uint32_t sides = 0;  ///< planes that intersect the parent
  bool has_pointer = false;
  bool may_face_away = false;
};

/// Returns the squared sines, slightly enlarged so that rounding never culls a visible node.
ConeSines squared(ConeSines sines) {
  for (float& sine : sines) sine *= sine * (1.0F + 1e-5F);
  return sines;
}

/// Counts the nodes that all threads visit. A tree has as many as its header says; more of them mean a cycle.
struct NodeBudget {
  std::atomic<std::uint64_t> nodes{0};
  std::uint64_t limit = 0;
};

class Walk {
 public:
  Walk(Blocks& blocks, const TraverseRequest& request, const Priority& priority, NodeBudget& budget, Traversal empty)
      : blocks_(blocks),
        header_(blocks.header()),
        layout_(header_),
        camera_(request.camera),
        lens_(request.lens),
        view_(request),
        priority_(priority),
        budget_(budget),
        found_(std::move(empty)) {}

  /// Returns the root's group; nothing without block 1, which is wanted then.
  std::vector<PendingGroup> rootGroup() {
    const std::uint8_t* block = blocks_.find(1);
    if (block == nullptr) {
      found_.wanted.push_back({1, kInfinity});
      return {};
    }
    const bool has_pointer = header_.nodes > 1;
    return {{block, kBlockBytes, header_.root, 1, 0, view_.sides, has_pointer, view_.cull_back_faces}};
  }

  /// Visits level by level until there are many groups, and returns these.
  std::vector<PendingGroup> splitIntoSubtrees(std::vector<PendingGroup> groups) {
    while (!groups.empty() && groups.size() < kSubtrees) {
      for (const PendingGroup& group : groups) visit(group);
      groups = std::exchange(stack_, {});
    }
    return groups;
  }

  void walk(const PendingGroup& top) {
    stack_.assign(1, top);
    std::uint32_t until_check = kGroupsPerCheck;
    while (!stack_.empty()) {
      const PendingGroup group = stack_.back();
      stack_.pop_back();
      visit(group);
      if (--until_check != 0) continue;
      until_check = kGroupsPerCheck;
      if (spendBudget()) break;
    }
    spendBudget();
  }

  /// Returns everything found so far, in order.
  Traversal takeResult() { return std::move(found_); }

 private:
  bool spendBudget() {
    const std::uint64_t met = found_.nodes - std::exchange(spent_, found_.nodes);
    const bool over = budget_.nodes.fetch_add(met, std::memory_order_relaxed) + met > budget_.limit;
    found_.damaged |= over;
    return over;
  }

  // Computes the places of a group's child groups, which follow each other in the order of their parents.
  struct ChildPlaces {
    std::uint64_t end = 0;
    std::uint64_t next(std::uint32_t bytes) {
      const std::uint64_t at = groupPlace(end, bytes);
      end = at + bytes;
      return at;
    }
  };

  void visit(const PendingGroup& group) {
    found_.nodes += group.nodes;
    ChildPlaces places{group.has_pointer ? readPointer(group.bytes, group.nodes, layout_) : 0};
    if (group.has_pointer && places.end <= group.offset) {
      found_.damaged = true;
      places.end = header_.file_bytes;  // no group can be there
    }
    for (std::uint32_t i = 0; i < group.nodes; ++i) {
      const Node node = readNode(group.bytes, i, layout_);
      const bool inner = group.has_pointer && !node.isLeaf();
      found_.damaged |= group.has_pointer ? !node.valid() : !node.hasCodes();
      const std::uint64_t child = inner ? places.next(layout_.childBytes(node)) : 0;
      visitNode(group, node, child);
    }
  }

  // Draws, skips or refines a node. child: offset of its child group; 0 for a leaf.
  void visitNode(const PendingGroup& group, const Node& node, std::uint64_t child) {
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

    if (child == 0) return emit(sphere, node, Splat::kLeaf);
    if (isFineEnough(sphere)) return emit(sphere, node, 0);
    descend(group, node, sphere, child, sides, may_face_away);
  }

  // Whether the sphere is outside a plane. Removes the planes that it is wholly inside of from `sides`.
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

  // Let v be the vector from the eye to the centre and a the cone's half-angle. All of the surface in the sphere faces
  // away where n·v − R > |v| sin a, and all of it faces the eye where −n·v − R > |v| sin a. (A direction at an angle of
  // at most a from n has a dot product of at least |v| cos(t + a) with v, t being n's angle; that is no less than |v|
  // (cos t − sin a) where cos t >= sin a, and elsewhere the test fails.) Children of a node that wholly faces the eye
  // need not be tested.
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

  void emit(const base::Sphere& sphere, const Node& node, std::uint16_t flags) {
    found_.splats.push_back({sphere.center, sphere.radius, static_cast<std::uint16_t>(node.normalCode() | flags),
                             header_.colors ? node.color : kWhite565});
  }

  void descend(const PendingGroup& group, const Node& node, const base::Sphere& sphere, std::uint64_t child,
               std::uint32_t sides, bool may_face_away) {
    const std::uint64_t number = child / kBlockBytes;
    if (number >= header_.blocks() || group.level + 1 >= kMaxLevels) {
      found_.damaged = true;
      return emit(sphere, node, Splat::kStandIn);
    }
    const std::uint8_t* block = blocks_.find(number);
    if (block == nullptr) {
      addWanted(number, sphere, group.level);
      return emit(sphere, node, Splat::kStandIn);
    }
    const std::uint8_t* bytes = block + child % kBlockBytes;
    __builtin_prefetch(bytes);
    stack_.push_back(
        {bytes, child, sphere, node.children(), group.level + 1, sides, !node.childrenAreLeaves(), may_face_away});
  }

  void addWanted(std::uint64_t number, const base::Sphere& sphere, std::uint32_t level) {
    const Projection seen = project(sphere);
    float priority = priority_({number, level, sphere.radius, seen.size_px, seen.at_px});
    if (std::isnan(priority))
      priority = -kInfinity;  // from a damaged file with infinite spheres; NaN would break the order
    // Neighbouring nodes often want the same block.
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
  const NodeTests view_;
  const Priority& priority_;
  NodeBudget& budget_;
  const SphereTable& spheres_ = sphereTable();
  const NormalTable& normals_ = normalTable();
  const ConeSines sines_ = squared(coneSines(true));
  const ConeSines leaf_sines_ = squared(coneSines(false));
  std::vector<PendingGroup> stack_;
  Traversal found_;  ///< `wanted` is not sorted yet
  std::uint64_t spent_ = 0;
};

/// Returns an empty traversal with the memory of a used one.
Traversal recycled(Traversal& used) {
  Traversal empty;
  empty.splats = std::move(used.splats);
  empty.wanted = std::move(used.wanted);
  empty.splats.clear();
  empty.wanted.clear();
  return empty;
}

/// Joins the parts in their order; splats are copied in parallel into the memory of `result`.
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

// Removes duplicates and sorts by priority.
void sortWanted(std::vector<WantedBlock>& wanted) {
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
  if (!(size_px < kInfinity)) return true;  // around the eye: seen everywhere
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

void traverse(Blocks& blocks, const TraverseRequest& request, Traversal& result) {
  const Priority priority = request.priority ? request.priority : sweepPriority(request.camera.height);
  NodeBudget budget;
  budget.limit = blocks.header().nodes;

  // The result starts with what was found above the subtrees, then has theirs in their order, whichever thread found
  // it.
  Walk top(blocks, request, priority, budget, request.for_each ? Traversal() : recycled(result));
  const std::vector<PendingGroup> subtrees = top.splitIntoSubtrees(top.rootGroup());
  if (!request.for_each) {
    for (const PendingGroup& subtree : subtrees) top.walk(subtree);
    result = top.takeResult();
  } else {
    const std::size_t portions = std::min(subtrees.size(), kPortions);
    std::vector<Traversal> parts(1 + portions);
    parts[0] = top.takeResult();
    request.for_each(portions, [&](std::size_t i) {
      Walk walk(blocks, request, priority, budget, {});
      for (std::size_t s = i * subtrees.size() / portions; s < (i + 1) * subtrees.size() / portions; ++s)
        walk.walk(subtrees[s]);
      parts[1 + i] = walk.takeResult();
    });
    concatenate(parts, request.for_each, result);
  }
  sortWanted(result.wanted);
}

Traversal traverse(Blocks& blocks, const TraverseRequest& request) {
  Traversal result;
  traverse(blocks, request, result);
  return result;
}

}  // namespace lod::qsplat
