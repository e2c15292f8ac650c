#include "lod/patch/builder/overlay.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include "base/check.h"

namespace lod::patch::builder {
namespace {

constexpr float kEpsilon = std::numeric_limits<float>::epsilon();
// What is larger or longer than this is left to be measured otherwise: facets on the way of an edge, facets looked at
// to link two, edges below that a triangle cuts, vertices that it encloses, border edges
// along one above.
constexpr int kMaxSteps = 64;
constexpr std::size_t kMaxLink = 48;
constexpr std::size_t kMaxCut = 96;
constexpr std::size_t kMaxEnclosed = 24;
constexpr int kMaxBorder = 8;
// The squared sine below which two edges count as parallel.
constexpr float kParallel = 1e-4F;
// The squared cosine from which on a facet is taken to be the one that an edge runs along.
constexpr float kClear = 0.75F;
// Of a border edge: walks go around both of its ends; one ends on it.
constexpr std::uint8_t kBothEnds = 3;
constexpr std::uint8_t kNeverPinned = 4;
// Either side of a cut is tried so far before one is followed to the limit.
constexpr std::size_t kFew = 3;

bool contains(const std::vector<std::uint32_t>& list, std::uint32_t x) {
  return std::find(list.begin(), list.end(), x) != list.end();
}

}  // namespace

void Overlay::make(FacetSurface& above, FacetSurface& below, std::span<const std::uint32_t> facet_of,
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
  for (std::uint32_t e = 0; e < paths_.size(); ++e) walk(e, paths_[e]);
  measureCrossings();

  const std::uint32_t triangles = above.triangleCount();
  is_good_.assign(triangles, 0);
  distance_.assign(triangles, 0.0F);
  is_cut_.assign(below.edges().size(), 0);
  is_enclosed_.assign(below.view().positions.size(), 0);
  is_turned_.assign(below.edges().size(), 0);
  enclosed_.clear(), passed_.clear();
  first_enclosed_.resize(triangles + 1);
  first_passed_.resize(triangles + 1);
  for (std::uint32_t s = 0; s < triangles; ++s) {
    first_enclosed_[s] = static_cast<std::uint32_t>(enclosed_.size());
    first_passed_[s] = static_cast<std::uint32_t>(passed_.size());
    is_good_[s] = enclose(s) ? 1 : 0;
    if (is_good_[s] == 0) {
      enclosed_.resize(first_enclosed_[s]);
      passed_.resize(first_passed_[s]);
      continue;
    }
    for (std::size_t i = first_enclosed_[s]; i < enclosed_.size(); ++i) is_enclosed_[enclosed_[i].vertex] ^= 1;
    for (const Corner& corner : corners_) is_turned_[corner.edge] ^= endBit(corner.edge, corner.vertex);
  }
  first_enclosed_[triangles] = static_cast<std::uint32_t>(enclosed_.size());
  first_passed_[triangles] = static_cast<std::uint32_t>(passed_.size());
  findBare();
}

// From facet to facet along the edge, out over the wall that it meets first, to the facet of its other end.
void Overlay::walk(std::uint32_t e, Path& path) {
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
  if (twin_a != kNone && twin_b != kNone && isSame(e, path)) return;

  // From a vertex that is the same below it leaves by any facet there, and at one it may arrive by any.
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
      // Beyond it from the start: before all others, the farthest first.
      const Facet::Four when = from <= 0.0F ? from : from / (from - to);
      const auto over = below_->edgesOf(t);
      std::uint32_t walls = Facet::wallsWhere(to < 0.0F);
      for (std::size_t k = 0; k < 3; ++k) walls &= ~(static_cast<std::uint32_t>(over[k] == came_over) << k);
      for (; walls != 0; walls &= walls - 1) {
        const auto k = static_cast<std::size_t>(std::countr_zero(walls));
        // Beyond a border is nothing: the edge stays where it is.
        const FacetSurface::Edge& wall = below_->edges()[over[k]];
        if (!wall.isInner() || wall.endsAt(twin_a)) continue;
        if (when[k] < first) first = when[k], out = k;
      }
    }
    if (out == 3 || step == kMaxSteps) {
      // Over a facet that is not that of its end: in a fold or over a ridge, near one border, or over a flat facet.
      path.arrives = link(t, goal, step < kMaxSteps && !facet.flat ? 1.0F : along);
      break;
    }
    along = std::max(along, std::clamp(first, 0.0F, 1.0F));
    came_over = below_->edgeOf(t, out);
    t = below_->edges()[came_over].across(t);
    cross(came_over, t, along);
  }
  path.last = static_cast<std::uint32_t>(crossings_.size());
  if (path.last != path.first)
    path.end = crossings_.back().facet;
  else
    path.end = path.start;
}

// The facet around vertex v below that the edge above runs along best.
std::uint32_t Overlay::facetToward(std::uint32_t v) {
  const auto before = [](std::size_t k) { return k == 0 ? 2 : k - 1; };
  // Between both walls at corner k?
  const auto runsOver = [&](const Facet& facet, const Facet::Four& rise, std::size_t k) {
    const std::uint32_t both = 1U << k | 1U << before(k);
    return !facet.flat && (Facet::wallsWhere(rise >= 0.0F) & both) == both;
  };
  // The square of its shadow on the plane.
  const auto shadow2On = [&](const Facet::Four& rise) { return length2_ - rise[3] * rise[3]; };
  // Mostly one is clear.
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

// Along the border below from end to end: from a vertex that is the same there, or a point of a border edge, around the
// vertices between. Each is paired with the point of the edge that is nearest, and so are the ends of all edges there.
// So nothing is left bare between the two borders.
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

// The border edge of these two vertices below, or kNone.
std::uint32_t Overlay::borderBetween(std::uint32_t v, std::uint32_t w) const {
  for (const std::uint32_t t : below_->around(v))
    for (std::size_t k = 0; k < 3; ++k) {
      const FacetSurface::Edge& edge = below_->edges()[below_->edgeOf(t, k)];
      if (edge.triangles == 1 && edge.endsAt(v) && edge.endsAt(w)) return below_->edgeOf(t, k);
    }
  return kNone;
}

// From border edge `at` on by its end v. False: the other end of the edge above is not met there, and nothing is done.
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
    const std::vector<Step>* way = turn(below_->edges()[at].triangle[0], below_->edges()[next].triangle[0], v);
    // Where no edge leads into the surface no crossing keeps the pair.
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

// The border edge that ends the fan at v which this one begins; kNone: more than two triangles meet on the way.
std::uint32_t Overlay::nextOnBorder(std::uint32_t edge, std::uint32_t v) const {
  std::uint32_t t = below_->edges()[edge].triangle[0];
  std::uint32_t over = below_->otherEdge(t, v, edge);
  for (; below_->edges()[over].isInner(); over = below_->otherEdge(t, v, over)) t = below_->edges()[over].across(t);
  return below_->edges()[over].triangles == 1 ? over : kNone;
}

// Of vertex v below and the nearest point of an edge above.
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

// An edge that is the same below lies in a facet at it: in the one that is on the side of its first triangle, if any.
bool Overlay::isSame(std::uint32_t e, Path& path) const {
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

// Crossings wait for their gaps, so that several are measured at once.
void Overlay::cross(std::uint32_t edge, std::uint32_t facet, float along) {
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
  // Into [0, 1]; what is no number becomes 0.
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

// The shorter way around vertex v from facet t to `goal`, or null: they do not lie in one fan there.
const std::vector<Overlay::Step>* Overlay::turn(std::uint32_t t, std::uint32_t goal, std::uint32_t v) {
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

// The shortest way from facet t to the goal, crossed at one point.
bool Overlay::link(std::uint32_t t, const Goal& goal, float along) {
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
  while (length > 0) --length, cross(seen[way[length]].over, seen[way[length]].facet, along);
  return true;
}

// The vertices below that lie within triangle s: on the inner side of all edges that its border crosses an odd number
// of times. False: the walks do not say.
bool Overlay::enclose(std::uint32_t s) {
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

  // What is crossed an odd number of times: mostly nothing.
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
  for (const Corner& corner : corners_) meet(corner.edge);
  if (odd == 0) return true;

  // Each of those edges once.
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
    // Mostly it is one vertex, with all its edges cut.
    if (isAlone(a))
      inside_.push_back(a);
    else if (isAlone(b))
      inside_.push_back(b);
    else if (!flood(a, kFew) && !flood(b, kFew) && !flood(a, kMaxEnclosed) && !flood(b, kMaxEnclosed))
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

// Around the corners of triangle s that are the same below, from the facet that its one edge arrives by to the one that
// its other edge leaves by. False: there is no way.
bool Overlay::turnCorners(std::uint32_t s) {
  corners_.clear();
  for (std::size_t k = 0; k < 3; ++k) {
    const std::uint32_t v = above_->corner(s, k);
    const std::uint32_t twin = twin_of_[v];
    if (twin == kNone) continue;
    const std::uint32_t from = endAt(above_->edgeOf(s, k == 0 ? 2 : k - 1), v);
    const std::uint32_t to = endAt(above_->edgeOf(s, k), v);
    if (from == to) continue;
    const std::vector<Step>* way = turn(from, to, twin);
    if (way == nullptr) return false;
    for (const Step& step : *way) {
      corners_.push_back({step.edge, twin});
      if (step.facet != to) passed_.push_back({step.facet, gap_of_[v]});
    }
  }
  return true;
}

// The facet that the walk along edge e above begins or ends with at v.
std::uint32_t Overlay::endAt(std::uint32_t e, std::uint32_t v) const {
  return above_->edges()[e].vertex[0] == v ? paths_[e].start : paths_[e].end;
}

// Are all edges of v cut, and none of them a border?
bool Overlay::isAlone(std::uint32_t v) const {
  std::size_t count = 0;
  for (const std::uint32_t e : cut_) {
    const auto& ends = below_->edges()[e].vertex;
    count += static_cast<std::size_t>(ends[0] == v) + static_cast<std::size_t>(ends[1] == v);
  }
  return count == below_->around(v).size() && below_->leavingBorder(v) == kNone;
}

// Adds to inside_ the vertices that hang on `start` by edges that are not cut. False, and nothing added: they are too
// many, or reach a border, beyond which is no triangle to enclose them, or an edge of more than two triangles.
bool Overlay::flood(std::uint32_t start, std::size_t most) {
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
        if (inside_.size() - first < most)
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

// Border edges below that the walks along the border cover (modulo 2): an odd number goes around or ends at either end,
// and none ends between them that no other goes on from. What leads into the surface is turned over on the way.
void Overlay::findPinned() {
  is_passed_.assign(below_->edges().size(), 0);
  is_loose_.assign(above_->view().positions.size(), 0);
  const auto isGood = [&](std::uint32_t e) { return is_good_[above_->edges()[e].triangle[0]] != 0; };
  for (const Turn& turn : turns_) {
    if (!isGood(turn.above)) continue;
    for (const std::uint32_t e : {turn.from, turn.to})
      if (e != kNone) is_passed_[e] ^= endBit(e, turn.vertex);
    for (std::uint32_t i = turn.first; i < turn.last; ++i) is_turned_[crossed_[i]] ^= endBit(crossed_[i], turn.vertex);
  }
  for (std::uint32_t e = 0; e < paths_.size(); ++e)
    if (paths_[e].is_on_border && isGood(e))
      for (const std::uint32_t v : above_->edges()[e].vertex) is_loose_[v] ^= twin_of_[v] == kNone ? 1 : 0;
  for (std::uint32_t v = 0; v < is_loose_.size(); ++v)
    if (is_loose_[v] != 0) is_passed_[border_of_[v]] = kNeverPinned;
}

std::uint8_t Overlay::endBit(std::uint32_t e, std::uint32_t v) const {
  return below_->edges()[e].vertex[0] == v ? 1 : 2;
}

void Overlay::bareAround(const FacetSurface::Edge& edge) {
  for (const std::uint32_t v : edge.vertex)
    for (const std::uint32_t t : below_->around(v)) is_bare_[t] = 1;
}

// Facets that something of may lie in no cell.
void Overlay::findBare() {
  is_bare_.assign(below_->triangleCount(), 0);
  findPinned();
  // An edge is covered to its end where an odd number of triangles turn over it there or enclose that.
  const auto isCovered = [&](std::uint32_t e, std::size_t end) {
    return ((is_turned_[e] >> end) & 1) != is_enclosed_[below_->edges()[e].vertex[end]];
  };
  for (std::uint32_t e = 0; e < below_->edges().size(); ++e) {
    const FacetSurface::Edge& edge = below_->edges()[e];
    if (edge.triangles > 2)
      bareAround(edge);
    else if (edge.isInner() ? !isCovered(e, 0) || !isCovered(e, 1) : is_passed_[e] != kBothEnds)
      for (std::size_t i = 0; i < edge.triangles; ++i) is_bare_[edge.triangle[i]] = 1;
  }
  // An arc with cells on one side only is a border of what is covered; on a pinned border that is the border itself.
  for (std::size_t e = 0; e < paths_.size(); ++e) {
    const FacetSurface::Edge& edge = above_->edges()[e];
    const Path& path = paths_[e];
    if (!path.arrives) continue;
    if (edge.triangles == 2 && is_good_[edge.triangle[0]] == is_good_[edge.triangle[1]]) continue;
    if (edge.triangles == 1 && (is_good_[edge.triangle[0]] == 0 || path.is_on_border)) continue;
    is_bare_[path.start] = 1;
    for (std::uint32_t i = path.first; i < path.last; ++i) is_bare_[crossings_[i].facet] = 1;
  }
}

}  // namespace lod::patch::builder
