#include "lod/build/winding.h"

#include <algorithm>
#include <tuple>

#include "lod/build/buckets.h"
#include "lod/build/code_map.h"

namespace lod::build {
namespace {

// Sets whose members are each the same as, or the opposite of, their root (weighted union, no path halving needed for
// the depth that leaves: logarithmic).
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
  /// False when a and b are known to be otherwise.
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

struct LocalEdge {
  std::uint64_t key = ~std::uint64_t{0};
  std::uint32_t first = 0;   // triangle * 2 + direction
  std::uint32_t second = 0;  // the same, of the second triangle
  std::uint32_t count = 0;
};

}  // namespace

BucketWinding measureWinding(std::span<const Corner> corners, const std::function<bool(std::uint64_t)>& onBorder) {
  BucketWinding out;
  const std::size_t triangles = corners.size() / 3;
  if (triangles == 0) return out;

  // Edges by the local numbers of their ends.
  std::vector<std::uint64_t> codes;
  std::vector<LocalEdge> edges;
  std::size_t shift = 60;
  {
    CodeMap map(corners.size());
    std::size_t slots = 16;
    for (; slots < corners.size() + corners.size() / 4; slots *= 2) --shift;
    edges.resize(slots);
    for (std::uint32_t t = 0; t < triangles; ++t) {
      std::uint32_t v[3];
      for (std::size_t k = 0; k < 3; ++k) {
        const auto [number, is_new] =
            map.insert(corners[3 * std::size_t{t} + k].code, static_cast<std::uint32_t>(codes.size()));
        if (is_new) codes.push_back(corners[3 * std::size_t{t} + k].code);
        v[k] = number;
      }
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t a = v[k], b = v[(k + 1) % 3];
        const std::uint64_t key = std::uint64_t{std::min(a, b)} << 32 | std::max(a, b);
        auto slot = static_cast<std::size_t>((key * 0x9E3779B97F4A7C15ULL) >> shift);
        while (edges[slot].count != 0 && edges[slot].key != key) slot = slot + 1 < edges.size() ? slot + 1 : 0;
        LocalEdge& edge = edges[slot];
        edge.key = key;
        const std::uint32_t use = 2 * t + (a < b ? 0 : 1);
        (edge.count == 0 ? edge.first : edge.second) = use;
        ++edge.count;
      }
    }
  }

  // Two triangles at an edge run along it in opposite directions when they are wound alike.
  OppositeSets sets(triangles);
  std::vector<std::uint32_t> contradicted;
  bool alike = true;
  for (const LocalEdge& edge : edges) {
    if (edge.count != 2) continue;
    const bool same_direction = ((edge.first ^ edge.second) & 1U) == 0;
    alike &= !same_direction;
    if (!sets.unite(edge.first / 2, edge.second / 2, same_direction ? 1 : 0)) contradicted.push_back(edge.first / 2);
  }
  std::vector<std::uint32_t> on_border;
  for (std::uint32_t i = 0; i < edges.size(); ++i) {
    const LocalEdge& edge = edges[i];
    if (edge.count == 1 && onBorder(codes[static_cast<std::size_t>(edge.key >> 32)]) &&
        onBorder(codes[static_cast<std::size_t>(edge.key & 0xFFFFFFFFU)]))
      on_border.push_back(i);
  }
  if (alike && on_border.empty()) return out;

  // Parts that matter, numbered by their first triangle; a part that contradicts itself is left alone.
  std::vector<std::uint8_t> matters(triangles, alike ? 0 : 1);
  for (const std::uint32_t i : on_border) matters[sets.find(edges[i].first / 2).first] = 1;
  std::vector<std::uint8_t> broken(triangles, 0);
  for (const std::uint32_t t : contradicted) broken[sets.find(t).first] = 1;
  std::vector<std::uint32_t> number(triangles, BucketWinding::kNoPart);
  std::vector<std::uint8_t> first_turned(triangles, 0);
  out.part.assign(triangles, BucketWinding::kNoPart);
  out.turned.assign(triangles, 0);
  for (std::uint32_t t = 0; t < triangles; ++t) {
    const auto [root, opposite] = sets.find(t);
    if (broken[root] != 0) {
      if (broken[root] == 1) ++out.non_orientable, broken[root] = 2;
      continue;
    }
    if (matters[root] == 0) continue;
    if (number[root] == BucketWinding::kNoPart) {
      number[root] = static_cast<std::uint32_t>(out.counts.size() / 2);
      first_turned[root] = opposite;
      out.counts.insert(out.counts.end(), {0, 0});
    }
    out.part[t] = number[root];
    out.turned[t] = opposite ^ first_turned[root];
    ++out.counts[2 * std::size_t{number[root]} + out.turned[t]];
  }
  for (const std::uint32_t i : on_border) {
    const std::uint32_t t = edges[i].first / 2;
    if (out.part[t] == BucketWinding::kNoPart) continue;
    const std::uint64_t a = codes[static_cast<std::size_t>(edges[i].key >> 32)];
    const std::uint64_t b = codes[static_cast<std::size_t>(edges[i].key & 0xFFFFFFFFU)];
    const bool down = ((edges[i].first & 1U) != 0) != (a > b);
    out.open.push_back({std::min(a, b), std::max(a, b), out.part[t], down != (out.turned[t] != 0)});
  }
  return out;
}

void Winding::add(const BucketWinding& bucket) {
  const std::uint32_t first = first_.back();
  counts_.insert(counts_.end(), bucket.counts.begin(), bucket.counts.end());
  for (const BucketWinding::OpenEdge& e : bucket.open) open_.push_back({e.low, e.high, first + e.part, e.turned});
  first_.push_back(first + static_cast<std::uint32_t>(bucket.counts.size() / 2));
  non_orientable_ += bucket.non_orientable;
}

void Winding::finish() {
  std::sort(open_.begin(), open_.end(), [](const Edge& a, const Edge& b) {
    return std::tie(a.low, a.high, a.part, a.turned) < std::tie(b.low, b.high, b.part, b.turned);
  });
  const std::size_t parts = first_.back();
  OppositeSets sets(parts);
  std::vector<std::uint32_t> contradicted;
  for (std::size_t begin = 0, end = 0; begin < open_.size(); begin = end) {
    while (end < open_.size() && open_[end].low == open_[begin].low && open_[end].high == open_[begin].high) ++end;
    if (end - begin != 2) continue;
    const Edge& a = open_[begin];
    const Edge& b = open_[begin + 1];
    if (!sets.unite(a.part, b.part, a.turned == b.turned ? 1 : 0)) contradicted.push_back(a.part);
  }
  std::vector<std::uint8_t> broken(parts, 0);
  for (const std::uint32_t p : contradicted) {
    std::uint8_t& mark = broken[sets.find(p).first];
    non_orientable_ += mark == 0 ? 1 : 0;
    mark = 1;
  }

  // Each part's majority; what cannot be wound alike stays as it is.
  std::vector<std::uint64_t> sums(2 * parts, 0);
  for (std::uint32_t p = 0; p < parts; ++p) {
    const auto [root, opposite] = sets.find(p);
    for (std::size_t k = 0; k < 2; ++k) sums[2 * std::size_t{root} + (k ^ opposite)] += counts_[2 * std::size_t{p} + k];
  }
  flip_.assign(parts, 0);
  for (std::uint32_t p = 0; p < parts; ++p) {
    const auto [root, opposite] = sets.find(p);
    if (broken[root] != 0) {
      flip_[p] = 2;
      continue;
    }
    const bool minority = sums[2 * std::size_t{root} + 1] > sums[2 * std::size_t{root}];
    flip_[p] = static_cast<std::uint8_t>(opposite ^ (minority ? 1U : 0U));
    flipped_ += counts_[2 * std::size_t{p} + (flip_[p] != 0 ? 0 : 1)];
  }
  counts_ = {};
  open_ = {};
}

bool Winding::mayFlip(std::size_t bucket) const {
  // A part with turned triangles and one that is turned as a whole both need the bucket's own edges to say which.
  return first_[bucket] != first_[bucket + 1] && flipped_ > 0;
}

std::vector<std::uint8_t> Winding::flips(std::size_t bucket, const BucketWinding& measured) const {
  std::vector<std::uint8_t> flips(measured.part.size(), 0);
  for (std::size_t t = 0; t < flips.size(); ++t) {
    if (measured.part[t] == BucketWinding::kNoPart) continue;
    const std::uint8_t flip = flip_[first_[bucket] + measured.part[t]];
    if (flip != 2) flips[t] = measured.turned[t] ^ flip;
  }
  return flips;
}

void Winding::write(base::ByteWriter& out) const {
  out.u64(first_.size());
  for (const std::uint32_t f : first_) out.u32(f);
  out.bytes(flip_);
  out.u64(flipped_);
  out.u64(non_orientable_);
}

bool Winding::read(base::ByteReader& in) {
  const std::uint64_t buckets = in.u64();
  if (!in.ok() || buckets == 0 || buckets > in.remaining() / 4) return false;
  first_.resize(static_cast<std::size_t>(buckets));
  for (std::uint32_t& f : first_) f = in.u32();
  const base::ByteView flips = in.bytes(first_.back());
  flip_.assign(flips.begin(), flips.end());
  flipped_ = in.u64();
  non_orientable_ = in.u64();
  return in.ok();
}

}  // namespace lod::build
