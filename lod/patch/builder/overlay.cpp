#include "lod/patch/builder/overlay.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include "base/check.h"

namespace lod::patch::builder {
namespace {

// Triangles beyond these limits stay uncovered, and their distance is measured by projection. More is seldom needed
// where one surface was simplified from the other. The limits are choices: larger ones cover more of odd triangles and
// take longer for them.
constexpr int kMaxSteps = 64;             // facets on the way of an edge
constexpr std::size_t kMaxLink = 48;      // facets that are searched for a link of two
constexpr std::size_t kMaxCut = 96;       // edges below that a triangle cuts
constexpr std::size_t kMaxEnclosed = 24;  // vertices below that a triangle encloses
constexpr int kMaxBorder = 8;             // border edges below along one above
// Two edges whose squared sine is below this, at less than 0.6 degrees, count as parallel. The limit is a choice: with
// a smaller one, crossings are used that rounding has moved farther.
constexpr float kParallel = 1e-4F;
// An edge whose squared cosine with a facet is at least this, within 30 degrees, runs along it; no other facet is
// asked. A choice: a smaller limit asks fewer facets and may take one that fits worse.
constexpr float kClear = 0.75F;
// covered_ends_ of a border edge that walks cover from end to end, and of one that a walk ends on.
constexpr std::uint8_t kBothEnds = 3;
constexpr std::uint8_t kNeverCovered = 4;
// On either side of a cut so many vertices are tried before one side is followed to the limit. A choice, which decides
// only how much of the longer side is looked at in vain.
constexpr std::size_t kFew = 3;

bool contains(const std::vector<std::uint32_t>& list, std::uint32_t x) {
  return std::find(list.begin(), list.end(), x) != list.end();
}

}  // namespace

void Overlay::compute(FacetSurface& above, FacetSurface& below, std::span<const std::uint32_t> facet_of,
                      std::span<const Gap> gap_of, std::span<const std::uint32_t> twin_of,
                      std::span<const std::uint32_t> border_of) {
  above_ = &above, below_ = &below;
  facet_of_ = facet_of, gap_of_ = gap_of, twin_of_ = twin_of, border_of_ = border_of;
  has_color_ = !above.view().colors.empty() && !below.view().colors.empty();
  // Walks along a border and into the surface begin in one facet.
  for (std::uint32_t v = 0; v < border_of.size(); ++v)
    LUMIGRID_CHECK(border_of[v] == kNone || facet_of[v] == below.edges()[border_of[v]].triangle[0]);
  crossed_.clear(), crossings_.clear();
  turns_.clear();
  paths_.resize(above.edges().size());
  for (std::uint32_t e = 0; e < paths_.size(); ++e) walkEdge(e, paths_[e]);
  measureCrossings();

  const std::uint32_t triangles = above.triangleCount();
  is_good_.assign(triangles, 0);
  distance_.assign(triangles, 0.0F);
  is_cut_.assign(below.edges().size(), 0);
  is_enclosed_.assign(below.view().positions.size(), 0);
  is_turned_.assign(below.edges().size(), 0);
  enclosed_.clear(), corner_facets_.clear();
  first_enclosed_.resize(triangles + 1);
  first_corner_facet_.resize(triangles + 1);
  for (std::uint32_t s = 0; s < triangles; ++s) {
    first_enclosed_[s] = static_cast<std::uint32_t>(enclosed_.size());
    first_corner_facet_[s] = static_cast<std::uint32_t>(corner_facets_.size());
    is_good_[s] = encloseVertices(s) ? 1 : 0;
    if (is_good_[s] == 0) {
      enclosed_.resize(first_enclosed_[s]);
      corner_facets_.resize(first_corner_facet_[s]);
      continue;
    }
    for (std::size_t i = first_enclosed_[s]; i < enclosed_.size(); ++i) is_enclosed_[enclosed_[i].vertex] ^= 1;
    for (const CornerTurn& corner : corners_) is_turned_[corner.edge] ^= endBit(corner.edge, corner.vertex);
  }
  first_enclosed_[triangles] = static_cast<std::uint32_t>(enclosed_.size());
  first_corner_facet_[triangles] = static_cast<std::uint32_t>(corner_facets_.size());
  findUncovered();
}

// Walks from facet to facet along the edge, out over the wall that it meets first, to the facet of its other end.
void Overlay::walkEdge(std::uint32_t e, Path& path) {
  const FacetSurface::Edge& edge = above_->edges()[e];
  const auto [a, b] = edge.vertex;
  walked_ = e;
  origin_ = above_->view().positions[a];
  whole_ = above_->view().positions[b] - origin_;
  length2_ = glm::dot(whole_, whole_);
  path = {facet_of_[a], facet_of_[b], static_cast<std::uint32_t>(crossings_.size()), 0, 0.0F, true, false};
  path.last = path.first;
  if (edge.triangles == 1 && border_of_[a] != kNone && border_of_[b] != kNone && walkBorder(e, path)) return;
  const std::uint32_t twin_a = twin_of_[a];
  const std::uint32_t twin_b = twin_of_[b];
  if (twin_a != kNone && twin_b != kNone && findSameEdge(e, path)) return;

  // From a vertex that both surfaces have the walk leaves by any facet there, and it may arrive at one by any.
  if (twin_a != kNone) path.start = facetToward(twin_a);
  const Goal goal{facet_of_[b], twin_b};
  const glm::vec3 origin = origin_;
  const glm::vec3 whole = whole_;
  std::uint32_t t = path.start;
  std::uint32_t came_over = kNone;
  float along = 0.0F;
  for (int step = 0; !isReached(goal, t); ++step) {
    const Facet& facet = below_->facet(t);
    std::size_t out = 3;
    float first = std::numeric_limits<float>::max();
    if (!facet.flat) {
      const Facet::Four from = facet.inside(origin);
      const Facet::Four to = from + facet.planes.dot(whole);
      // Walls that the edge starts beyond come before all others, the farthest first.
      const Facet::Four when = from <= 0.0F ? from : from / (from - to);
      const auto over = below_->edgesOf(t);
      std::uint32_t walls = Facet::wallsWhere(to < 0.0F);
      for (std::size_t k = 0; k < 3; ++k) walls &= ~(static_cast<std::uint32_t>(over[k] == came_over) << k);
      for (; walls != 0; walls &= walls - 1) {
        const auto k = static_cast<std::size_t>(std::countr_zero(walls));
        // There is nothing beyond a border, so the walk stays in its facet.
        const FacetSurface::Edge& wall = below_->edges()[over[k]];
        if (!wall.isInner() || wall.endsAt(twin_a)) continue;
        if (when[k] < first) first = when[k], out = k;
      }
    }
    if (out == 3 || step == kMaxSteps) {
      // The edge ends over another facet than its end does: in a fold, over a ridge, near a border, or over a facet
      // without area.
      path.arrives = linkFacets(t, goal, step < kMaxSteps && !facet.flat ? 1.0F : along);
      break;
    }
    along = std::max(along, std::clamp(first, 0.0F, 1.0F));
    came_over = below_->edgeOf(t, out);
    t = below_->edges()[came_over].across(t);
    addCrossing(came_over, t, along);
  }
  path.last = static_cast<std::uint32_t>(crossings_.size());
  if (path.last != path.first)
    path.end = crossings_.back().facet;
  else
    path.end = path.start;
}

// The facet around vertex v below whose plane holds the edge above best.
std::uint32_t Overlay::facetToward(std::uint32_t v) {
  const auto before = [](std::size_t k) { return k == 0 ? 2 : k - 1; };
  // Whether the edge runs between both walls at corner k.
  const auto runsOver = [&](const Facet& facet, const Facet::Four& rise, std::size_t k) {
    const std::uint32_t both = 1U << k | 1U << before(k);
    return !facet.flat && (Facet::wallsWhere(rise >= 0.0F) & both) == both;
  };
  // Returns the squared length of the edge's projection on the facet's plane.
  const auto shadow2On = [&](const Facet::Four& rise) { return length2_ - rise[3] * rise[3]; };
  // Mostly one facet is clear.
  for (const std::uint32_t t : below_->around(v)) {
    const Facet& facet = below_->facet(t);
    const Facet::Four rise = facet.planes.dot(whole_);
    if (runsOver(facet, rise, below_->cornerOf(t, v)) && shadow2On(rise) > kClear * length2_) return t;
  }
  std::uint32_t best = kNone;
  float most = -1.0F;
  for (const std::uint32_t t : below_->around(v)) {
    const Facet& facet = below_->facet(t);
    const std::size_t k = below_->cornerOf(t, v);
    float shadow2 = 0.0F;
    if (const Facet::Four rise = facet.planes.dot(whole_); runsOver(facet, rise, k)) {
      shadow2 = shadow2On(rise);
    } else {
      for (const std::size_t other : {k == 2 ? 0 : k + 1, before(k)}) {
        const glm::vec3 side = facet.corner(other) - facet.corner(k);
        const float ahead = std::max(0.0F, glm::dot(side, whole_));
        shadow2 = std::max(shadow2, ahead * ahead / glm::dot(side, side));
      }
    }
    if (shadow2 > most) most = shadow2, best = t;
  }
  return best;
}

// Walks along the border below from end to end: from a vertex that both surfaces have, or a point of a border edge,
// around the vertices between. Each of these is paired with the nearest point of the edge above, and so are the ends of
// all edges there, so nothing stays uncovered between the two borders.
bool Overlay::walkBorder(std::uint32_t e, Path& path) {
  const auto [a, b] = above_->edges()[e].vertex;
  if (twin_of_[a] != kNone && twin_of_[b] != kNone) {
    if (const std::uint32_t same = borderBetween(twin_of_[a], twin_of_[b]); same != kNone)
      return walkBorderFrom(e, same, below_->edges()[same].otherEnd(twin_of_[a]), path);
  }
  const bool ahead = above_->borderStart(e) == a;
  for (const bool way : {ahead, !ahead}) {
    std::uint32_t at = border_of_[a];
    if (twin_of_[a] != kNone) at = way ? below_->leavingBorder(twin_of_[a]) : below_->arrivingBorder(twin_of_[a]);
    if (at == kNone) continue;
    const std::uint32_t start = below_->borderStart(at);
    if (walkBorderFrom(e, at, way ? below_->edges()[at].otherEnd(start) : start, path)) return true;
  }
  return false;
}

// The border edge below between these two vertices, or kNone.
std::uint32_t Overlay::borderBetween(std::uint32_t v, std::uint32_t w) const {
  for (const std::uint32_t t : below_->around(v))
    for (std::size_t k = 0; k < 3; ++k) {
      const FacetSurface::Edge& edge = below_->edges()[below_->edgeOf(t, k)];
      if (edge.triangles == 1 && edge.endsAt(v) && edge.endsAt(w)) return below_->edgeOf(t, k);
    }
  return kNone;
}

// Walks from border edge `at` on by its end v. False, with nothing changed, if the other end of the edge above is not
// met.
bool Overlay::walkBorderFrom(std::uint32_t e, std::uint32_t at, std::uint32_t v, Path& path) {
  const FacetSurface::Edge& edge = above_->edges()[e];
  const auto [a, b] = edge.vertex;
  const std::size_t first_turn = turns_.size();
  const auto giveUp = [&] {
    crossed_.resize(path.first), crossings_.resize(path.first);
    turns_.resize(first_turn);
    path.distance = 0.0F;
    return false;
  };
  const auto crossed = [&] { return static_cast<std::uint32_t>(crossings_.size()); };
  const std::uint32_t start = below_->edges()[at].triangle[0];
  if (twin_of_[a] != kNone) turns_.push_back({e, twin_of_[a], at, kNone, path.first, path.first});
  for (int steps = 0; twin_of_[b] != kNone ? v != twin_of_[b] : at != border_of_[b]; ++steps) {
    const std::uint32_t first = crossed();
    const std::uint32_t next = steps < kMaxBorder ? nextOnBorder(at, v) : kNone;
    if (next == kNone) return giveUp();
    const std::vector<Step>* way = findWayAround(below_->edges()[at].triangle[0], below_->edges()[next].triangle[0], v);
    // Where no edge leads into the surface there is no crossing to hold the pair.
    if (way == nullptr || way->empty()) return giveUp();
    const Gap gap = gapAt(v, edge);
    for (const Step& step : *way) crossed_.push_back(step.edge), crossings_.push_back({step.facet, gap});
    path.distance = std::max(path.distance, gap.distance);
    turns_.push_back({e, v, at, next, first, crossed()});
    at = next;
    v = below_->edges()[at].otherEnd(v);
  }
  if (twin_of_[b] != kNone) turns_.push_back({e, v, at, kNone, crossed(), crossed()});
  path.start = start;
  path.end = below_->edges()[at].triangle[0];
  path.last = crossed();
  path.is_on_border = true;
  return true;
}

// The border edge at the other end of the fan at v that this edge begins; kNone if more than two triangles meet at an
// edge on the way.
std::uint32_t Overlay::nextOnBorder(std::uint32_t edge, std::uint32_t v) const {
  std::uint32_t t = below_->edges()[edge].triangle[0];
  std::uint32_t over = below_->otherEdge(t, v, edge);
  for (; below_->edges()[over].isInner(); over = below_->otherEdge(t, v, over)) t = below_->edges()[over].across(t);
  return below_->edges()[over].triangles == 1 ? over : kNone;
}

// The gap between vertex v below and the nearest point of an edge above.
Overlay::Gap Overlay::gapAt(std::uint32_t v, const FacetSurface::Edge& edge) const {
  for (const std::uint32_t end : edge.vertex)
    if (twin_of_[end] == v) return gap_of_[end];
  const glm::vec3 to = below_->view().positions[v] - origin_;
  const float share = closestShare(to, whole_);
  Gap gap{glm::length(to - share * whole_), 0.0F};
  gap.distance += 16.0F * kEpsilon * (gap.distance + std::sqrt(length2_));
  if (has_color_) {
    const auto& colors = above_->view().colors;
    gap.color = glm::length(below_->view().colors[v] - glm::mix(colors[edge.vertex[0]], colors[edge.vertex[1]], share));
  }
  return gap;
}

// Whether both surfaces have the edge. It then lies in a facet at it: in the one on the side of its first triangle, if
// there is one.
bool Overlay::findSameEdge(std::uint32_t e, Path& path) const {
  const auto [a, b] = above_->edges()[e].vertex;
  const bool ahead = above_->borderStart(e) == a;
  const std::uint32_t from = twin_of_[ahead ? a : b];
  const std::uint32_t to = twin_of_[ahead ? b : a];
  bool is_found = false;
  for (const std::uint32_t t : below_->around(from)) {
    const std::size_t k = below_->cornerOf(t, from);
    const bool runs = below_->corner(t, k == 2 ? 0 : k + 1) == to;
    if (!runs && below_->corner(t, k == 0 ? 2 : k - 1) != to) continue;
    path.start = path.end = t;
    is_found = true;
    if (runs) break;
  }
  return is_found;
}

// Adds a crossing. It waits for its gap, so that several are measured at once.
void Overlay::addCrossing(std::uint32_t edge, std::uint32_t facet, float along) {
  const SurfaceView& below = below_->view();
  const auto [p, q] = below_->edges()[edge].vertex;
  const std::size_t lane = lanes_.count++;
  lanes_.crossing[lane] = static_cast<std::uint32_t>(crossings_.size());
  lanes_.walked[lane] = walked_;
  lanes_.along[lane] = along;
  lanes_.above.set(lane, whole_);
  lanes_.below.set(lane, below.positions[q] - below.positions[p]);
  lanes_.apart.set(lane, below.positions[p] - origin_);
  if (has_color_) {
    const SurfaceView& above = above_->view();
    const auto [a, b] = above_->edges()[walked_].vertex;
    lanes_.color_above[0].set(lane, above.colors[a]);
    lanes_.color_above[1].set(lane, above.colors[b]);
    lanes_.color_below[0].set(lane, below.colors[p]);
    lanes_.color_below[1].set(lane, below.colors[q]);
  }
  crossed_.push_back(edge);
  crossings_.push_back({facet, {}});
  if (lanes_.count == kLanes) measureCrossings();
}

// Pairs the points where the edge above and the edge below are nearest to each other; where they are as good as
// parallel, the point at share `along` above with the nearest one below.
void Overlay::measureCrossings() {
  const auto& [count, crossing, walked, given, above, below, apart, color_above, color_below] = lanes_;
  Lanes along = given;
  Lanes share;
  Lanes distance;
  Lanes color{};
  // s clamped to [0, 1]; NaN becomes 0.
  const auto clamped = [](float s) {
    const float positive = s > 0.0F ? s : 0.0F;
    return positive < 1.0F ? positive : 1.0F;
  };
  for (std::size_t i = 0; i < kLanes; ++i) {
    const glm::vec3 whole(above.x[i], above.y[i], above.z[i]);
    const glm::vec3 pq(below.x[i], below.y[i], below.z[i]);
    const glm::vec3 p(apart.x[i], apart.y[i], apart.z[i]);
    const float above2 = glm::dot(whole, whole);
    const float below2 = glm::dot(pq, pq);
    const float both = glm::dot(whole, pq);
    const float to_above = glm::dot(whole, p);
    const float to_below = glm::dot(pq, p);
    // The nearest points of the lines; then of the edges, where those lie beyond an end.
    const float area2 = above2 * below2 - both * both;
    const float line = clamped((both * to_above - above2 * to_below) / area2);
    const float nearest = clamped((to_above + line * both) / above2);
    along[i] = area2 > kParallel * above2 * below2 ? nearest : along[i];
    share[i] = clamped((along[i] * both - to_below) / below2);
    const glm::vec3 gap = along[i] * whole - p - share[i] * pq;
    const float d = std::sqrt(glm::dot(gap, gap));
    const float size = d + std::sqrt(above2) + std::abs(pq.x) + std::abs(pq.y) + std::abs(pq.z);
    distance[i] = d + 32.0F * kEpsilon * size;
  }
  for (std::size_t i = 0; has_color_ && i < kLanes; ++i) {
    const auto difference2 = [&](const Lanes& a0, const Lanes& a1, const Lanes& b0, const Lanes& b1) {
      const float d = a0[i] * (1.0F - along[i]) + a1[i] * along[i] - (b0[i] * (1.0F - share[i]) + b1[i] * share[i]);
      return d * d;
    };
    color[i] = std::sqrt(difference2(color_above[0].x, color_above[1].x, color_below[0].x, color_below[1].x) +
                         difference2(color_above[0].y, color_above[1].y, color_below[0].y, color_below[1].y) +
                         difference2(color_above[0].z, color_above[1].z, color_below[0].z, color_below[1].z));
  }
  for (std::size_t i = 0; i < count; ++i) {
    crossings_[crossing[i]].gap = {distance[i], color[i]};
    float& largest = paths_[walked[i]].distance;
    largest = std::max(largest, distance[i]);
  }
  lanes_.count = 0;
}

// The shorter way around vertex v from facet t to `goal`; null if they do not lie in one fan there.
const std::vector<Overlay::Step>* Overlay::findWayAround(std::uint32_t t, std::uint32_t goal, std::uint32_t v) {
  for (auto& way : way_) way.clear();
  if (t == goal) return &way_[0];
  std::uint32_t at[2] = {t, t};
  std::uint32_t over[2] = {kNone, below_->edgeOf(t, below_->cornerOf(t, v))};
  over[0] = below_->otherEdge(t, v, over[1]);
  for (std::size_t steps = 0; steps < below_->around(v).size(); ++steps)
    for (std::size_t side = 0; side < 2; ++side) {
      if (over[side] == kNone) continue;
      const FacetSurface::Edge& edge = below_->edges()[over[side]];
      if (!edge.isInner()) {
        over[side] = kNone;
        continue;
      }
      at[side] = edge.across(at[side]);
      way_[side].push_back({over[side], at[side]});
      if (at[side] == goal) return &way_[side];
      over[side] = below_->otherEdge(at[side], v, over[side]);
    }
  return nullptr;
}

// Crosses the edges of the shortest way from facet t to the goal, all at one point of the edge above.
bool Overlay::linkFacets(std::uint32_t t, const Goal& goal, float along) {
  struct Seen {
    std::uint32_t facet, over;
    std::size_t before;
  };
  std::array<Seen, kMaxLink> seen;
  std::size_t count = 0;
  seen[count++] = {t, kNone, 0};
  bool is_found = isReached(goal, t);
  for (std::size_t i = 0; i < count && !is_found; ++i) {
    for (std::size_t k = 0; k < 3 && count < kMaxLink && !is_found; ++k) {
      const std::uint32_t e = below_->edgeOf(seen[i].facet, k);
      const FacetSurface::Edge& edge = below_->edges()[e];
      if (!edge.isInner() || e == seen[i].over) continue;
      const std::uint32_t next = edge.across(seen[i].facet);
      bool is_new = true;
      for (std::size_t j = 0; j < count && is_new; ++j) is_new = seen[j].facet != next;
      if (is_new) seen[count++] = {next, e, i};
      is_found = isReached(goal, next);
    }
  }
  if (!is_found) return false;
  std::array<std::size_t, kMaxLink> way;
  std::size_t length = 0;
  for (std::size_t j = count - 1; j != 0; j = seen[j].before) way[length++] = j;
  while (length > 0) --length, addCrossing(seen[way[length]].over, seen[way[length]].facet, along);
  return true;
}

// Finds the vertices below that triangle s encloses: they lie on the inner side of all edges that its border crosses an
// odd number of times. False if the walks do not determine them.
bool Overlay::encloseVertices(std::uint32_t s) {
  const std::array<const Path*, 3> border{&paths_[above_->edgeOf(s, 0)], &paths_[above_->edgeOf(s, 1)],
                                          &paths_[above_->edgeOf(s, 2)]};
  float distance = 0.0F;
  std::size_t crossings = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    if (!border[k]->arrives) return false;
    distance = std::max({distance, border[k]->distance, gap_of_[above_->corner(s, k)].distance});
    crossings += border[k]->last - border[k]->first;
  }

  distance_[s] = distance;
  if (!turnCorners(s)) return false;
  crossings += corners_.size();

  // The edges that are crossed an odd number of times; mostly there are none.
  cut_.resize(crossings);
  std::uint32_t* const cut = cut_.data();
  std::uint8_t* const is_cut = is_cut_.data();
  std::size_t met = 0;
  std::size_t odd = 0;
  const auto meet = [&](std::uint32_t e) {
    cut[met++] = e;
    is_cut[e] ^= 1;
    odd = is_cut[e] != 0 ? odd + 1 : odd - 1;
  };
  for (const Path* path : border)
    for (std::uint32_t i = path->first; i < path->last; ++i) meet(crossed_[i]);
  for (const CornerTurn& corner : corners_) meet(corner.edge);
  if (odd == 0) return true;

  // Each of these edges is listed once.
  std::size_t count = 0;
  for (std::size_t i = 0; i < met; ++i) {
    const std::uint32_t e = cut[i];
    cut[count] = e;
    count += is_cut[e];
    is_cut[e] = 0;
  }
  cut_.resize(count);
  if (cut_.size() > kMaxCut) return false;
  inside_.clear();
  for (const std::uint32_t e : cut_) {
    const auto [a, b] = below_->edges()[e].vertex;
    if (contains(inside_, a) || contains(inside_, b)) continue;
    // Mostly one vertex is enclosed, with all its edges cut.
    if (isAllCut(a))
      inside_.push_back(a);
    else if (isAllCut(b))
      inside_.push_back(b);
    else if (!addConnected(a, kFew) && !addConnected(b, kFew) && !addConnected(a, kMaxEnclosed) &&
             !addConnected(b, kMaxEnclosed))
      return false;
  }
  for (const std::uint32_t e : cut_) {
    const auto [a, b] = below_->edges()[e].vertex;
    if (contains(inside_, a) == contains(inside_, b)) return false;
  }
  for (const std::uint32_t v : inside_) {
    const FacetSurface::Spot spot = above_->closest(s, below_->view().positions[v]);
    Gap gap{spot.distance, 0.0F};
    if (has_color_) gap.color = glm::length(below_->view().colors[v] - above_->colorAt(s, spot));
    enclosed_.push_back({v, gap});
    distance = std::max(distance, gap.distance);
  }
  distance_[s] = distance;
  return true;
}

// Turns around the corners of triangle s that both surfaces have, from the facet by which its one edge arrives to the
// one by which its other edge leaves. False if there is no way.
bool Overlay::turnCorners(std::uint32_t s) {
  corners_.clear();
  for (std::size_t k = 0; k < 3; ++k) {
    const std::uint32_t v = above_->corner(s, k);
    const std::uint32_t twin = twin_of_[v];
    if (twin == kNone) continue;
    const std::uint32_t from = endAt(above_->edgeOf(s, k == 0 ? 2 : k - 1), v);
    const std::uint32_t to = endAt(above_->edgeOf(s, k), v);
    if (from == to) continue;
    const std::vector<Step>* way = findWayAround(from, to, twin);
    if (way == nullptr) return false;
    for (const Step& step : *way) {
      corners_.push_back({step.edge, twin});
      if (step.facet != to) corner_facets_.push_back({step.facet, gap_of_[v]});
    }
  }
  return true;
}

// The facet in which the walk along edge e above begins or ends at v.
std::uint32_t Overlay::endAt(std::uint32_t e, std::uint32_t v) const {
  return above_->edges()[e].vertex[0] == v ? paths_[e].start : paths_[e].end;
}

// Whether all edges of v are cut and none of them is a border.
bool Overlay::isAllCut(std::uint32_t v) const {
  std::size_t count = 0;
  for (const std::uint32_t e : cut_) {
    const auto& ends = below_->edges()[e].vertex;
    count += static_cast<std::size_t>(ends[0] == v) + static_cast<std::size_t>(ends[1] == v);
  }
  return count == below_->around(v).size() && below_->leavingBorder(v) == kNone;
}

// Adds to inside_ the vertices that are connected with `start` by edges that are not cut. False, with nothing added, if
// they are more than `max_vertices`, or reach a border, beyond which no triangle could enclose them, or an edge of more
// than two triangles.
bool Overlay::addConnected(std::uint32_t start, std::size_t max_vertices) {
  const std::size_t first = inside_.size();
  inside_.push_back(start);
  for (std::size_t i = first; i < inside_.size(); ++i) {
    const std::uint32_t v = inside_[i];
    bool is_inner = below_->leavingBorder(v) == kNone;
    for (const std::uint32_t t : below_->around(v)) {
      if (!is_inner) break;
      for (std::size_t k = 0; k < 3 && is_inner; ++k) {
        const std::uint32_t e = below_->edgeOf(t, k);
        const FacetSurface::Edge& edge = below_->edges()[e];
        if (!edge.endsAt(v)) continue;
        if (!edge.isInner()) is_inner = false;
        if (contains(cut_, e)) continue;
        const std::uint32_t w = edge.otherEnd(v);
        if (contains(inside_, w)) continue;
        if (inside_.size() - first < max_vertices)
          inside_.push_back(w);
        else
          is_inner = false;
      }
    }
    if (!is_inner) {
      inside_.resize(first);
      return false;
    }
  }
  return true;
}

// Finds the border edges below that the walks along the border cover (modulo 2): an odd number of walks goes around or
// ends at either end, and none ends between them unless another goes on from there. Edges that lead into the surface
// are turned over on the way.
void Overlay::findCoveredBorders() {
  covered_ends_.assign(below_->edges().size(), 0);
  is_open_end_.assign(above_->view().positions.size(), 0);
  const auto isGood = [&](std::uint32_t e) { return is_good_[above_->edges()[e].triangle[0]] != 0; };
  for (const BorderTurn& turn : turns_) {
    if (!isGood(turn.above)) continue;
    for (const std::uint32_t e : {turn.from, turn.to})
      if (e != kNone) covered_ends_[e] ^= endBit(e, turn.vertex);
    for (std::uint32_t i = turn.first; i < turn.last; ++i) is_turned_[crossed_[i]] ^= endBit(crossed_[i], turn.vertex);
  }
  for (std::uint32_t e = 0; e < paths_.size(); ++e)
    if (paths_[e].is_on_border && isGood(e))
      for (const std::uint32_t v : above_->edges()[e].vertex) is_open_end_[v] ^= twin_of_[v] == kNone ? 1 : 0;
  for (std::uint32_t v = 0; v < is_open_end_.size(); ++v)
    if (is_open_end_[v] != 0) covered_ends_[border_of_[v]] = kNeverCovered;
}

std::uint8_t Overlay::endBit(std::uint32_t e, std::uint32_t v) const {
  return below_->edges()[e].vertex[0] == v ? 1 : 2;
}

void Overlay::uncoverAround(const FacetSurface::Edge& edge) {
  for (const std::uint32_t v : edge.vertex)
    for (const std::uint32_t t : below_->around(v)) is_uncovered_[t] = 1;
}

// Finds the facets below of which some part may lie in no cell.
void Overlay::findUncovered() {
  is_uncovered_.assign(below_->triangleCount(), 0);
  findCoveredBorders();
  // An edge is covered to its end if an odd number of triangles turn over it there or enclose that end.
  const auto isCovered = [&](std::uint32_t e, std::size_t end) {
    return ((is_turned_[e] >> end) & 1) != is_enclosed_[below_->edges()[e].vertex[end]];
  };
  for (std::uint32_t e = 0; e < below_->edges().size(); ++e) {
    const FacetSurface::Edge& edge = below_->edges()[e];
    if (edge.triangles > 2)
      uncoverAround(edge);
    else if (edge.isInner() ? !isCovered(e, 0) || !isCovered(e, 1) : covered_ends_[e] != kBothEnds)
      for (std::size_t i = 0; i < edge.triangles; ++i) is_uncovered_[edge.triangle[i]] = 1;
  }
  // An arc with cells on one side only bounds the covered part; on a covered border it is the border itself.
  for (std::size_t e = 0; e < paths_.size(); ++e) {
    const FacetSurface::Edge& edge = above_->edges()[e];
    const Path& path = paths_[e];
    if (!path.arrives) continue;
    if (edge.triangles == 2 && is_good_[edge.triangle[0]] == is_good_[edge.triangle[1]]) continue;
    if (edge.triangles == 1 && (is_good_[edge.triangle[0]] == 0 || path.is_on_border)) continue;
    is_uncovered_[path.start] = 1;
    for (std::uint32_t i = path.first; i < path.last; ++i) is_uncovered_[crossings_[i].facet] = 1;
  }
}

}  // namespace lod::patch::builder
