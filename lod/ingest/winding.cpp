#include "lod/ingest/winding.h"

#include <algorithm>

#include "base/fields.h"
#include "lod/ingest/buckets.h"
#include "lod/ingest/code_map.h"
#include "lod/ingest/disjoint_sets.h"

namespace lod::ingest {
namespace {

// Disjoint sets whose members each have the same orientation as their root, or the opposite one. The union is by size,
// which keeps the depth logarithmic.
class OppositeSets {
 public:
  explicit OppositeSets(std::size_t size) : parent_(size), opposite_(size, 0), size_(size, 1) {
    for (std::uint32_t i = 0; i < size; ++i) parent_[i] = i;
  }
  std::pair<std::uint32_t, std::uint8_t> find(std::uint32_t i) const {
    std::uint8_t opposite = 0;
    for (; parent_[i] != i; i = parent_[i]) opposite ^= opposite_[i];
    return {i, opposite};
  }
  /// False when a and b are in one set already, with the other orientation.
  bool unite(std::uint32_t a, std::uint32_t b, std::uint8_t opposite) {
    auto [x, x_opposite] = find(a);
    auto [y, y_opposite] = find(b);
    const auto between = static_cast<std::uint8_t>(x_opposite ^ y_opposite ^ opposite);
    if (x == y) return between == 0;
    if (size_[x] < size_[y]) std::swap(x, y);
    parent_[y] = x;
    opposite_[y] = between;
    size_[x] += size_[y];
    return true;
  }

 private:
  std::vector<std::uint32_t> parent_;
  std::vector<std::uint8_t> opposite_;
  std::vector<std::uint32_t> size_;
};

// Calls body(triangle, lesser vertex, greater vertex, turned) for the edges of every triangle; turned is 1 where the
// edge runs from the greater to the lesser vertex.
template <class Body>
void forEachEdge(const NumberedCorners& mesh, Body&& body) {
  for (std::size_t i = 0; i < mesh.number.size(); i += 3)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = mesh.number[i + k], b = mesh.number[i + (k + 1) % 3];
      body(static_cast<std::uint32_t>(i / 3), std::min(a, b), std::max(a, b), a > b ? 1U : 0U);
    }
}

// Marks the vertices with an edge to a greater number that does not run as often one way as the other. In a sum of
// hashed numbers, edges that run both ways cancel out; others do so with a probability of about 2^-64.
std::vector<std::uint8_t> unevenVertices(const NumberedCorners& mesh) {
  std::vector<std::uint64_t> sums(mesh.codes.size(), 0);
  forEachEdge(mesh, [&](std::uint32_t, std::uint32_t low, std::uint32_t high, std::uint32_t turned) {
    std::uint64_t hashed = (std::uint64_t{high} + 1) * 0x9E3779B97F4A7C15ULL;
    hashed = (hashed ^ hashed >> 32) * 0xD6E8FEB86659FD93ULL;
    sums[low] += turned != 0 ? 0 - hashed : hashed;
  });
  std::vector<std::uint8_t> uneven(sums.size());
  for (std::size_t v = 0; v < sums.size(); ++v) uneven[v] = sums[v] != 0 ? 1 : 0;
  return uneven;
}

// For each vertex the uses of its edges to vertices of greater number, side by side.
struct EdgeUses {
  struct Use {
    std::uint32_t other = 0;
    std::uint32_t triangle = 0;  // times 2, plus 1 where the edge is turned
  };
  std::vector<std::uint32_t> first;  // vertex v has uses first[v] … first[v + 1] − 1
  std::vector<Use> uses;

  explicit EdgeUses(const NumberedCorners& mesh) : EdgeUses(mesh, std::vector<std::uint8_t>(mesh.codes.size(), 1)) {}
  /// Collects the uses of edges whose first vertex is wanted.
  EdgeUses(const NumberedCorners& mesh, const std::vector<std::uint8_t>& wanted) {
    first.assign(mesh.codes.size() + 2, 0);
    const auto forEachUse = [&](auto&& body) {
      forEachEdge(mesh, [&](std::uint32_t t, std::uint32_t low, std::uint32_t high, std::uint32_t turned) {
        if (wanted[low] != 0) body(t, low, high, turned);
      });
    };
    forEachUse([&](std::uint32_t, std::uint32_t low, std::uint32_t, std::uint32_t) { ++first[low + 2]; });
    for (std::size_t v = 2; v < first.size(); ++v) first[v] += first[v - 1];
    uses.resize(first.back());
    forEachUse([&](std::uint32_t t, std::uint32_t low, std::uint32_t high, std::uint32_t turned) {
      uses[first[low + 1]++] = {high, 2 * t + turned};
    });
    first.pop_back();
  }

  // Calls body(low, high, first use, second use, count) for every edge.
  template <class Body>
  void forEach(Body&& body) {
    for (std::uint32_t v = 0; v + 1 < first.size(); ++v) {
      for (std::uint32_t i = first[v]; i < first[v + 1]; ++i) {
        if (uses[i].other == kDone) continue;
        std::uint32_t count = 1, second = 0;
        for (std::uint32_t j = i + 1; j < first[v + 1]; ++j) {
          if (uses[j].other != uses[i].other) continue;
          second = uses[j].triangle;
          ++count;
          uses[j].other = kDone;
        }
        body(v, uses[i].other, uses[i].triangle, second, count);
      }
    }
  }
  static constexpr std::uint32_t kDone = 0xFFFFFFFFU;
};

}  // namespace

NumberedCorners::NumberedCorners(std::span<const Corner> corners) : number(corners.size()) {
  CodeMap map(corners.size() / 6);
  for (std::size_t i = 0; i < corners.size(); ++i) {
    map.prefetch(corners[std::min(i + CodeMap::kPrefetchDistance, corners.size() - 1)].code);
    number[i] = map.insert(corners[i].code).first;
  }
  codes = map.releaseCodes();
}

WindingCheck checkWinding(const NumberedCorners& mesh, std::span<const std::uint32_t> border_place) {
  WindingCheck out;
  EdgeUses edges(mesh, unevenVertices(mesh));
  edges.forEach(
      [&](std::uint32_t low, std::uint32_t high, std::uint32_t first, std::uint32_t second, std::uint32_t count) {
        if (count == 2) out.consistent &= ((first ^ second) & 1U) != 0;
        if (count != 1) return;
        if (border_place[low] == kNotOnBorder || border_place[high] == kNotOnBorder) {
          ++out.inner_open;
          return;
        }
        const std::uint64_t a = mesh.codes[low], b = mesh.codes[high];
        out.open.push_back({std::min(a, b), std::max(a, b), 0, ((first & 1U) != 0) != (a > b)});
      });
  return out;
}

std::vector<BorderEdge> borderEdges(const NumberedCorners& mesh, std::span<const Corner> corners) {
  std::vector<BorderEdge> out;
  EdgeUses edges(mesh, unevenVertices(mesh));
  edges.forEach([&](std::uint32_t low, std::uint32_t high, std::uint32_t first, std::uint32_t, std::uint32_t count) {
    if (count != 1) return;
    const std::size_t begin = 3 * std::size_t{first / 2};
    const std::uint32_t from = (first & 1U) != 0 ? high : low, to = (first & 1U) != 0 ? low : high;
    BorderEdge edge{mesh.codes[from], mesh.codes[to]};
    for (std::size_t i = begin; i < begin + 3; ++i) {
      if (mesh.number[i] == from)
        edge.from_color = corners[i].color;
      else if (mesh.number[i] == to)
        edge.to_color = corners[i].color;
      else
        edge.third = corners[i].code;
    }
    out.push_back(edge);
  });
  return out;
}

SharedEdges compareEdges(std::vector<OpenEdge>& edges) {
  SharedEdges out;
  std::sort(edges.begin(), edges.end());
  for (std::size_t begin = 0, end = 0; begin < edges.size(); begin = end) {
    while (end < edges.size() && edges[end].low == edges[begin].low && edges[end].high == edges[begin].high) ++end;
    if (end - begin == 2 && edges[begin].turned == edges[begin + 1].turned) out.run_oppositely = false;
    out.open += end - begin == 1 ? 1 : 0;
  }
  return out;
}

BucketWinding measureWinding(const NumberedCorners& mesh, std::span<const std::uint32_t> border_place) {
  BucketWinding out;
  const auto triangles = static_cast<std::uint32_t>(mesh.number.size() / 3);
  if (triangles == 0) return out;
  struct UntiedEdge {
    std::uint32_t low = 0, high = 0, first = 0, second = 0, count = 0;
  };
  std::vector<UntiedEdge> untied;  // edges that do not join two triangles into one part
  DisjointSets sets(triangles);
  EdgeUses edges(mesh);
  edges.forEach(
      [&](std::uint32_t low, std::uint32_t high, std::uint32_t first, std::uint32_t second, std::uint32_t count) {
        if (count == 2 && ((first ^ second) & 1U) != 0)
          sets.unite(first / 2, second / 2);
        else
          untied.push_back({low, high, first, second, count});
      });

  // Only parts at the border or beside an opposing one matter. They are numbered by their first triangle.
  std::vector<std::uint8_t> matters(triangles, 0);
  std::vector<std::uint8_t> border(untied.size(), 0);
  for (std::size_t i = 0; i < untied.size(); ++i) {
    const UntiedEdge& e = untied[i];
    border[i] = e.count == 1 && border_place[e.low] != kNotOnBorder && border_place[e.high] != kNotOnBorder ? 1 : 0;
    if (border[i] != 0 || e.count == 2) matters[sets.find(e.first / 2)] = 1;
    if (e.count == 2) matters[sets.find(e.second / 2)] = 1;
  }
  std::vector<std::uint32_t> number(triangles, BucketWinding::kNoPart);
  out.part.assign(triangles, BucketWinding::kNoPart);
  for (std::uint32_t t = 0; t < triangles; ++t) {
    const std::uint32_t root = sets.find(t);
    if (matters[root] == 0) continue;
    if (number[root] == BucketWinding::kNoPart) {
      number[root] = static_cast<std::uint32_t>(out.parts.size());
      out.parts.emplace_back();
    }
    out.part[t] = number[root];
    ++out.parts[number[root]].triangles;
  }
  for (std::size_t i = 0; i < untied.size(); ++i) {
    const UntiedEdge& e = untied[i];
    const std::uint32_t a = out.part[e.first / 2];
    if (border[i] != 0) {
      const std::uint64_t x = mesh.codes[e.low], y = mesh.codes[e.high];
      out.open.push_back({std::min(x, y), std::max(x, y), a, ((e.first & 1U) != 0) != (x > y)});
    } else if (e.count == 2) {
      const std::uint32_t b = out.part[e.second / 2];
      out.opposing.emplace_back(std::min(a, b), std::max(a, b));
    } else {
      out.inner_open += e.count == 1 ? 1 : 0;
      if (a != BucketWinding::kNoPart) ++out.parts[a].perimeter;
    }
  }
  return out;
}

void Winding::add(const BucketWinding& bucket) {
  const std::uint32_t first = first_.back();
  open_edges_ += bucket.inner_open;
  parts_.insert(parts_.end(), bucket.parts.begin(), bucket.parts.end());
  for (OpenEdge e : bucket.open) {
    e.part += first;
    open_.push_back(e);
  }
  for (const auto& [a, b] : bucket.opposing) opposing_.emplace_back(first + a, first + b);
  first_.push_back(first + static_cast<std::uint32_t>(bucket.parts.size()));
}

void Winding::finish() {
  // An edge that two buckets share joins two parts into one, or makes them opposing ones.
  std::sort(open_.begin(), open_.end());
  const std::size_t count = parts_.size();
  OppositeSets whole(count);
  for (std::size_t begin = 0, end = 0; begin < open_.size(); begin = end) {
    while (end < open_.size() && open_[end].low == open_[begin].low && open_[end].high == open_[begin].high) ++end;
    const OpenEdge& a = open_[begin];
    open_edges_ += end - begin == 1 ? 1 : 0;
    if (end - begin == 2 && a.turned != open_[begin + 1].turned)
      whole.unite(a.part, open_[begin + 1].part, 0);
    else if (end - begin == 2)
      opposing_.emplace_back(a.part, open_[begin + 1].part);
    else
      for (std::size_t i = begin; i < end; ++i) ++parts_[open_[i].part].perimeter;
  }
  open_ = {};
  std::vector<std::uint32_t> root(count);
  std::vector<BucketWinding::Part> sum(count);
  for (std::uint32_t p = 0; p < count; ++p) {
    root[p] = whole.find(p).first;
    sum[root[p]].triangles += parts_[p].triangles;
    sum[root[p]].perimeter += parts_[p].perimeter;
  }
  std::vector<std::uint8_t> against_itself(count, 0);
  for (auto& [a, b] : opposing_) {
    a = root[a], b = root[b];
    if (a == b && against_itself[a] == 0) ++non_orientable_, against_itself[a] = 1;
    for (const std::uint32_t p : {a, b}) ++sum[p].perimeter, sum[p].against += a == b ? 0 : 1;
  }

  // Opposing parts get opposite orientations where the smaller one is surrounded: at least half of its perimeter runs
  // against its neighbours. In each set the orientation with more triangles wins.
  std::sort(opposing_.begin(), opposing_.end());
  opposing_.erase(std::unique(opposing_.begin(), opposing_.end()), opposing_.end());
  const auto surrounded = [&](std::uint32_t p) { return 2 * sum[p].against >= sum[p].perimeter && sum[p].against > 0; };
  OppositeSets sides(count);
  for (const auto& [a, b] : opposing_)
    if (a != b && surrounded(sum[a].triangles < sum[b].triangles ? a : b)) sides.unite(a, b, 1);
  std::vector<std::uint64_t> votes(2 * count, 0);
  for (std::uint32_t p = 0; p < count; ++p) {
    if (root[p] != p) continue;
    const auto [side, opposite] = sides.find(p);
    votes[2 * std::size_t{side} + opposite] += sum[p].triangles;
  }
  flip_.assign(count, 0);
  for (std::uint32_t p = 0; p < count; ++p) {
    const auto [side, opposite] = sides.find(root[p]);
    const std::uint64_t ours = votes[2 * std::size_t{side} + opposite];
    const std::uint64_t theirs = votes[2 * std::size_t{side} + (opposite ^ 1U)];
    if (ours > theirs || (ours == theirs && opposite == 0) || !surrounded(root[p])) continue;
    flip_[p] = 1;
    flipped_ += parts_[p].triangles;
  }
  parts_ = {};
  opposing_ = {};
}

void Winding::write(base::ByteWriter& out) const {
  out.u64(first_.size());
  for (const std::uint32_t f : first_) out.u32(f);
  out.bytes(flip_);
  base::writeFields(out, std::tie(flipped_, non_orientable_, open_edges_));
}

bool Winding::read(base::ByteReader& in) {
  const std::uint64_t buckets = in.u64();
  if (!in.ok() || buckets == 0 || buckets > in.remaining() / 4) return false;
  first_.resize(static_cast<std::size_t>(buckets));
  for (std::uint32_t& f : first_) f = in.u32();
  const base::ByteView flips = in.bytes(first_.back());
  flip_.assign(flips.begin(), flips.end());
  base::readFields(in, std::tie(flipped_, non_orientable_, open_edges_));
  return in.ok();
}

}  // namespace lod::ingest
