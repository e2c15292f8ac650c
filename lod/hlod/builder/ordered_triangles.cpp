#include "lod/hlod/builder/ordered_triangles.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <tuple>

#include "base/parallel.h"
#include "lod/hlod/builder/node_mesh.h"
#include "lod/ingest/morton.h"
#include "lod/ingest/work_directory.h"

namespace lod::hlod::builder {
namespace {

using Triangle = std::array<ingest::Corner, 3>;
static_assert(sizeof(Triangle) == OrderedTriangles::kBytes);

std::uint64_t codeOf(const ingest::Corner* c) {
  return ingest::medianCode(c[0].code, c[1].code, c[2].code);
}

std::uint32_t packColor(const glm::u8vec4& color) {
  return std::uint32_t{color.r} | std::uint32_t{color.g} << 8 | std::uint32_t{color.b} << 16 | 255U << 24;
}

/// A bucket's triangles in order.
struct OrderedBucket {
  std::vector<Triangle> triangles;
  std::uint64_t duplicates = 0, vertices = 0;
};

/// Each vertex gets the mean of its corners in all buckets.
void averageCorners(const ingest::Buckets& buckets, ingest::Buckets::NumberedBucket& bucket, OrderedBucket& out) {
  const auto& codes = bucket.mesh.codes;
  const auto& number = bucket.mesh.number;
  std::vector<ingest::VertexSums> sums(codes.size());
  for (std::size_t c = 0; c < number.size(); c += 3) {
    const auto facet = ingest::facetAtCorners(ingest::mortonPoint(bucket.corners[c].code),
                                              ingest::mortonPoint(bucket.corners[c + 1].code),
                                              ingest::mortonPoint(bucket.corners[c + 2].code));
    for (std::size_t k = 0; k < 3; ++k) sums[number[c + k]].add(facet[k], bucket.corners[c + k]);
  }
  std::vector<std::uint8_t> is_open(codes.size(), 0);
  for (const OpenEdge edge : openEdges(number)) {
    const glm::uvec2 ends = endsOf(edge, number);
    is_open[ends.x] = is_open[ends.y] = 1;
  }
  std::vector<ingest::Corner> vertices(codes.size());
  for (std::size_t v = 0; v < codes.size(); ++v) {
    const std::int64_t at = buckets.border().find(codes[v]);
    const ingest::VertexSums& sum = at >= 0 ? buckets.border().sums[static_cast<std::size_t>(at)] : sums[v];
    // Open edges between vertices that other buckets have, too, may go on there.
    const std::uint32_t mark = at < 0 && is_open[v] != 0 ? kOnRim : 0;
    const std::uint32_t normal = ingest::packNormal(sum.unitNormal()) & 0xFFFFFFU;
    vertices[v] = {codes[v], buckets.hasColors() ? packColor(sum.meanColor()) : 0, normal | mark};
    out.vertices += at < 0 ? 1 : 0;
  }
  for (std::size_t c = 0; c < number.size(); ++c) bucket.corners[c] = vertices[number[c]];
}

auto sameKey(const Triangle& t) {
  return std::tuple(t[0].code, t[1].code, t[2].code);
}
/// The corners from the smallest on, in their winding.
Triangle rotated(const ingest::Corner* c) {
  std::size_t least = 0;
  for (std::size_t k = 1; k < 3; ++k)
    if (c[k].code < c[least].code) least = k;
  return {c[least], c[(least + 1) % 3], c[(least + 2) % 3]};
}

base::Result<OrderedBucket> orderBucket(const ingest::Buckets& buckets, std::size_t number, std::uint32_t bits) {
  OrderedBucket out;
  if (buckets.triangles(number) == 0) return out;
  LUMIGRID_ASSIGN_OR_RETURN(auto bucket, buckets.readNumbered(number));
  averageCorners(buckets, bucket, out);
  std::vector<ingest::KeyedIndex> sorted(bucket.corners.size() / 3);
  for (std::uint32_t t = 0; t < sorted.size(); ++t) sorted[t] = {codeOf(&bucket.corners[3 * std::size_t{t}]), t};
  ingest::radixSort(sorted, 3 * bits);
  out.triangles.reserve(sorted.size());
  // Triangles with the same corners share a median code.
  for (std::size_t begin = 0, end = 0; begin < sorted.size(); begin = end) {
    const std::size_t first = out.triangles.size();
    for (; end < sorted.size() && sorted[end].key == sorted[begin].key; ++end)
      out.triangles.push_back(rotated(&bucket.corners[3 * std::size_t{sorted[end].index}]));
    if (end - begin < 2) continue;
    const auto from = out.triangles.begin() + static_cast<std::ptrdiff_t>(first);
    std::sort(from, out.triangles.end(), [](const Triangle& a, const Triangle& b) { return sameKey(a) < sameKey(b); });
    const auto kept = std::unique(from, out.triangles.end(),
                                  [](const Triangle& a, const Triangle& b) { return sameKey(a) == sameKey(b); });
    out.duplicates += static_cast<std::uint64_t>(out.triangles.end() - kept);
    out.triangles.erase(kept, out.triangles.end());
  }
  return out;
}

base::ByteView viewOf(std::span<const Triangle> triangles) {
  return {reinterpret_cast<const std::uint8_t*>(triangles.data()), triangles.size_bytes()};
}

}  // namespace

base::Result<OrderedTriangles> OrderedTriangles::order(const ingest::Buckets& buckets, std::uint32_t lattice_bits,
                                                       const std::string& directory, unsigned threads,
                                                       const std::function<bool(double)>& progress) {
  OrderedTriangles ordered;
  ordered.colors_ = buckets.hasColors();
  ordered.vertices_ = buckets.border().codes.size();
  LUMIGRID_ASSIGN_OR_RETURN(ordered.file_, ingest::SpoolFile::create(directory + "/ordered"));
  std::vector<OrderedBucket> slots(std::max(threads, 1U));
  // Only one call may read a bucket that was kept in memory, which there is where it is the only one.
  const auto produce = [&](std::size_t b, std::size_t slot) -> base::Result<void> {
    LUMIGRID_ASSIGN_OR_RETURN(slots[slot], orderBucket(buckets, b, lattice_bits));
    return {};
  };
  const auto consume = [&](std::size_t b, std::size_t slot) -> base::Result<void> {
    for (const Triangle& t : slots[slot].triangles)
      if (ordered.count_++ % kStride == 0) ordered.sampled_.push_back(codeOf(t.data()));
    ordered.duplicates_ += slots[slot].duplicates;
    ordered.vertices_ += slots[slot].vertices;
    LUMIGRID_TRY(ordered.file_.append(viewOf(slots[slot].triangles)));
    slots[slot] = {};
    if (progress && !progress(static_cast<double>(b + 1) / static_cast<double>(buckets.count())))
      return base::Error{base::ErrorCode::kCancelled, "building the nodes was cancelled"};
    return {};
  };
  LUMIGRID_TRY(base::parallelInOrder(buckets.count(), threads, slots.size(), produce, consume));
  LUMIGRID_TRY(ordered.file_.flush());
  return ordered;
}

void OrderedTriangles::writeTables(base::ByteWriter& out) const {
  for (const std::uint64_t number : {count_, duplicates_, vertices_}) out.u64(number);
  out.u8(colors_ ? 1 : 0);
  for (const std::uint64_t code : sampled_) out.u64(code);
}

base::Result<OrderedTriangles> OrderedTriangles::open(const std::string& directory, base::ByteReader& state) {
  OrderedTriangles ordered;
  for (std::uint64_t* number : {&ordered.count_, &ordered.duplicates_, &ordered.vertices_}) *number = state.u64();
  ordered.colors_ = state.u8() != 0;
  LUMIGRID_ASSIGN_OR_RETURN(ordered.file_, ingest::SpoolFile::open(directory + "/ordered"));
  if (!state.ok() || ordered.file_.size() != ordered.count_ * kBytes) return ingest::damagedWorkFiles(directory);
  for (std::uint64_t i = 0; i < (ordered.count_ + kStride - 1) / kStride; ++i) ordered.sampled_.push_back(state.u64());
  if (!state.ok()) return ingest::damagedWorkFiles(directory);
  return ordered;
}

base::Result<std::uint64_t> OrderedTriangles::lowerBound(std::uint64_t code) const {
  const auto above = std::lower_bound(sampled_.begin(), sampled_.end(), code);
  if (above == sampled_.begin()) return 0;
  const std::uint64_t first = kStride * static_cast<std::uint64_t>(above - sampled_.begin() - 1);
  LUMIGRID_ASSIGN_OR_RETURN(const auto corners, read(first, std::min(kStride, count_ - first)));
  std::uint64_t at = first;
  for (std::size_t c = 0; c < corners.size() && codeOf(&corners[c]) < code; c += 3) ++at;
  return at;
}

base::Result<std::vector<ingest::Corner>> OrderedTriangles::read(std::uint64_t first, std::uint64_t count) const {
  std::vector<ingest::Corner> corners(3 * static_cast<std::size_t>(count));
  LUMIGRID_TRY(file_.readAt(
      first * kBytes, {reinterpret_cast<std::uint8_t*>(corners.data()), corners.size() * sizeof(ingest::Corner)}));
  return corners;
}

void OrderedTriangles::release() {
  file_.release(0, file_.size());
}

}  // namespace lod::hlod::builder
