#include "lod/ingest/buckets.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cstring>
#include <filesystem>
#include <mutex>
#include <utility>

#include "base/fields.h"
#include "base/parallel.h"
#include "lod/ingest/two_sided.h"
#include "lod/ingest/work_directory.h"

namespace lod::ingest {
namespace {

// About what measureWinding takes for a bucket.
constexpr std::uint64_t kWindingBytes = std::uint64_t{80} << 20;

constexpr std::uint8_t kStateVersion = 5;

void flipTriangles(const std::vector<bool>& flips, std::vector<BorderTriangle>& triangles) {
  if (flips.empty()) return;
  for (BorderTriangle& t : triangles) {
    if (!flips[t.triangle]) continue;
    std::swap(t.place[1], t.place[2]);
    std::swap(t.corner[1], t.corner[2]);
  }
}

}  // namespace

Buckets::Area Buckets::areaOf(const NumberedCorners& mesh) {
  std::vector<glm::ivec3> points;
  points.reserve(mesh.codes.size());
  for (const std::uint64_t code : mesh.codes) points.push_back(mortonPoint(code));
  Area area;
  for (std::size_t i = 0; i < mesh.number.size(); i += 3) {
    const std::uint32_t* c = &mesh.number[i];
    const glm::i64vec3 normal = latticeNormal(points[c[0]], points[c[1]], points[c[2]]);
    area.triangles += normal != glm::i64vec3(0) ? 1 : 0;
    area.facing += glm::dvec3(normal);
  }
  return area;
}

template <class Body>
base::Result<void> Buckets::forEachTriangle(std::size_t bucket, Body&& body) const {
  std::uint64_t left = counts_[bucket];
  base::Bytes packed;
  for (const Extent& extent : extents_[bucket]) {
    const auto bytes = static_cast<std::size_t>(extent.bytes);
    packed.resize(std::max(packed.size(), bytes + BucketPacking::kMaxTriangleBytes + BucketPacking::kSlack));
    LUMIGRID_TRY(file_.readAt(extent.offset, std::span(packed).first(bytes)));
    const std::uint8_t* from = packed.data();
    const std::uint8_t* const end = from + bytes;
    std::uint64_t before = 0;
    for (; from < end; --left) {
      if (left == 0) return damaged();
      std::array<Corner, 3> corners;
      std::uint64_t source = kNoSource;
      from = packing_.unpackTriangle(from, corners, before, source);
      body(corners, source);
    }
    if (from != end) return damaged();
  }
  return left == 0 ? base::Result<void>() : damaged();
}

base::Result<std::vector<Corner>> Buckets::readUnflipped(std::size_t bucket) const {
  std::vector<Corner> all;
  all.reserve(3 * static_cast<std::size_t>(counts_[bucket]));
  LUMIGRID_TRY(forEachTriangle(bucket, [&](const std::array<Corner, 3>& corners, std::uint64_t) {
    all.insert(all.end(), corners.begin(), corners.end());
  }));
  return all;
}

base::Result<std::vector<std::uint64_t>> Buckets::sources(std::size_t bucket) const {
  std::vector<std::uint64_t> all;
  all.reserve(static_cast<std::size_t>(counts_[bucket]));
  LUMIGRID_TRY(
      forEachTriangle(bucket, [&](const std::array<Corner, 3>&, std::uint64_t source) { all.push_back(source); }));
  return all;
}

base::Result<Buckets::NumberedBucket> Buckets::readNumbered(std::size_t bucket) const {
  auto kept = readKept(bucket);
  if (kept && kept->mesh.number.empty()) kept->mesh = NumberedCorners(kept->corners);
  return kept;
}

base::Result<Buckets::NumberedBucket> Buckets::readKept(std::size_t bucket) const {
  if (kept_) {
    NumberedBucket bucket_kept = std::move(*kept_);
    kept_.reset();
    return bucket_kept;
  }
  LUMIGRID_ASSIGN_OR_RETURN(auto corners, read(bucket));
  return NumberedBucket{std::move(corners), NumberedCorners()};
}

base::Result<std::vector<Corner>> Buckets::read(std::size_t bucket) const {
  if (kept_) return kept_->corners;
  LUMIGRID_ASSIGN_OR_RETURN(const auto flips, measureFlips(bucket));
  auto corners = readUnflipped(bucket);
  if (!corners) return corners;
  for (std::size_t t = 0; t < flips.size(); ++t)
    if (flips[t]) std::swap((*corners)[3 * t + 1], (*corners)[3 * t + 2]);
  return corners;
}

base::Result<std::vector<Corner>> Buckets::readOneSided(std::size_t bucket, std::mutex& mutex) {
  auto corners = readUnflipped(bucket);
  if (!corners) return corners;
  const std::vector<std::uint32_t> dropped = turnedOver(*corners);
  if (dropped.empty()) return corners;

  std::vector<std::uint64_t> numbers;
  if (packing_.has_sources) {
    LUMIGRID_ASSIGN_OR_RETURN(numbers, sources(bucket));
  }
  const std::size_t all = corners->size() / 3;
  base::Bytes packed((all - dropped.size()) * packing_.triangleBytes() + BucketPacking::kSlack);
  std::uint8_t* to = packed.data();
  std::uint64_t before = 0;
  std::size_t kept = 0;
  for (std::size_t t = 0, next = 0; t < all; ++t) {
    if (next < dropped.size() && dropped[next] == t) {
      ++next;
      continue;
    }
    std::copy_n(corners->begin() + static_cast<std::ptrdiff_t>(3 * t), 3,
                corners->begin() + static_cast<std::ptrdiff_t>(3 * kept));
    const std::span<const Corner, 3> triangle(&(*corners)[3 * kept], 3);
    to = packing_.packTriangle(triangle, kept == 0, before, numbers.empty() ? kNoSource : numbers[t], to);
    ++kept;
  }
  corners->resize(3 * kept);
  packed.resize(static_cast<std::size_t>(to - packed.data()));

  const std::lock_guard lock(mutex);
  for (const Extent& extent : extents_[bucket]) file_.release(extent.offset, extent.bytes);
  extents_[bucket] = {{file_.size(), packed.size()}};
  counts_[bucket] = kept;
  totals_.triangles -= dropped.size();
  totals_.two_sided += dropped.size();
  LUMIGRID_TRY(file_.append(packed));
  return corners;
}

base::Result<void> Buckets::findBorderEdges(unsigned threads, BorderEdges& border) {
  std::mutex mutex;
  LUMIGRID_TRY(base::tryParallelFor(count(), threads, [&](std::size_t bucket) -> base::Result<void> {
    LUMIGRID_ASSIGN_OR_RETURN(const auto corners, readOneSided(bucket, mutex));
    std::vector<BorderEdge> edges = borderEdges(NumberedCorners(corners), corners);
    const auto shared = std::partition(edges.begin(), edges.end(), [this](const BorderEdge& e) {
      return border_.find(e.from) < 0 || border_.find(e.to) < 0;
    });
    const auto own = static_cast<std::size_t>(shared - edges.begin());
    const std::lock_guard lock(mutex);
    return border.add(std::span(edges).first(own), std::span(edges).subspan(own));
  }));
  LUMIGRID_TRY(file_.flush());
  return border.flush();
}

std::vector<std::uint32_t> Buckets::borderPlaces(const NumberedCorners& mesh) const {
  std::vector<std::uint32_t> places;
  places.reserve(mesh.codes.size());
  for (const std::uint64_t code : mesh.codes) {
    const std::int64_t at = border_.find(code);
    places.push_back(at < 0 ? kNotOnBorder : static_cast<std::uint32_t>(at));
  }
  return places;
}

// Stores for each triangle its place, its corners' places on the border, and its corners. One thread at a time.
base::Result<void> Buckets::storeBorder(std::size_t bucket, std::span<const BorderTriangle> triangles) {
  base::Bytes packed(triangles.size() * packing_.borderTriangleBytes());
  std::uint8_t* to = packed.data();
  for (const BorderTriangle& t : triangles) {
    std::memcpy(to, &t.triangle, sizeof(t.triangle)), to += sizeof(t.triangle);
    std::memcpy(to, t.place, sizeof(t.place)), to += sizeof(t.place);
    for (const Corner& corner : t.corner) to = packing_.pack(corner, to);
  }
  border_extents_[bucket] = {file_.size(), packed.size()};
  return file_.append(packed);
}

base::Result<std::vector<BorderTriangle>> Buckets::readUnflippedBorder(std::size_t bucket) const {
  base::Bytes packed(static_cast<std::size_t>(border_extents_[bucket].bytes));
  LUMIGRID_TRY(file_.readAt(border_extents_[bucket].offset, packed));
  std::vector<BorderTriangle> out(packed.size() / packing_.borderTriangleBytes());
  const std::uint8_t* from = packed.data();
  for (BorderTriangle& t : out) {
    std::memcpy(&t.triangle, from, sizeof(t.triangle)), from += sizeof(t.triangle);
    std::memcpy(t.place, from, sizeof(t.place)), from += sizeof(t.place);
    for (Corner& corner : t.corner) from = packing_.unpack(from, corner);
    const bool inside = std::all_of(std::begin(t.place), std::end(t.place), [this](std::uint32_t place) {
      return place == kNotOnBorder || place < border_.codes.size();
    });
    if (!inside || t.triangle >= counts_[bucket]) return damaged();
  }
  return out;
}

base::Result<std::vector<BorderTriangle>> Buckets::borderTriangles(std::size_t bucket) const {
  LUMIGRID_ASSIGN_OR_RETURN(const auto flips, measureFlips(bucket));
  auto triangles = readUnflippedBorder(bucket);
  if (triangles) flipTriangles(flips, *triangles);
  return triangles;
}

// Adds the triangles' normals, colours and given normals to their border vertices. Safe from several threads.
void Buckets::addToBorder(std::span<const BorderTriangle> triangles) {
  const auto add = [](std::int64_t& sum, std::int64_t value) {
    if (value != 0) std::atomic_ref(sum).fetch_add(value, std::memory_order_relaxed);
  };
  for (const BorderTriangle& t : triangles) {
    const auto facet =
        facetAtCorners(mortonPoint(t.corner[0].code), mortonPoint(t.corner[1].code), mortonPoint(t.corner[2].code));
    for (std::size_t c = 0; c < 3; ++c) {
      if (t.place[c] == kNotOnBorder) continue;
      VertexSums share;
      share.add(facet[c], t.corner[c]);
      VertexSums& sums = border_.sums[t.place[c]];
      for (int k = 0; k < 3; ++k) {
        add(sums.facets.by_area[k], share.facets.by_area[k]);
        add(sums.facets.by_angle[k], share.facets.by_angle[k]);
        add(sums.normal[k], share.normal[k]);
        add(sums.color[k], share.color[k]);
      }
      add(sums.facets.angle, share.facets.angle);
      add(sums.colored, share.colored);
    }
  }
}

// The run that measured the flips has them in memory; a later run measures them again.
base::Result<Buckets::Flips> Buckets::measureFlips(std::size_t bucket) const {
  if (!winding_.mayFlip(bucket)) return Flips();
  if (!flips_.empty()) return flips_[bucket];
  LUMIGRID_ASSIGN_OR_RETURN(const auto corners, readUnflipped(bucket));
  const NumberedCorners mesh(corners);
  return flipsOf(bucket, measureWinding(mesh, borderPlaces(mesh)).part);
}

Buckets::Flips Buckets::flipsOf(std::size_t bucket, std::span<const std::uint32_t> part) const {
  Flips flips;
  if (!winding_.mayFlip(bucket)) return flips;
  flips.resize(part.size());
  for (std::size_t t = 0; t < flips.size(); ++t)
    flips[t] = part[t] != BucketWinding::kNoPart && winding_.flips(bucket, part[t]);
  return flips;
}

// Collects the results of checking all buckets once.
struct Buckets::WindingPass {
  std::atomic<bool> consistent = true;
  std::mutex mutex;
  std::vector<OpenEdge> open;                          // while all are consistent
  std::uint64_t inner_open = 0;                        // the same
  std::vector<std::optional<BucketWinding>> measured;  // by bucket, once one is not
  std::uint64_t max_parts = 0;                         // triangles whose part fits the memory
  std::atomic<std::uint64_t> parts = 0;
};

// Most meshes are wound consistently. A check of their edges shows it, and the border sums added meanwhile hold. From
// the first bucket on that is not consistent, buckets are measured instead.
base::Result<void> Buckets::checkBucket(std::size_t bucket, WindingPass& pass) {
  LUMIGRID_ASSIGN_OR_RETURN(auto corners, readOneSided(bucket, pass.mutex));
  NumberedCorners mesh(corners);
  const std::vector<std::uint32_t> places = borderPlaces(mesh);
  areas_[bucket] = areaOf(mesh);
  std::vector<BorderTriangle> on_border;
  for (std::size_t i = 0; i < corners.size(); i += 3) {
    const std::uint32_t place[3] = {places[mesh.number[i]], places[mesh.number[i + 1]], places[mesh.number[i + 2]]};
    if (std::min({place[0], place[1], place[2]}) == kNotOnBorder) continue;
    const Corner* c = &corners[i];
    on_border.push_back({static_cast<std::uint32_t>(i / 3), {place[0], place[1], place[2]}, {c[0], c[1], c[2]}});
  }
  WindingCheck check;
  if (pass.consistent) check = checkWinding(mesh, places);
  if (!check.consistent) pass.consistent = false;
  if (pass.consistent)
    addToBorder(on_border);
  else
    pass.measured[bucket] = measureBucket(mesh, places, pass);
  if (count() == 1 && pass.consistent) kept_ = NumberedBucket{std::move(corners), std::move(mesh)};
  const std::lock_guard lock(pass.mutex);
  pass.open.insert(pass.open.end(), check.open.begin(), check.open.end());
  pass.inner_open += check.inner_open;
  return storeBorder(bucket, on_border);
}

BucketWinding Buckets::measureBucket(const NumberedCorners& mesh, std::span<const std::uint32_t> places,
                                     WindingPass& pass) const {
  BucketWinding measured = measureWinding(mesh, places);
  // Parts that the memory does not hold are measured again when triangles are flipped.
  if (pass.parts.fetch_add(measured.part.size()) + measured.part.size() > pass.max_parts) measured.part = {};
  return measured;
}

base::Result<void> Buckets::makeWindingConsistent(base::ResourceLimits limits) {
  WindingPass pass;
  pass.measured.resize(count());
  pass.max_parts = limits.memory_bytes / 4 / sizeof(std::uint32_t);
  const std::uint64_t at_once = std::max<std::uint64_t>(1, limits.memory_bytes / 4 * 3 / kWindingBytes);
  const auto threads = static_cast<unsigned>(std::min<std::uint64_t>(std::max(1U, limits.threads), at_once));
  border_.sums.assign(border_.codes.size(), {});
  border_extents_.resize(count());
  areas_.resize(count());
  LUMIGRID_TRY(base::tryParallelFor(count(), threads, [&](std::size_t bucket) { return checkBucket(bucket, pass); }));
  LUMIGRID_TRY(file_.flush());
  if (pass.consistent) {
    const SharedEdges shared = compareEdges(pass.open);
    if (shared.run_oppositely) {
      winding_.setConsistent(count(), pass.inner_open + shared.open);
      return {};
    }
  }
  pass.open = {};
  kept_.reset();
  return flipMinorities(pass, threads);
}

base::Result<void> Buckets::flipMinorities(WindingPass& pass, unsigned threads) {
  LUMIGRID_TRY(base::tryParallelFor(count(), threads, [&](std::size_t bucket) -> base::Result<void> {
    if (pass.measured[bucket]) return {};
    LUMIGRID_ASSIGN_OR_RETURN(const auto corners, readUnflipped(bucket));
    const NumberedCorners mesh(corners);
    pass.measured[bucket] = measureBucket(mesh, borderPlaces(mesh), pass);
    return {};
  }));
  for (std::optional<BucketWinding>& measured : pass.measured) {
    winding_.add(*measured);
    measured->parts = {}, measured->open = {}, measured->opposing = {};
  }
  winding_.finish();

  std::vector<Flips> flips(count());
  border_.sums.assign(border_.codes.size(), {});
  LUMIGRID_TRY(base::tryParallelFor(count(), threads, [&](std::size_t bucket) -> base::Result<void> {
    const std::vector<std::uint32_t>& part = pass.measured[bucket]->part;
    LUMIGRID_ASSIGN_OR_RETURN(flips[bucket], part.empty() ? measureFlips(bucket) : flipsOf(bucket, part));
    LUMIGRID_ASSIGN_OR_RETURN(auto triangles, readUnflippedBorder(bucket));
    flipTriangles(flips[bucket], triangles);
    addToBorder(triangles);
    return {};
  }));
  flips_ = std::move(flips);
  return {};
}

base::Error Buckets::damaged() const {
  return damagedWorkFiles(std::filesystem::path(file_.path()).parent_path());
}

void Buckets::release() {
  kept_.reset();
  file_.release(0, file_.size());
}

base::Bytes Buckets::encodeTables() const {
  base::ByteWriter out;
  out.u8(kStateVersion);
  base::writeFields(out, std::tie(packing_.has_colors, packing_.has_normals, packing_.has_sources, totals_));
  out.u64(file_.size());
  out.u64(count());
  for (std::size_t b = 0; b < count(); ++b) {
    out.u64(counts_[b]);
    out.u64(extents_[b].size());
    for (const Extent& extent : extents_[b]) out.write(extent);
    out.write(border_extents_[b]);
  }
  out.u64(border_.codes.size());
  for (const std::uint64_t code : border_.codes) out.u64(code);
  for (const VertexSums& sums : border_.sums) out.write(sums);
  winding_.write(out);
  return out.takeBytes();
}

base::Result<Buckets> Buckets::open(const std::string& directory, base::ByteView state) {
  const base::Error broken = damagedWorkFiles(directory);
  LUMIGRID_ASSIGN_OR_RETURN(auto file, SpoolFile::open(directory + "/buckets"));
  Buckets out;
  base::ByteReader in(state);
  if (in.u8() != kStateVersion) return broken;
  base::readFields(in,
                   std::tie(out.packing_.has_colors, out.packing_.has_normals, out.packing_.has_sources, out.totals_));
  if (in.u64() != file.size()) return broken;
  const std::uint64_t buckets = in.u64();
  if (!in.ok() || buckets > in.remaining() / 16) return broken;
  out.extents_.resize(static_cast<std::size_t>(buckets));
  out.counts_.resize(static_cast<std::size_t>(buckets));
  out.border_extents_.resize(static_cast<std::size_t>(buckets));
  for (std::size_t b = 0; b < buckets; ++b) {
    out.counts_[b] = in.u64();
    const std::uint64_t extents = in.u64();
    if (!in.ok() || extents > in.remaining() / sizeof(Extent)) return broken;
    for (std::uint64_t e = 0; e < extents; ++e) out.extents_[b].push_back(in.read<Extent>());
    out.border_extents_[b] = in.read<Extent>();
  }
  const std::uint64_t border = in.u64();
  if (!in.ok() || border > in.remaining() / (8 + sizeof(VertexSums))) return broken;
  for (std::uint64_t i = 0; i < border; ++i) out.border_.codes.push_back(in.u64());
  for (std::uint64_t i = 0; i < border; ++i) out.border_.sums.push_back(in.read<VertexSums>());
  if (!out.winding_.read(in) || !in.atEnd()) return broken;
  out.border_.makeFilter();
  out.file_ = std::move(file);
  return out;
}

}  // namespace lod::ingest
