#include "lod/ingest/stitching.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <charconv>
#include <cmath>
#include <glm/glm.hpp>
#include <limits>
#include <optional>
#include <tuple>

#include "base/parallel.h"
#include "lod/ingest/border_vertices.h"
#include "lod/ingest/level_grid.h"
#include "lod/ingest/morton.h"

namespace lod::ingest {
namespace {

// The widest gap that is a seam, as a share of the shorter edge beside it, and the shares at which borders are counted:
// half octaves up to half an edge, where the next vertex of a border may lie.
constexpr std::size_t kShares = 12;
constexpr double kLargestShare = 0.5;
double shareAt(std::size_t i) {
  return kLargestShare * std::exp2((static_cast<double>(i) - kShares) / 2.0);
}
// Borders that merely lie about are as dense just above a share as below it; seams are so many times denser below.
constexpr double kSeamContrast = 4.0;
// Two sides of a seam lie on opposite sides of it, those of a thin sheet on the same: the cosine between the directions
// from the border into the surface tells. Tiles that meet in a corner are at right angles.
constexpr float kMostAlike = 0.5F;
// Both sides of a scan's seam come from one picture. Parts of a plan have each its paint, up to the edge where they
// touch: where most pairs are this unlike, such pairs stay two.
constexpr float kMostUnlike = 40.0F;  // of 255, in the channel that differs most
constexpr float kLeastKnown = 0.1F;   // length of the sum of unit vectors
// A vertex goes to the least code near it, that one perhaps to the next; tiles meet four at a time.
constexpr int kMostSteps = 4;
// Holes of so many edges are closed, if they are as short as that many mean edges and do not show in a whole view.
constexpr std::size_t kHoleEdges = 6;
constexpr double kLargestHole = 1.0 / 200.0;  // of the diagonal
// The surface around a hole lies away from its middle: the mean cosine, by length.
constexpr float kLeastAround = 0.3F;
// So many mean edges (or lengths that were given) beside a slab decide on what lies in it: chains of moves reach two,
// holes six.
constexpr double kEdgesBeside = 16.0;

constexpr std::uint32_t kNone = 0xFFFFFFFFU;
constexpr std::size_t kChunk = 4096;

struct Edge {
  std::uint32_t from = 0, to = 0;
  glm::ivec3 third{0};
};

// The sum of the known colours of a vertex, and their number.
struct ColorSum {
  glm::vec3 sum{0.0F};
  float count = 0.0F;

  void add(std::uint32_t color) {
    if (color >> 24 == 0) return;
    sum += glm::vec3(color & 255U, color >> 8 & 255U, color >> 16 & 255U);
    count += 1.0F;
  }
};

bool looksLike(const ColorSum& a, const ColorSum& b) {
  if (a.count == 0.0F || b.count == 0.0F) return true;
  const glm::vec3 apart = glm::abs(a.sum / a.count - b.sum / b.count);
  return std::max({apart.x, apart.y, apart.z}) <= kMostUnlike;
}

float lengthOf(const glm::ivec3& v) {
  return static_cast<float>(glm::length(glm::dvec3(v)));
}

// The unit vector from the edge into its triangle; zero where the triangle has no area.
glm::vec3 inwardOf(const glm::ivec3& from, const glm::ivec3& to, const glm::ivec3& third) {
  const glm::dvec3 along = glm::normalize(glm::dvec3(to - from));
  const glm::dvec3 side(third - from);
  const glm::dvec3 inward = side - glm::dot(side, along) * along;
  const double length = glm::length(inward);
  return length > 0.0 ? glm::vec3(inward / length) : glm::vec3(0.0F);
}

void lower(std::atomic<std::uint32_t>& value, std::uint32_t to) {
  std::uint32_t now = value.load(std::memory_order_relaxed);
  while (to < now && !value.compare_exchange_weak(now, to, std::memory_order_relaxed)) {
  }
}

template <class Body>
void inChunks(std::size_t count, unsigned threads, Body&& body) {
  base::parallelFor((count + kChunk - 1) / kChunk, threads, [&](std::size_t chunk) {
    for (std::size_t i = chunk * kChunk; i < std::min(count, (chunk + 1) * kChunk); ++i) body(i);
  });
}

// How far apart the two sides of borders are, and how alike.
struct PairCounts {
  std::array<double, kShares> vertices{};  // by share: from shareAt(i) to shareAt(i + 1), the first from 0
  std::uint64_t pairs = 0, unlike = 0;

  // The colours tell parts apart.
  bool painted() const { return 2 * unlike > pairs; }
};

// The share at which the distances to the nearest vertex across have their gap: between what rounding put apart and
// what is apart. 0 where the borders show no seams.
double shareOfGap(const std::array<double, kShares>& count) {
  std::array<double, kShares> density{};
  double all = 0.0;
  for (std::size_t i = 0; i < kShares; ++i) {
    density[i] = count[i] / (shareAt(i + 1) - (i == 0 ? 0.0 : shareAt(i)));
    all += count[i];
  }
  // The gap is beyond the densest share, which rounding put there; the last one is for what slits and the mesh's own
  // spacing put there. A few stray vertices fill no gap.
  const auto densest = static_cast<std::size_t>(std::max_element(density.begin(), density.end() - 1) - density.begin());
  if (density[densest] == 0.0) return 0.0;
  const double stray = 0.002 * all / kLargestShare;
  const double least = *std::min_element(density.begin() + static_cast<std::ptrdiff_t>(densest) + 1, density.end());
  std::size_t begin = 0, length = 0;
  for (std::size_t i = densest + 1, run = 0; i < kShares; ++i) {
    run = density[i] <= std::max(1.25 * least, stray) ? run + 1 : 0;
    if (run > length) length = run, begin = i + 1 - run;
  }
  const std::size_t middle = begin + (length - 1) / 2;
  double below = 0.0;
  for (std::size_t i = 0; i < middle; ++i) below += count[i];
  const double share = shareAt(middle);
  return below / share >= kSeamContrast * density[middle] ? share : 0.0;
}

// All that was found so far.
struct Findings {
  std::vector<Stitches::Move> moves;
  std::vector<Stitches::Split> splits;
  std::vector<std::array<std::uint64_t, 3>> fills;
  StitchCounts counts;
};

// Stitches the border within a slab. It sees what lies beside it, too, and reports what the slab owns.
class Stitcher {
 public:
  Stitcher(std::vector<BorderEdge> edges, const StitchScale& scale, const BorderSlab& slab, unsigned threads)
      : scale_(scale), slab_(slab), threads_(threads) {
    number(std::move(edges));
    measureVertices();
  }

  void countPairs(PairCounts& counts) const {
    std::vector<std::atomic<std::uint32_t>> nearest(codes_.size());
    const float none = 2.0F;
    for (auto& share : nearest) share = std::bit_cast<std::uint32_t>(none);
    // Numbers that are not negative have their bits in the same order.
    std::atomic<std::uint64_t> pairs = 0, unlike = 0;
    forEachPair(kLargestShare, [&](std::uint32_t v, std::uint32_t u, float share) {
      pairs.fetch_add(owns(v) ? 1 : 0, std::memory_order_relaxed);
      unlike.fetch_add(owns(v) && !looksLike(colors_[v], colors_[u]) ? 1 : 0, std::memory_order_relaxed);
      lower(nearest[v], std::bit_cast<std::uint32_t>(share));
      lower(nearest[u], std::bit_cast<std::uint32_t>(share));
    });
    counts.pairs += pairs, counts.unlike += unlike;
    for (std::uint32_t v = 0; v < nearest.size(); ++v) {
      const auto share = static_cast<double>(std::bit_cast<float>(nearest[v].load()));
      if (share > kLargestShare || !owns(v)) continue;
      std::size_t bin = 0;
      while (bin + 1 < kShares && share > shareAt(bin + 1)) ++bin;
      counts.vertices[bin] += 1.0;
    }
  }

  // `reach`: so many times the shorter edge beside it a gap may be wide. `painted`: unlike colours stay apart.
  void stitch(double reach, bool painted, Findings& out) {
    out_ = &out;
    reach_ = reach;
    painted_ = painted;
    for (const Edge& e : edges_) out.counts.source_edges += owns(std::min(e.from, e.to)) ? 1 : 0;
    if (reach_ > 0.0) {
      move();
      closeEdges();
      split();
      closeEdges();
    }
    fill();
  }

 private:
  void number(std::vector<BorderEdge> edges) {
    std::sort(edges.begin(), edges.end());
    codes_.reserve(2 * edges.size());
    for (const BorderEdge& e : edges) codes_.insert(codes_.end(), {e.from, e.to});
    std::sort(codes_.begin(), codes_.end());
    codes_.erase(std::unique(codes_.begin(), codes_.end()), codes_.end());
    codes_.shrink_to_fit();
    points_.reserve(codes_.size());
    for (const std::uint64_t code : codes_) points_.push_back(mortonPoint(code));
    edges_.reserve(edges.size());
    colors_.resize(codes_.size());
    for (const BorderEdge& e : edges) {
      edges_.push_back({find(e.from), find(e.to), mortonPoint(e.third)});
      colors_[edges_.back().from].add(e.from_color);
      colors_[edges_.back().to].add(e.to_color);
    }
  }

  std::uint32_t find(std::uint64_t code) const {
    const auto at = std::lower_bound(codes_.begin(), codes_.end(), code);
    return at != codes_.end() && *at == code ? static_cast<std::uint32_t>(at - codes_.begin()) : kNone;
  }

  void measureVertices() {
    // Rounding put seams apart by so much whatever the edges beside them, so that long edges reach no farther.
    const bool found = scale_.length <= 0.0 && scale_.mean_edge > 0.0;
    spacing_.assign(codes_.size(), found ? static_cast<float>(scale_.mean_edge) : std::numeric_limits<float>::max());
    inward_.assign(codes_.size(), glm::vec3(0.0F));
    for (const Edge& e : edges_) {
      const float length = lengthOf(points_[e.to] - points_[e.from]);
      const glm::vec3 inward = inwardOf(points_[e.from], points_[e.to], e.third);
      for (const std::uint32_t v : {e.from, e.to}) {
        spacing_[v] = std::min(spacing_[v], length);
        inward_[v] += inward;
      }
    }
    // Where two sides share a vertex already, the directions cancel out, and nothing is known.
    for (glm::vec3& inward : inward_)
      inward = glm::length(inward) > kLeastKnown ? glm::normalize(inward) : glm::vec3(0.0F);
    grid_.emplace(points_, spacing_);
  }

  // Calls body(a, b, share) for vertices that may be two sides of a seam; `share` is their distance over the shorter
  // edge beside them, at most `most`. Each pair is met from its finer side, or from both.
  template <class Body>
  void forEachPair(double most, Body&& body) const {
    inChunks(codes_.size(), threads_, [&](std::size_t i) {
      const auto v = static_cast<std::uint32_t>(i);
      const float radius = static_cast<float>(most) * spacing_[v];
      grid_->near(
          points_[v], LevelGrid::levelOf(spacing_[v]), [&](float) { return radius; },
          [&](std::uint32_t u) {
            if (u == v || glm::dot(inward_[u], inward_[v]) >= kMostAlike) return;
            const float distance = lengthOf(points_[u] - points_[v]);
            const float share = distance / std::min(spacing_[u], spacing_[v]);
            if (share > static_cast<float>(most) || (scale_.length > 0.0 && distance > scale_.length)) return;
            if (painted_ && !looksLike(colors_[v], colors_[u])) return;
            body(v, u, share);
          });
    });
  }

  // Moves each vertex to the one of the least code that it may be one with.
  void move() {
    std::vector<std::atomic<std::uint32_t>> target(codes_.size());
    for (std::uint32_t v = 0; v < target.size(); ++v) target[v] = v;
    forEachPair(reach_, [&](std::uint32_t v, std::uint32_t u, float) {
      lower(target[v], u);
      lower(target[u], v);
    });
    goes_to_.resize(codes_.size());
    for (std::uint32_t v = 0; v < target.size(); ++v) {
      std::uint32_t to = v;
      for (int step = 0; step < kMostSteps && target[to] != to; ++step) to = target[to];
      goes_to_[v] = to;
      if (to == v || !owns(v)) continue;
      out_->moves.push_back({codes_[v], codes_[to]});
      noteMovement(lengthOf(points_[to] - points_[v]));
    }
    for (Edge& e : edges_) {
      if (const std::uint32_t third = find(mortonCode(e.third)); third != kNone) e.third = points_[goes_to_[third]];
      e.from = goes_to_[e.from], e.to = goes_to_[e.to];
    }
    std::erase_if(edges_, [this](const Edge& e) {
      return e.from == e.to || e.third == points_[e.from] || e.third == points_[e.to];
    });
  }

  bool owns(std::uint32_t v) const { return slab_.owns(points_[v][slab_.axis]); }
  void noteMovement(float distance) {
    out_->counts.largest_movement = std::max(out_->counts.largest_movement, static_cast<double>(distance));
  }

  // Drops edges that two triangles share by now.
  void closeEdges() {
    const auto key = [](const Edge& e) { return std::minmax(e.from, e.to); };
    std::stable_sort(edges_.begin(), edges_.end(), [&](const Edge& a, const Edge& b) { return key(a) < key(b); });
    std::size_t kept = 0;
    for (std::size_t begin = 0, end = 0; begin < edges_.size(); begin = end) {
      while (end < edges_.size() && key(edges_[end]) == key(edges_[begin])) ++end;
      if (end - begin == 1) edges_[kept++] = edges_[begin];
    }
    edges_.resize(kept);
  }

  struct Cut {
    std::uint32_t edge = kNone, vertex = 0;
    double along = 0.0;  // from 0 at the edge's start to 1
    auto operator<=>(const Cut&) const = default;
  };

  // Cuts border edges at the border vertices that lie on them.
  void split() {
    std::vector<glm::ivec3> middles;
    std::vector<float> lengths;
    for (const Edge& e : edges_) {
      middles.push_back((points_[e.from] + points_[e.to]) / 2);
      lengths.push_back(lengthOf(points_[e.to] - points_[e.from]));
    }
    const LevelGrid grid(middles, lengths);
    std::vector<std::uint32_t> open;
    for (const Edge& e : edges_) open.insert(open.end(), {e.from, e.to});
    std::sort(open.begin(), open.end());
    open.erase(std::unique(open.begin(), open.end()), open.end());
    std::vector<Cut> cuts(open.size());
    inChunks(open.size(), threads_, [&](std::size_t i) { cuts[i] = cutAt(open[i], grid); });
    std::erase_if(cuts, [](const Cut& cut) { return cut.edge == kNone; });
    std::sort(cuts.begin(), cuts.end(), [](const Cut& a, const Cut& b) {
      return std::tie(a.edge, a.along, a.vertex) < std::tie(b.edge, b.along, b.vertex);
    });
    for (std::size_t begin = 0, end = 0; begin < cuts.size(); begin = end) {
      while (end < cuts.size() && cuts[end].edge == cuts[begin].edge) ++end;
      cutEdge(std::span(cuts).subspan(begin, end - begin));
    }
  }

  // The nearest edge that the vertex lies on.
  Cut cutAt(std::uint32_t v, const LevelGrid& grid) const {
    Cut best{kNone, v, 0.0};
    double nearest = reach_ * static_cast<double>(spacing_[v]);
    if (scale_.length > 0.0) nearest = std::min(nearest, scale_.length);
    const double reach = nearest;
    const glm::dvec3 p(points_[v]);
    const int level = std::max(0, LevelGrid::levelOf(spacing_[v]) - 1);
    grid.near(
        points_[v], level, [&](float longest) { return 0.5F * longest + static_cast<float>(reach) + 1.0F; },
        [&](std::uint32_t number) {
          const Edge& e = edges_[number];
          if (e.from == v || e.to == v || e.third == points_[v]) return;
          const glm::dvec3 a(points_[e.from]), along = glm::dvec3(points_[e.to]) - a;
          const double t = glm::dot(p - a, along) / glm::dot(along, along);
          const double distance = glm::length(p - (a + t * along));
          if (!(t > 0.0 && t < 1.0) || distance > reach_ * glm::length(along)) return;
          if (distance > nearest || (distance == nearest && number > best.edge)) return;
          if (glm::dot(inwardOf(points_[e.from], points_[e.to], e.third), inward_[v]) >= kMostAlike) return;
          if (painted_ && !looksLike(colors_[v], colors_[t < 0.5 ? e.from : e.to])) return;
          nearest = distance, best.edge = number, best.along = t;
        });
    return best;
  }

  // Cuts one edge at as many of the vertices as leave every part of its triangle facing as the whole.
  void cutEdge(std::span<const Cut> cuts) {
    const Edge e = edges_[cuts.front().edge];
    const int from = points_[e.from][slab_.axis], to = points_[e.to][slab_.axis];
    // Vertices that lie on it may be out of sight.
    if (!slab_.seesAll(std::min(from, to), std::max(from, to))) return;
    const glm::dvec3 whole(latticeNormal(points_[e.from], points_[e.to], e.third));
    const auto faces = [&](std::uint32_t a, std::uint32_t b) {
      return glm::dot(glm::dvec3(latticeNormal(points_[a], points_[b], e.third)), whole) > 0.0;
    };
    std::vector<std::uint32_t> chain{e.from};
    for (const Cut& cut : cuts)
      if (faces(chain.back(), cut.vertex)) chain.push_back(cut.vertex);
    while (chain.size() > 1 && !faces(chain.back(), e.to)) chain.pop_back();
    if (chain.size() == 1) return;
    Stitches::Split split{codes_[e.from], codes_[e.to], {}};
    const glm::dvec3 a(points_[e.from]), along = glm::normalize(glm::dvec3(points_[e.to]) - a);
    for (std::size_t i = 1; i < chain.size(); ++i) {
      split.vertices.push_back(codes_[chain[i]]);
      const glm::dvec3 from_a = glm::dvec3(points_[chain[i]]) - a;
      if (owns(e.from)) noteMovement(static_cast<float>(glm::length(from_a - glm::dot(from_a, along) * along)));
    }
    if (owns(e.from)) out_->splits.push_back(std::move(split));
    chain.push_back(e.to);
    edges_[cuts.front().edge].to = chain[1];
    for (std::size_t i = 1; i + 1 < chain.size(); ++i) edges_.push_back({chain[i], chain[i + 1], e.third});
  }

  // Closes the loops of few border edges that are holes.
  void fill() {
    // By vertex the only edge that leaves it, and whether one arrives.
    constexpr std::uint32_t kSeveral = kNone - 1;
    std::vector<std::uint32_t> leaves(codes_.size(), kNone), arrives(codes_.size(), kNone);
    const auto note = [&](std::uint32_t& at, std::uint32_t edge) { at = at == kNone ? edge : kSeveral; };
    for (std::uint32_t e = 0; e < edges_.size(); ++e) {
      note(leaves[edges_[e].from], e);
      note(arrives[edges_[e].to], e);
    }
    std::vector<std::uint32_t> loop;
    for (const Edge& first : edges_) {
      loop.clear();
      std::uint32_t v = first.from;
      do {
        // The loop is met from its least vertex.
        if (leaves[v] >= kSeveral || arrives[v] >= kSeveral || v < first.from || loop.size() == kHoleEdges) break;
        loop.push_back(leaves[v]);
        v = edges_[leaves[v]].to;
      } while (v != first.from);
      if (v == first.from && owns(v) && loop.size() >= 3 && isHole(loop)) close(loop);
    }
  }

  bool isHole(std::span<const std::uint32_t> loop) const {
    glm::dvec3 middle(0.0);
    for (const std::uint32_t e : loop) middle += glm::dvec3(points_[edges_[e].from]);
    middle /= static_cast<double>(loop.size());
    double around = 0.0, perimeter = 0.0;
    for (const std::uint32_t number : loop) {
      const Edge& e = edges_[number];
      const double length = static_cast<double>(lengthOf(points_[e.to] - points_[e.from]));
      const glm::dvec3 outward = 0.5 * glm::dvec3(points_[e.from] + points_[e.to]) - middle;
      if (const double away = glm::length(outward); away > 0.0)
        around += length * glm::dot(outward / away, glm::dvec3(inwardOf(points_[e.from], points_[e.to], e.third)));
      perimeter += length;
    }
    return perimeter <= static_cast<double>(kHoleEdges) * scale_.mean_edge &&
           perimeter <= kLargestHole * scale_.diagonal && around >= kLeastAround * perimeter;
  }

  // Closes the loop by the fan of the least area; its triangles run against the border.
  void close(std::span<const std::uint32_t> loop) {
    const std::size_t n = loop.size();
    const auto vertex = [&](std::size_t i) { return edges_[loop[i % n]].from; };
    double least = std::numeric_limits<double>::max();
    std::size_t apex = n;
    for (std::size_t start = 0; start < n; ++start) {
      double area = 0.0;
      for (std::size_t i = 1; i + 1 < n; ++i) {
        const glm::dvec3 normal(
            latticeNormal(points_[vertex(start)], points_[vertex(start + i + 1)], points_[vertex(start + i)]));
        area += glm::length(normal);
      }
      if (area < least) least = area, apex = start;
    }
    for (std::size_t i = 1; i + 1 < n; ++i)
      out_->fills.push_back({codes_[vertex(apex)], codes_[vertex(apex + i + 1)], codes_[vertex(apex + i)]});
    ++out_->counts.closed_holes;
  }

  StitchScale scale_;
  BorderSlab slab_;
  unsigned threads_;
  Findings* out_ = nullptr;
  double reach_ = 0.0;
  std::vector<std::uint64_t> codes_;  // of border vertices, ascending
  std::vector<glm::ivec3> points_;
  std::vector<ColorSum> colors_;
  bool painted_ = false;           // in parts, each in its own colour
  std::vector<float> spacing_;     // length of the shortest border edge at the vertex, or the mean edge
  std::vector<glm::vec3> inward_;  // from the border into the surface
  std::vector<Edge> edges_;        // that are still open
  std::optional<LevelGrid> grid_;  // of the vertices
  std::vector<std::uint32_t> goes_to_;
};

}  // namespace

base::Result<StitchOptions> parseStitch(const std::string& text) {
  if (text == "auto") return StitchOptions{};
  if (text == "off") return StitchOptions{false, 0.0};
  StitchOptions out;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), out.length);
  if (error != std::errc() || end != text.data() + text.size() || !(out.length > 0.0) || !std::isfinite(out.length))
    return base::Error{base::ErrorCode::kInvalidInput,
                       "--stitch " + text + ": give auto, off, or a length above 0 in units of the source"};
  return out;
}

std::string describeStitch(const StitchOptions& options) {
  if (!options.on) return "off";
  if (!(options.length > 0.0)) return "auto";
  char text[32];
  return {text, std::to_chars(text, text + sizeof(text), options.length).ptr};
}

Stitches::Stitches(std::vector<Move> moves, std::vector<Split> splits, std::vector<std::array<std::uint64_t, 3>> fills,
                   const StitchCounts& counts)
    : moves_(std::move(moves)), splits_(std::move(splits)), fills_(std::move(fills)), counts_(counts) {
  if (!moves_.empty()) moves_filter_.resize(std::size_t{1} << kFilterBits);
  for (const Move& move : moves_) moves_filter_[slot(move.from)] = true;
  if (!splits_.empty()) splits_filter_.resize(std::size_t{1} << kFilterBits);
  for (const Split& split : splits_) splits_filter_[slot(split.from)] = true;
}

std::uint64_t Stitches::moved(std::uint64_t code) const {
  if (moves_.empty() || !moves_filter_[slot(code)]) return code;
  const auto at = std::lower_bound(moves_.begin(), moves_.end(), Move{code, 0});
  return at != moves_.end() && at->from == code ? at->to : code;
}

std::span<const std::uint64_t> Stitches::splitting(std::uint64_t from, std::uint64_t to) const {
  if (splits_.empty() || !splits_filter_[slot(from)]) return {};
  const auto at = std::lower_bound(splits_.begin(), splits_.end(), std::pair(from, to),
                                   [](const Split& s, const auto& ends) { return std::pair(s.from, s.to) < ends; });
  if (at == splits_.end() || at->from != from || at->to != to) return {};
  return at->vertices;
}

base::Result<Stitches> findStitches(const BorderEdges& border, const StitchScale& scale, std::uint64_t most,
                                    unsigned threads) {
  const double beside = kEdgesBeside * std::max(scale.mean_edge, scale.length);
  const auto slabs = border.slabs(most, static_cast<int>(std::min(beside, 1e9)) + 1);
  Findings found;
  if (!slabs) {
    found.counts.too_many = 1;
    return Stitches({}, {}, {}, found.counts);
  }
  found.counts.slabs = slabs->size();
  // A border in one slab is read and numbered once.
  std::optional<Stitcher> stitcher;
  const auto load = [&](const BorderSlab& slab) -> base::Result<void> {
    if (stitcher && slabs->size() == 1) return {};
    stitcher.reset();
    LUMIGRID_ASSIGN_OR_RETURN(auto edges, border.read(slab));
    stitcher.emplace(std::move(edges), scale, slab, threads);
    return {};
  };
  PairCounts pairs;
  for (const BorderSlab& slab : *slabs) {
    LUMIGRID_TRY(load(slab));
    stitcher->countPairs(pairs);
  }
  found.counts.reach = scale.length > 0.0 ? kLargestShare : shareOfGap(pairs.vertices);
  for (const BorderSlab& slab : *slabs) {
    LUMIGRID_TRY(load(slab));
    stitcher->stitch(found.counts.reach, pairs.painted(), found);
  }
  std::sort(found.moves.begin(), found.moves.end());
  std::sort(found.splits.begin(), found.splits.end(),
            [](const auto& a, const auto& b) { return std::tie(a.from, a.to) < std::tie(b.from, b.to); });
  std::sort(found.fills.begin(), found.fills.end());
  found.counts.stitched_vertices = found.moves.size();
  found.counts.split_edges = found.splits.size();
  return Stitches(std::move(found.moves), std::move(found.splits), std::move(found.fills), found.counts);
}

}  // namespace lod::ingest
