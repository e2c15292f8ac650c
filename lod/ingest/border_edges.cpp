#include "lod/ingest/border_edges.h"

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <limits>
#include <system_error>
#include <type_traits>

#include "base/bytes.h"
#include "lod/ingest/morton.h"

namespace lod::ingest {
namespace {

static_assert(std::is_trivially_copyable_v<BorderEdge> && sizeof(BorderEdge) == 32);

// Bins in which edges are counted along the axis, as a power of two; slabs end between two of them.
constexpr std::uint32_t kBinBits = 12;

base::ByteView bytesOf(std::span<const BorderEdge> edges) {
  return {reinterpret_cast<const std::uint8_t*>(edges.data()), edges.size_bytes()};
}

// Adds those of `shared` that only one bucket has.
void dropPairs(std::vector<BorderEdge>& edges, std::vector<BorderEdge>& shared) {
  const auto key = [](const BorderEdge& e) { return std::minmax(e.from, e.to); };
  std::sort(shared.begin(), shared.end(), [&](const auto& a, const auto& b) { return key(a) < key(b); });
  for (std::size_t begin = 0, end = 0; begin < shared.size(); begin = end) {
    while (end < shared.size() && key(shared[end]) == key(shared[begin])) ++end;
    if (end - begin == 1) edges.push_back(shared[begin]);
  }
}

}  // namespace

base::Result<BorderEdges> BorderEdges::create(const std::string& path, int axis, std::uint32_t bits) {
  BorderEdges out;
  LUMIGRID_ASSIGN_OR_RETURN(out.file_, SpoolFile::create(path));
  out.axis_ = axis;
  out.bin_shift_ = bits > kBinBits ? bits - kBinBits : 0;
  out.begins_.assign(std::size_t{1} << (bits - out.bin_shift_), 0);
  out.ends_ = out.begins_;
  return out;
}

BorderEdges::Range BorderEdges::rangeOf(const BorderEdge& edge) const {
  const int from = mortonPoint(edge.from)[axis_], to = mortonPoint(edge.to)[axis_];
  return {std::min(from, to), std::max(from, to)};
}

base::Result<void> BorderEdges::add(std::span<const BorderEdge> own, std::span<const BorderEdge> shared) {
  if (own.empty() && shared.empty()) return {};
  Block block{file_.size(), own.size(), own.size() + shared.size(), std::numeric_limits<int>::max(), 0};
  for (const std::span<const BorderEdge> edges : {own, shared}) {
    for (const BorderEdge& edge : edges) {
      const Range range = rangeOf(edge);
      block.low = std::min(block.low, range.low), block.high = std::max(block.high, range.high);
      ++begins_[static_cast<std::size_t>(range.low >> bin_shift_)];
      ++ends_[static_cast<std::size_t>(range.high >> bin_shift_)];
    }
    LUMIGRID_TRY(file_.append(bytesOf(edges)));
  }
  count_ += block.all;
  blocks_.push_back(block);
  return {};
}

// At least as many edges as touch the bins of these steps.
std::uint64_t BorderEdges::touching(int low, int high) const {
  const auto bins = static_cast<int>(begins_.size());
  const int first = std::clamp(low >> bin_shift_, 0, bins), last = std::clamp(high >> bin_shift_, 0, bins - 1);
  std::uint64_t edges = 0;
  for (int bin = 0; bin <= last; ++bin) edges += begins_[static_cast<std::size_t>(bin)];
  for (int bin = 0; bin < first; ++bin) edges -= ends_[static_cast<std::size_t>(bin)];
  return edges;
}

std::optional<std::vector<BorderSlab>> BorderEdges::slabs(std::uint64_t most, int beside) const {
  BorderSlab slab;
  slab.axis = axis_, slab.beside = beside;
  std::vector<BorderSlab> out;
  if (count_ <= most) return std::vector{slab};
  const auto bins = static_cast<int>(begins_.size());
  for (int begin = 0, end = 0; begin < bins; begin = end) {
    const int low = (begin << bin_shift_) - beside;
    const auto fits = [&](int last) { return touching(low, ((last + 1) << bin_shift_) - 1 + beside) <= most; };
    if (!fits(begin)) return std::nullopt;
    // The last bin of the slab, by bisection.
    int fitting = begin, too_far = bins;
    while (too_far - fitting > 1) (fits((fitting + too_far) / 2) ? fitting : too_far) = (fitting + too_far) / 2;
    end = fitting + 1;
    slab.begin = begin << bin_shift_;
    slab.end = end << bin_shift_;
    out.push_back(slab);
  }
  return out;
}

base::Result<std::vector<BorderEdge>> BorderEdges::read(const BorderSlab& slab) const {
  std::vector<BorderEdge> out, shared, block_edges;
  base::Bytes bytes;
  for (const Block& block : blocks_) {
    if (!slab.touches(block.low, block.high)) continue;
    bytes.resize(block.all * sizeof(BorderEdge));
    LUMIGRID_TRY(file_.readAt(block.offset, bytes));
    block_edges.resize(block.all);
    std::memcpy(block_edges.data(), bytes.data(), bytes.size());
    for (std::size_t i = 0; i < block_edges.size(); ++i) {
      const Range range = rangeOf(block_edges[i]);
      if (slab.touches(range.low, range.high)) (i < block.own ? out : shared).push_back(block_edges[i]);
    }
  }
  dropPairs(out, shared);
  return out;
}

void BorderEdges::remove() {
  std::error_code ignored;
  std::filesystem::remove(file_.path(), ignored);
}

}  // namespace lod::ingest
