// Implements encodeTriangles and decodeTriangles of chunks.h.
//
// Vertices are ranked by the Morton codes of their places. The edges between them are coded vertex by vertex in the
// order of ranks, each at its end of lower rank; the triangles are those of the graph's 3-cliques that a bit says so
// of.
#include <algorithm>
#include <array>
#include <bit>
#include <numeric>

#include "base/check.h"
#include "lod/morton.h"
#include "lod/pmr/chunk_checksum.h"
#include "lod/pmr/chunks.h"
#include "lod/pmr/range_coder.h"

namespace lod::pmr {
namespace {

using Rank = std::uint32_t;
constexpr Rank kNone = 0xFFFFFFFF;

/// Limits of what a chunk may cost, so that a damaged one is given up soon. A mesh whose triangles go beyond them is
/// coded as a plain list.
struct Limits {
  explicit Limits(std::uint32_t triangles)
      : edges(std::uint64_t{3} * triangles),
        cliques(std::uint64_t{8} * triangles + 1000),
        steps(std::uint64_t{64} * triangles + 100'000) {}
  std::uint64_t edges, cliques, steps;
};

/// Vertices by rank.
struct Ranking {
  std::vector<std::uint16_t> vertices;  ///< of each rank
  std::vector<glm::ivec3> places;       ///< of each rank

  explicit Ranking(std::span<const glm::ivec3> of) {
    std::vector<std::pair<std::uint64_t, std::uint16_t>> keyed(of.size());
    for (std::size_t v = 0; v < of.size(); ++v) keyed[v] = {mortonCode(of[v]), static_cast<std::uint16_t>(v)};
    std::sort(keyed.begin(), keyed.end());
    for (const auto& [code, vertex] : keyed) {
      vertices.push_back(vertex);
      places.push_back(of[vertex]);
    }
  }
};

/// Undirected edges, each at its end of lower rank.
struct Graph {
  std::vector<std::uint32_t> first;  ///< of each rank: its first edge; one more at the end
  std::vector<Rank> ends;            ///< the other end of each edge, ascending within a rank

  std::span<const Rank> above(Rank v) const { return std::span(ends).subspan(first[v], first[v + 1] - first[v]); }
};

using Corners = std::array<Rank, 3>;  // ascending

Graph graphOf(const std::vector<Corners>& triangles, std::size_t vertices) {
  std::vector<std::uint64_t> edges;
  for (const auto& [a, b, c] : triangles)
    for (const auto& [low, high] : {std::pair(a, b), std::pair(a, c), std::pair(b, c)})
      edges.push_back(std::uint64_t{low} << 32 | high);
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  Graph graph;
  graph.first.assign(vertices + 1, 0);
  for (const std::uint64_t edge : edges) {
    ++graph.first[(edge >> 32) + 1];
    graph.ends.push_back(static_cast<Rank>(edge));
  }
  std::partial_sum(graph.first.begin(), graph.first.end(), graph.first.begin());
  return graph;
}

/// Codes the edges of a graph, in both directions (range_coder.h).
///
/// An edge of v is often the third side of a triangle whose other sides, from a vertex of lower rank, are known. So the
/// neighbours of v's lower neighbours are its candidates, each of which a bit accepts or not. Other neighbours follow
/// as differences of ranks.
template <class Coder>
class EdgeModel {
 public:
  EdgeModel(Coder& coder, const std::vector<glm::ivec3>& places, const Limits& limits)
      : coder_(coder),
        places_(places),
        limits_(limits),
        lowest_(places.size(), kNone),
        candidate_of_(places.size(), kNone),
        votes_(places.size()),
        wideness_(places.size()) {
    graph_.first.push_back(0);
  }

  /// Codes the neighbours of the next rank. `above`: those of higher rank, ascending, where they are known. False when
  /// limits are exceeded, or when what was decoded cannot be.
  bool codeNext(std::span<const Rank> above) {
    const auto v = static_cast<Rank>(graph_.first.size() - 1);
    if (!findCandidates(v)) return false;
    codeCandidates(above);
    if (!codeOthers(v, above)) return false;
    if (graph_.ends.size() + found_.size() > limits_.edges) return false;
    std::sort(found_.begin(), found_.end());
    for (const Rank w : found_) {
      next_lower_.push_back(lowest_[w]);
      from_.push_back(v);
      lowest_[w] = static_cast<std::uint32_t>(graph_.ends.size());
      graph_.ends.push_back(w);
    }
    graph_.first.push_back(static_cast<std::uint32_t>(graph_.ends.size()));
    return true;
  }

  Graph takeGraph() { return std::move(graph_); }

 private:
  bool findCandidates(Rank v) {
    candidates_.clear();
    lower_ = 0;
    for (std::uint32_t edge = lowest_[v]; edge != kNone; edge = next_lower_[edge]) {
      const Rank a = from_[edge];
      ++lower_;
      const std::span<const Rank> above = graph_.above(a);
      steps_ += above.size();
      if (steps_ > limits_.steps) return false;
      const std::uint64_t first_side = squaredDistance(a, v);
      for (const Rank w : above) {
        if (w <= v) continue;
        const std::uint32_t wide = wideness(first_side + squaredDistance(a, w), squaredDistance(v, w));
        if (candidate_of_[w] != v) {
          candidate_of_[w] = v;
          votes_[w] = 0;
          wideness_[w] = wide;
          candidates_.push_back(w);
        }
        ++votes_[w];
        wideness_[w] = std::min(wideness_[w], wide);
      }
    }
    std::sort(candidates_.begin(), candidates_.end());
    return true;
  }

  std::uint64_t squaredDistance(Rank a, Rank b) const {
    const glm::ivec3 d = places_[b] - places_[a];
    return static_cast<std::uint64_t>(std::int64_t{d.x} * d.x + std::int64_t{d.y} * d.y + std::int64_t{d.z} * d.z);
  }

  // How wide the angle between two sides of a triangle is: 8 is a right angle, 0 none, 15 almost the opposite
  // direction. `beside`: the sum of the sides' squares. Numbers of 27 bits are exact enough.
  static std::uint32_t wideness(std::uint64_t beside, std::uint64_t opposite) {
    const unsigned shift = std::max(static_cast<unsigned>(std::bit_width(beside)), 27U) - 27U;
    const auto divisor = std::max(static_cast<std::uint32_t>(beside >> shift), 1U);
    return std::min(8 * static_cast<std::uint32_t>(opposite >> shift) / divisor, 15U);
  }

  void codeCandidates(std::span<const Rank> above) {
    found_.clear();
    for (const Rank w : candidates_) {
      const std::uint32_t votes = std::min(votes_[w], 3U) - 1;
      const auto accepted = static_cast<std::uint32_t>(std::min<std::size_t>(found_.size(), 3));
      const std::uint32_t known = std::binary_search(above.begin(), above.end(), w) ? 1 : 0;
      if (coder_.bit(accepts_[votes][accepted][wideness_[w]], known) != 0) found_.push_back(w);
    }
  }

  bool codeOthers(Rank v, std::span<const Rank> above) {
    const std::size_t accepted = found_.size();
    const std::size_t context = std::min<std::size_t>(lower_ + accepted, others_.size() - 1);
    const auto expected = static_cast<std::uint64_t>(above.size() - std::min(accepted, above.size()));
    std::uint64_t count = others_[context].code(coder_, expected);
    Rank before = v;
    std::uint32_t number = 0;
    std::uint32_t length_before = 0;
    auto next = above.begin();
    for (; count > 0; --count, ++number) {
      while (next != above.end() && candidate_of_[*next] == v) ++next;
      const std::uint64_t gap = next != above.end() ? *next++ - before - 1 : 0;
      const std::uint64_t decoded = before + 1 + gaps_[std::min(number, 2U)][length_before].code(coder_, gap);
      if (decoded >= places_.size() || candidate_of_[decoded] == v) return false;
      length_before = std::min(static_cast<std::uint32_t>(std::bit_width(decoded - before - 1)), 15U);
      before = static_cast<Rank>(decoded);
      found_.push_back(before);
    }
    return true;
  }

  Coder& coder_;
  const std::vector<glm::ivec3>& places_;
  const Limits& limits_;
  Graph graph_;
  std::vector<std::uint32_t> lowest_;      // of each rank: the last edge from a lower one; edges form lists
  std::vector<std::uint32_t> next_lower_;  // of each edge: the one before in its list
  std::vector<Rank> from_;                 // of each edge: its lower end
  std::vector<Rank> candidate_of_;
  std::vector<std::uint32_t> votes_;
  std::vector<std::uint32_t> wideness_;
  std::vector<Rank> candidates_, found_;
  std::uint64_t steps_ = 0;
  std::uint32_t lower_ = 0;
  std::array<std::array<std::array<BitModel, 16>, 4>, 3> accepts_;
  std::array<NumberModel, 12> others_;
  std::array<std::array<NumberModel, 16>, 3> gaps_;
};

/// Calls visit(corners) for each 3-clique in the order of its corners; stops where that returns false, or where the
/// limits are exceeded, and returns false then.
template <class Visit>
bool forEachClique(const Graph& graph, const Limits& limits, const Visit& visit) {
  const std::size_t vertices = graph.first.size() - 1;
  std::vector<Rank> beside(vertices, kNone);
  std::uint64_t steps = 0, cliques = 0;
  for (Rank a = 0; a < vertices; ++a) {
    for (const Rank b : graph.above(a)) beside[b] = a;
    for (const Rank b : graph.above(a)) {
      steps += graph.above(b).size();
      if (steps > limits.steps) return false;
      for (const Rank c : graph.above(b)) {
        if (beside[c] != a) continue;
        if (++cliques > limits.cliques || !visit(Corners{a, b, c})) return false;
      }
    }
  }
  return true;
}

/// Codes which cliques are triangles.
template <class Coder>
class CliqueModel {
 public:
  std::uint32_t code(Coder& coder, std::uint32_t is_triangle) {
    const std::uint32_t coded = coder.bit(models_[before_ & 3], is_triangle);
    before_ = before_ << 1 | coded;
    return coded;
  }

 private:
  std::array<BitModel, 4> models_;
  std::uint32_t before_ = 3;
};

/// Codes triangles as a plain list, in both directions; false where what was decoded cannot be.
template <class Coder>
bool codeList(Coder& coder, std::vector<Corners>& triangles, std::size_t vertices) {
  std::array<NumberModel, 3> first, second, third;
  Corners before{0, 0, 0};
  for (auto& [a, b, c] : triangles) {
    const std::uint64_t first_gap = first[0].code(coder, a - before[0]);
    const std::uint64_t decoded_a = before[0] + first_gap;
    const std::uint64_t from_b = first_gap == 0 && before[1] > before[0] ? before[1] : decoded_a + 1;
    const std::uint64_t second_gap = second[first_gap == 0 ? 0 : 1].code(coder, b - from_b);
    const std::uint64_t decoded_b = from_b + second_gap;
    const bool same = first_gap == 0 && second_gap == 0 && before[2] > before[1];
    const std::uint64_t from_c = (same ? before[2] : decoded_b) + 1;
    const std::uint64_t decoded_c = from_c + third[same ? 0 : 1].code(coder, c - from_c);
    if (decoded_c >= vertices) return false;
    a = static_cast<Rank>(decoded_a), b = static_cast<Rank>(decoded_b), c = static_cast<Rank>(decoded_c);
    before = {a, b, c};
  }
  return true;
}

/// False where the mesh is beyond the limits of a graph.
bool encodeGraph(const std::vector<Corners>& triangles, const Ranking& ranking, RangeEncoder& encoder) {
  const Limits limits(static_cast<std::uint32_t>(triangles.size()));
  const Graph graph = graphOf(triangles, ranking.places.size());
  EdgeModel<RangeEncoder> edges(encoder, ranking.places, limits);
  for (Rank v = 0; v < ranking.places.size(); ++v)
    if (!edges.codeNext(graph.above(v))) return false;
  CliqueModel<RangeEncoder> model;
  auto next = triangles.begin();
  return forEachClique(graph, limits, [&](const Corners& corners) {
    const bool is_triangle = next != triangles.end() && *next == corners;
    next += is_triangle ? 1 : 0;
    model.code(encoder, is_triangle ? 1 : 0);
    return true;
  });
}

bool decodeGraph(RangeDecoder& decoder, const Ranking& ranking, std::vector<Corners>& triangles) {
  const Limits limits(static_cast<std::uint32_t>(triangles.size()));
  EdgeModel<RangeDecoder> edges(decoder, ranking.places, limits);
  for (Rank v = 0; v < ranking.places.size(); ++v)
    if (!edges.codeNext({})) return false;
  CliqueModel<RangeDecoder> model;
  auto next = triangles.begin();
  const bool good = forEachClique(edges.takeGraph(), limits, [&](const Corners& corners) {
    if (model.code(decoder, 0) == 0) return true;
    if (next == triangles.end()) return false;
    *next++ = corners;
    return true;
  });
  return good && next == triangles.end();
}

}  // namespace

base::Bytes encodeTriangles(std::span<const std::uint16_t> corners, std::span<const glm::ivec3> places) {
  if (corners.empty()) return {};
  LUMIGRID_CHECK(corners.size() % 3 == 0 && corners.size() / 3 <= kMaxTriangles && places.size() <= kMaxVertices);
  const Ranking ranking(places);
  std::vector<Rank> ranks(places.size());
  for (Rank r = 0; r < ranks.size(); ++r) ranks[ranking.vertices[r]] = r;
  std::vector<Corners> triangles;
  for (std::size_t i = 0; i < corners.size(); i += 3) {
    Corners triangle{ranks[corners[i]], ranks[corners[i + 1]], ranks[corners[i + 2]]};
    std::sort(triangle.begin(), triangle.end());
    triangles.push_back(triangle);
  }
  std::sort(triangles.begin(), triangles.end());

  RangeEncoder encoder;
  encoder.raw(1, 0);
  if (!encodeGraph(triangles, ranking, encoder)) {
    encoder = {};
    encoder.raw(1, 1);
    codeList(encoder, triangles, places.size());
  }
  return sealedChunk(encoder.finish(), static_cast<std::uint32_t>(triangles.size()),
                     static_cast<std::uint32_t>(places.size()));
}

base::Result<std::vector<std::uint16_t>> decodeTriangles(base::ByteView chunk, std::uint32_t triangles,
                                                         std::span<const glm::ivec3> places) {
  const auto coded = triangles <= kMaxTriangles && places.size() <= kMaxVertices
                         ? intactChunk(chunk, triangles, triangles > 0 ? static_cast<std::uint32_t>(places.size()) : 0)
                         : std::nullopt;
  if (!coded) return damaged("triangles: checksum does not match");
  std::vector<std::uint16_t> corners;
  if (triangles == 0) return corners;
  const Ranking ranking(places);
  std::vector<Corners> decoded(triangles);
  RangeDecoder decoder(*coded);
  const bool is_list = decoder.raw(1) != 0;
  if (!(is_list ? codeList(decoder, decoded, places.size()) : decodeGraph(decoder, ranking, decoded)))
    return damaged("triangles: they cannot be");
  corners.reserve(std::size_t{3} * triangles);
  for (const Corners& triangle : decoded)
    for (const Rank r : triangle) corners.push_back(ranking.vertices[r]);
  return corners;
}

}  // namespace lod::pmr
