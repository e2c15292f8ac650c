#include "lod/ingest/two_sided.h"

#include <bit>
#include <numeric>
#include <unordered_map>
#include <utility>
#include <vector>

namespace lod::ingest {
namespace {

/// Depends on the three codes, whatever their order.
std::uint64_t hashOf(const Corner* c) {
  const auto mixed = [](std::uint64_t code) {
    code *= 0x9E3779B97F4A7C15ULL;
    return (code ^ code >> 32) * 0xD6E8FEB86659FD93ULL;
  };
  return mixed(c[0].code) + mixed(c[1].code) + mixed(c[2].code);
}

enum class Match : std::uint8_t { kOther, kSame, kTurned };

Match compare(const Corner* a, const Corner* b) {
  std::size_t at = 0;
  while (at < 3 && b[at].code != a[0].code) ++at;
  if (at == 3) return Match::kOther;
  const std::uint64_t next = b[(at + 1) % 3].code, last = b[(at + 2) % 3].code;
  if (next == a[1].code && last == a[2].code) return Match::kSame;
  return next == a[2].code && last == a[1].code ? Match::kTurned : Match::kOther;
}

/// The first triangle of each set of corners, by its hash.
class FirstTriangles {
 public:
  explicit FirstTriangles(std::span<const Corner> corners)
      : corners_(corners), slots_(std::bit_ceil(corners.size() / 3 * 2 + 1)) {}

  /// Keeps the triangle where it is the first of its corners. Returns the first one, and how it is wound.
  std::pair<std::uint32_t, Match> find(std::uint32_t triangle) {
    const Corner* const own = &corners_[3 * std::size_t{triangle}];
    const std::uint64_t hash = hashOf(own);
    const auto mark = static_cast<std::uint32_t>(hash);
    for (std::size_t at = static_cast<std::size_t>(hash >> 32) & (slots_.size() - 1);;
         at = (at + 1) & (slots_.size() - 1)) {
      Slot& slot = slots_[at];
      if (slot.number == 0) {
        slot = {mark, triangle + 1};
        return {triangle, Match::kOther};
      }
      if (slot.mark != mark) continue;
      const Match match = compare(&corners_[3 * std::size_t{slot.number - 1}], own);
      if (match != Match::kOther) return {slot.number - 1, match};
    }
  }

 private:
  struct Slot {
    std::uint32_t mark = 0;    // a part of the hash
    std::uint32_t number = 0;  // the triangle's, plus 1; 0: nothing is here
  };
  std::span<const Corner> corners_;
  std::vector<Slot> slots_;
};

struct Turned {
  std::uint32_t first, other;
};

/// Sheets of triangles that are there in both windings, connected by edges.
class Sheets {
 public:
  Sheets(std::span<const Corner> corners, const std::vector<Turned>& turned)
      : corners_(corners), parents_(turned.size()) {
    std::iota(parents_.begin(), parents_.end(), 0U);
    is_fold_.resize(turned.size(), 0);
    edges_.reserve(3 * turned.size());
    for (std::uint32_t i = 0; i < turned.size(); ++i)
      for (std::size_t k = 0; k < 3; ++k) {
        const auto [at, is_new] = edges_.try_emplace(edge(turned[i].first, k), Edge{i, 0});
        if (!is_new) parents_[root(i)] = root(at->second.sheet);
      }
  }

  /// Takes a triangle of one winding into account.
  void add(std::uint32_t triangle) {
    for (std::size_t k = 0; k < 3; ++k) {
      const auto at = edges_.find(edge(triangle, k));
      if (at != edges_.end() && ++at->second.others == 2) is_fold_[root(at->second.sheet)] = 1;
    }
  }
  /// Whether the triangle's sheet hangs at an edge that two others close.
  bool isFold(std::uint32_t turned) { return is_fold_[root(turned)] != 0; }

 private:
  using Codes = std::pair<std::uint64_t, std::uint64_t>;
  struct Edge {
    std::uint32_t sheet;  // one of its triangles
    std::uint32_t others;
  };
  struct Hash {
    std::size_t operator()(const Codes& codes) const {
      return static_cast<std::size_t>((codes.first * 0x9E3779B97F4A7C15ULL ^ codes.second) * 0xD6E8FEB86659FD93ULL);
    }
  };

  Codes edge(std::uint32_t triangle, std::size_t k) const {
    const Corner* const c = &corners_[3 * std::size_t{triangle}];
    return std::minmax(c[k].code, c[(k + 1) % 3].code);
  }
  std::uint32_t root(std::uint32_t i) {
    while (parents_[i] != i) i = parents_[i] = parents_[parents_[i]];
    return i;
  }

  std::span<const Corner> corners_;
  std::vector<std::uint32_t> parents_;
  std::vector<std::uint8_t> is_fold_;  // by root
  std::unordered_map<Codes, Edge, Hash> edges_;
};

}  // namespace

std::vector<std::uint32_t> turnedOver(std::span<const Corner> corners) {
  const auto triangles = static_cast<std::uint32_t>(corners.size() / 3);
  std::vector<Turned> turned;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> repeated;  // a triangle, and the first of its corners
  FirstTriangles firsts(corners);
  for (std::uint32_t t = 0; t < triangles; ++t) {
    const auto [first, match] = firsts.find(t);
    if (match == Match::kTurned) turned.push_back({first, t});
    if (match == Match::kSame) repeated.emplace_back(t, first);
  }
  if (turned.empty()) return {};

  std::vector<bool> is_paired(triangles);
  for (const Turned& pair : turned) is_paired[pair.first] = is_paired[pair.other] = true;
  for (const auto& [triangle, first] : repeated)
    if (is_paired[first]) is_paired[triangle] = true;
  Sheets sheets(corners, turned);
  for (std::uint32_t t = 0; t < triangles; ++t)
    if (!is_paired[t]) sheets.add(t);

  std::vector<std::uint32_t> dropped;
  for (std::uint32_t i = 0; i < turned.size(); ++i)
    if (!sheets.isFold(i)) dropped.push_back(turned[i].other);
  return dropped;
}

}  // namespace lod::ingest
