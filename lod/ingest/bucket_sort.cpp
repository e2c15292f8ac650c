// Sorts the spooled triangles into buckets: splitters are quantiles of a sample of the vertices, and the triangles'
// corners are looked up in windows of vertices that fit the memory.
#include <algorithm>
#include <cstring>
#include <filesystem>
#include <memory>
#include <span>
#include <utility>

#include "base/format_text.h"
#include "base/parallel.h"
#include "lod/ingest/buckets.h"

namespace lod::ingest {
namespace {

using base::Error;
using base::ErrorCode;

// With so many samples for each bucket its size is within a few hundredths of what was asked.
constexpr std::uint64_t kBucketSamples = 2048;
constexpr std::uint64_t kMaxSamples = std::uint64_t{1} << 20;  // 8 MB
// Top bits of a code by which the table finds its bucket; fewer for few buckets, whose table would be longer than a
// small mesh.
constexpr std::uint32_t kTableBits = 18;
constexpr std::uint32_t kSmallTableBits = 12;
constexpr std::size_t kFewSplitters = 16;
constexpr std::size_t kMaxBlocks = 10;                           // in memory at a time, each of some ten megabytes
constexpr std::uint32_t kMaxRunTriangles = 256;                  // so that no buffer grows far beyond its limit
constexpr std::uint64_t kBufferBytes = std::uint64_t{64} << 20;  // bytes of all buckets together

// The corners of a triangle, as far as the windows so far have filled them in.
struct CornerRecord {
  Corner corner[3];
};

}  // namespace

class BucketSorter {
 public:
  BucketSorter(const SourceSpool& source, const SourceInfo& info, const SourceLattice& lattice,
               const std::string& directory, const BucketOptions& options)
      : source_(source), info_(info), lattice_(lattice), directory_(directory), options_(options) {}

  base::Result<Buckets> run() {
    LUMIGRID_TRY(sort());
    LUMIGRID_TRY(stitch());
    codes_.reset();
    colors_.reset();
    normals_.reset();
    out_.border_.makeFilter();
    LUMIGRID_TRY(out_.makeWindingConsistent(options_.limits));
    std::uint64_t with_area = 0;
    for (const Buckets::Area& area : out_.areas_) {
      with_area += area.triangles;
      out_.totals_.facing += area.facing;
    }
    out_.areas_ = {};
    // Triangles without an area are kept beside others, since closed meshes would open without them.
    if (with_area == 0) return Error{ErrorCode::kInvalidInput, "no triangle " + reasonForNone()};
    return std::move(out_);
  }

 private:
  std::string reasonForNone() const {
    if (out_.totals_.collapsed == 0) return "is left after cleaning (all are degenerate)";
    if (lattice_.bits < kMaxLatticeBits)
      return "keeps its area on a lattice of " + std::to_string(lattice_.bits) +
             " bits: the mesh has no extent, or raise --position-bits";
    const glm::dvec3& far = info_.far_place;
    return "keeps its area on a lattice of 21 bits, the finest: the mesh has no extent, or what lies at " +
           base::formatText("(%.7g, %.7g, %.7g)", far.x, far.y, far.z) + " makes its box too large; remove that";
  }

  // Sorts all triangles, stitched as far as it is known how.
  base::Result<void> sort() {
    out_ = {};
    border_ = {};
    LUMIGRID_ASSIGN_OR_RETURN(out_.file_, SpoolFile::create(directory_ + "/buckets"));
    out_.packing_ = {info_.has_colors, info_.has_normals, options_.keeps_textures && !info_.pictures.empty()};
    if (out_.packing_.has_sources) {
      LUMIGRID_ASSIGN_OR_RETURN(textures_, TexturePlaces::create(directory_));
    }

    // A window has as many vertices as the memory holds.
    const std::uint64_t vertex_bytes = out_.packing_.cornerBytes();
    const std::uint64_t window = std::max<std::uint64_t>(options_.limits.memory_bytes / vertex_bytes, 1U << 16);
    const std::uint64_t windows = (info_.vertices + window - 1) / window;
    const std::uint64_t samples = std::min(kMaxSamples, kBucketSamples * bucketsWanted());
    stride_ = std::max<std::uint64_t>(1, info_.vertices / samples);
    if (windows > 1) {
      LUMIGRID_ASSIGN_OR_RETURN(corners_, SpoolFile::create(directory_ + "/corners"));
    }
    for (std::uint64_t w = 0; w < windows; ++w) {
      LUMIGRID_TRY(loadWindow(w * window, std::min(info_.vertices, (w + 1) * window), w == 0));
      if (w == 0) chooseSplitters();
      LUMIGRID_TRY(
          gatherTriangles(w == 0, w + 1 == windows, (static_cast<double>(w) + 1.0) / static_cast<double>(windows)));
    }
    if (windows > 1) {
      std::error_code ignored;
      std::filesystem::remove(corners_.path(), ignored);
    }
    if (!stitches_.fills().empty()) LUMIGRID_TRY(storeFills());
    for (std::size_t b = 0; b < buffers_.size(); ++b) LUMIGRID_TRY(flush(b));
    buffers_ = std::vector<base::Bytes>();
    splitters_ = std::vector<std::uint64_t>();
    LUMIGRID_TRY(out_.file_.flush());
    if (out_.packing_.has_sources) LUMIGRID_TRY(textures_.flush());
    std::sort(border_.begin(), border_.end());
    border_.erase(std::unique(border_.begin(), border_.end()), border_.end());
    out_.border_.codes = std::move(border_);
    out_.border_.makeFilter();
    return {};
  }

  // Finds what is to be stitched, and sorts once more where that is something: a stitched vertex may belong to another
  // bucket, and the first sort is what tells which edges are open.
  base::Result<void> stitch() {
    if (!options_.stitch.on) return {};
    const glm::dvec3 size = info_.box_max - info_.box_min;
    const int axis = size.x >= std::max(size.y, size.z) ? 0 : size.y >= size.z ? 1 : 2;
    LUMIGRID_ASSIGN_OR_RETURN(auto border, BorderEdges::create(directory_ + "/border", axis, lattice_.bits));
    LUMIGRID_TRY(out_.findBorderEdges(options_.limits.threads, border));
    const double step = lattice_.lattice.step;
    const StitchScale scale{options_.stitch.length / step, info_.mean_edge / step, glm::length(size) / step};
    const std::uint64_t most = options_.limits.memory_bytes / kStitchBytesPerEdge;
    LUMIGRID_ASSIGN_OR_RETURN(stitches_, findStitches(border, scale, most, options_.limits.threads));
    border.remove();
    is_two_sided_ = out_.totals_.two_sided > 0;
    if (!stitches_.empty()) LUMIGRID_TRY(sort());
    out_.totals_.stitched = stitches_.counts();
    return {};
  }

  std::uint64_t bucketsWanted() const { return (info_.vertices + Buckets::kVertices - 1) / Buckets::kVertices; }

  // Puts vertices first … last − 1 on the lattice. The first window also samples all vertices.
  base::Result<void> loadWindow(std::uint64_t first, std::uint64_t last, bool sampling) {
    first_ = first;
    last_ = last;
    const auto size = static_cast<std::size_t>(last - first);
    // Nothing is initialised, since the threads write every element.
    if (!codes_ || size > room_) {
      room_ = size;
      codes_ = std::make_unique_for_overwrite<std::uint64_t[]>(size);
      if (out_.packing_.has_colors) colors_ = std::make_unique_for_overwrite<std::uint32_t[]>(size);
      if (out_.packing_.has_normals) normals_ = std::make_unique_for_overwrite<std::uint32_t[]>(size);
    }
    if (sampling) samples_.resize(static_cast<std::size_t>((info_.vertices + stride_ - 1) / stride_));
    return base::tryParallelFor(
        source_.vertexBlocks(), options_.limits.threads, [&](std::size_t b) -> base::Result<void> {
          const std::uint64_t begin = source_.firstVertex(b), end = begin + source_.vertexCount(b);
          if (!sampling && (end <= first || begin >= last)) return {};
          SpooledVertices block;
          LUMIGRID_TRY(source_.readVertices(b, block));
          for (std::uint64_t v = std::max(begin, first); v < std::min(end, last); ++v) storeVertex(block, v);
          if (sampling)
            for (std::uint64_t v = (begin + stride_ - 1) / stride_ * stride_; v < end; v += stride_)
              samples_[static_cast<std::size_t>(v / stride_)] = codeOf(block, v);
          return {};
        });
  }

  std::uint64_t codeOf(const SpooledVertices& block, std::uint64_t vertex) const {
    return stitches_.moved(mortonCode(lattice_.point(block.positions[static_cast<std::size_t>(vertex - block.first)])));
  }

  void storeVertex(const SpooledVertices& block, std::uint64_t vertex) {
    const auto i = static_cast<std::size_t>(vertex - block.first);
    const auto at = static_cast<std::size_t>(vertex - first_);
    codes_[at] = codeOf(block, vertex);
    if (out_.packing_.has_colors) colors_[at] = block.colors.empty() ? 0xFFFFFFFFU : block.colors[i];
    if (out_.packing_.has_normals) normals_[at] = block.normals.empty() ? 0 : block.normals[i];
  }

  // The splitters are the sample's quantiles. A table gives, for a code's top bits, the buckets that it may lie in.
  void chooseSplitters() {
    std::sort(samples_.begin(), samples_.end());
    const std::uint64_t buckets = bucketsWanted();
    for (std::uint64_t b = 1; b < buckets; ++b) {
      const std::uint64_t code = samples_[static_cast<std::size_t>(b * samples_.size() / buckets)];
      if (splitters_.empty() ? code > 0 : code > splitters_.back()) splitters_.push_back(code);
    }
    samples_ = {};
    const std::uint32_t bits = splitters_.size() < kFewSplitters ? kSmallTableBits : kTableBits;
    shift_ = 3 * lattice_.bits > bits ? 3 * lattice_.bits - bits : 0;
    table_.resize((std::size_t{1} << bits) + 1);
    for (std::uint64_t cell = 0; cell < table_.size(); ++cell)
      table_[static_cast<std::size_t>(cell)] = static_cast<std::uint32_t>(
          std::upper_bound(splitters_.begin(), splitters_.end(), cell << shift_) - splitters_.begin());
    out_.extents_.resize(splitters_.size() + 1);
    out_.counts_.assign(splitters_.size() + 1, 0);
    buffers_.resize(splitters_.size() + 1);
    buffer_limit_ = static_cast<std::size_t>(
        std::clamp<std::uint64_t>(kBufferBytes / buffers_.size(), 4096, std::uint64_t{1} << 18));
  }

  std::uint32_t bucketOf(std::uint64_t code) const {
    const auto cell = static_cast<std::size_t>(code >> shift_);
    std::uint32_t low = table_[cell];
    const std::uint32_t high = table_[cell + 1];
    while (low < high && splitters_[low] <= code) ++low;
    return low;
  }

  struct GatherPass {
    bool first = false, last = false;
  };
  // Consecutive triangles that go to the same bucket; they are mostly neighbours.
  struct Run {
    std::uint32_t bucket = 0;
    std::uint32_t triangles = 0;
    std::size_t bytes = 0;
  };
  struct TriangleBatch {
    SpooledTriangles block;
    std::vector<CornerRecord> records;  // filled by several windows; empty where there is one
    base::Bytes packed;                 // the triangles that are kept, packed for their buckets
    std::vector<Run> runs;              // runs of the packed triangles
    std::vector<std::uint64_t> border;
    std::vector<TexturePlace> textures;  // by triangle; empty where they are not kept
    BucketCounts counts;
    std::size_t used = 0;      // bytes of `packed`
    std::uint64_t before = 0;  // as packTriangle() wants it

    void beginPacking(std::size_t bytes) {
      packed.resize(std::max(packed.size(), bytes));
      runs.clear();
      border.clear();
      textures.clear();
      counts = {};
      used = 0, before = 0;
    }
  };

  // Looks up the triangles' corners in this window; the last window packs and stores the triangles.
  base::Result<void> gatherTriangles(bool first, bool last, double done) {
    const GatherPass pass{first, last};
    // There are no more batches than keep the threads busy.
    std::vector<TriangleBatch> slots(
        options_.limits.threads > 1 ? std::min<std::size_t>(kMaxBlocks, options_.limits.threads + 2) : 1);
    const auto load = [&](std::size_t block, std::size_t slot) { return loadBatch(block, slots[slot], pass); };
    const auto store = [&](std::size_t, std::size_t slot) -> base::Result<void> {
      TriangleBatch& batch = slots[slot];
      LUMIGRID_TRY(storeBatch(batch, pass));
      const std::uint64_t stored = batch.block.first + batch.block.corners.size() / 3;
      const double share = static_cast<double>(stored) / static_cast<double>(info_.triangles);
      if (!options_.progress || options_.progress(done * share)) return {};
      return Error{ErrorCode::kCancelled, "sorting the triangles was cancelled"};
    };
    LUMIGRID_TRY(base::parallelInOrder(source_.triangleBlocks(), options_.limits.threads, slots.size(), load, store));
    return first && !last ? corners_.flush() : base::Result<void>();
  }

  base::Result<void> loadBatch(std::size_t number, TriangleBatch& result, const GatherPass& pass) const {
    SpooledTriangles& block = result.block;
    LUMIGRID_TRY(source_.readTriangles(number, block));
    if (!pass.first || !pass.last) result.records.assign(block.corners.size() / 3, CornerRecord{});
    if (!pass.first) LUMIGRID_TRY(corners_.readAt(block.first * sizeof(CornerRecord), recordBytes(result)));
    if (pass.last) {
      packTriangles(block, result);
      return {};
    }
    for (std::size_t t = 0; t < result.records.size(); ++t) lookUpCorners(&block.corners[3 * t], result.records[t]);
    return {};
  }

  static std::span<std::uint8_t> recordBytes(TriangleBatch& batch) {
    return {reinterpret_cast<std::uint8_t*>(batch.records.data()), batch.records.size() * sizeof(CornerRecord)};
  }

  base::Result<void> storeBatch(TriangleBatch& batch, const GatherPass& pass) {
    if (pass.last) return storePacked(batch);
    return pass.first ? corners_.append(recordBytes(batch))
                      : corners_.writeAt(batch.block.first * sizeof(CornerRecord), recordBytes(batch));
  }

  // Fills in the corners whose vertices lie in this window.
  void lookUpCorners(const std::uint64_t* corners, CornerRecord& record) const {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint64_t v = corners[k];
      if (v < first_ || v >= last_) continue;
      const auto at = static_cast<std::size_t>(v - first_);
      record.corner[k].code = codes_[at];
      if (out_.packing_.has_colors) record.corner[k].color = colors_[at];
      if (out_.packing_.has_normals) record.corner[k].normal = normals_[at];
    }
  }

  // Leaves out degenerate triangles, and packs the others with the buckets that they go to.
  void packTriangles(const SpooledTriangles& block, TriangleBatch& result) const {
    const std::size_t triangles = block.corners.size() / 3;
    result.beginPacking(packedBytes(triangles));
    if (out_.packing_.has_sources) result.textures.resize(triangles);
    for (std::size_t t = 0; t < triangles; ++t) {
      const std::uint64_t* v = &block.corners[3 * t];
      CornerRecord record = result.records.empty() ? CornerRecord{} : result.records[t];
      lookUpCorners(v, record);
      if (out_.packing_.has_sources) result.textures[t] = texturePlace(block, t, record);
      const std::uint64_t a = record.corner[0].code, b = record.corner[1].code, c = record.corner[2].code;
      if (a == b || b == c || c == a) {
        const bool named_twice = v[0] == v[1] || v[1] == v[2] || v[2] == v[0];
        ++(named_twice ? result.counts.degenerate : result.counts.collapsed);
        continue;
      }
      if (!block.colors.empty())
        for (std::size_t k = 0; k < 3; ++k)
          if (block.colors[3 * t + k] >> 24 != 0) record.corner[k].color = block.colors[3 * t + k];
      if (!block.normals.empty())
        for (std::size_t k = 0; k < 3; ++k)
          if (block.normals[3 * t + k] != 0) record.corner[k].normal = block.normals[3 * t + k];
      packSplit(record, block.first + t, stitches_.hasSplits() ? 7 : 0, result);
    }
  }

  static TexturePlace texturePlace(const SpooledTriangles& block, std::size_t triangle, const CornerRecord& record) {
    TexturePlace place;
    for (std::size_t k = 0; k < 3; ++k) {
      place.codes[k] = record.corner[k].code;
      if (!block.uv.empty()) place.uv[k] = block.uv[3 * triangle + k];
    }
    if (!block.pictures.empty()) place.picture = block.pictures[triangle];
    return place;
  }

  std::size_t packedBytes(std::size_t triangles) const {
    return out_.packing_.triangleBytes() * triangles + BucketPacking::kSlack;
  }

  // Packs the triangle, cut where vertices of other borders lie on its edges; `edges` has a bit for each to look at.
  void packSplit(const CornerRecord& record, std::uint64_t source, std::uint32_t edges, TriangleBatch& result) const {
    for (std::size_t edge = 0; edge < 3; ++edge) {
      if ((edges >> edge & 1U) == 0) continue;
      const std::size_t next = (edge + 1) % 3, before = (edge + 2) % 3;
      const auto vertices = splitting(record.corner[edge].code, record.corner[next].code);
      if (vertices.empty()) continue;
      // A triangle that fills the gap beside a split edge has the splitting vertex for its third corner.
      if (std::find(vertices.begin(), vertices.end(), record.corner[before].code) != vertices.end()) continue;
      // The parts fan out from the third corner. The first has the edge before this one, the last the next.
      result.counts.added += vertices.size();
      CornerRecord part = record;
      for (std::size_t i = 0; i < vertices.size(); ++i) {
        part.corner[next] = Corner{vertices[i], 0, 0};
        packSplit(part, source, i == 0 ? edges & 1U << before : 0, result);
        part.corner[edge] = part.corner[next];
      }
      part.corner[next] = record.corner[next];
      return packSplit(part, source, edges & 1U << next, result);
    }
    packOne(record, source, result);
  }

  // The other side of a two-sided mesh is cut as the first one is, so that its parts are dropped, too.
  std::vector<std::uint64_t> splitting(std::uint64_t from, std::uint64_t to) const {
    const auto vertices = stitches_.splitting(from, to);
    if (!vertices.empty() || !is_two_sided_) return {vertices.begin(), vertices.end()};
    const auto turned = stitches_.splitting(to, from);
    return {turned.rbegin(), turned.rend()};
  }

  void packOne(const CornerRecord& record, std::uint64_t source, TriangleBatch& result) const {
    const std::uint64_t codes[] = {record.corner[0].code, record.corner[1].code, record.corner[2].code};
    if (codes[0] == codes[1] || codes[1] == codes[2] || codes[2] == codes[0]) {
      ++result.counts.collapsed;
      return;
    }
    if (result.packed.size() - result.used < packedBytes(1) + BucketPacking::kMaxTriangleBytes)
      result.packed.resize(result.packed.size() * 3 / 2 + packedBytes(64));
    const std::uint32_t bucket = bucketOf(medianCode(codes[0], codes[1], codes[2]));
    if (!splitters_.empty())
      for (const std::uint64_t code : codes)
        if (bucketOf(code) != bucket) result.border.push_back(code);
    const bool starts_run =
        result.runs.empty() || result.runs.back().bucket != bucket || result.runs.back().triangles == kMaxRunTriangles;
    if (starts_run) result.runs.push_back({bucket, 0, 0});
    std::uint8_t* const to = result.packed.data() + result.used;
    const std::uint8_t* const end = out_.packing_.packTriangle(record.corner, starts_run, result.before, source, to);
    ++result.runs.back().triangles;
    result.runs.back().bytes += static_cast<std::size_t>(end - to);
    result.used += static_cast<std::size_t>(end - to);
  }

  base::Result<void> storeFills() {
    TriangleBatch batch;
    batch.beginPacking(packedBytes(stitches_.fills().size()));
    for (const auto& codes : stitches_.fills()) {
      CornerRecord record;
      for (std::size_t k = 0; k < 3; ++k) record.corner[k].code = codes[k];
      packOne(record, kNoSource, batch);
    }
    batch.counts.added = stitches_.fills().size();
    return storePacked(batch);
  }

  base::Result<void> storePacked(const TriangleBatch& result) {
    LUMIGRID_TRY(textures_.append(result.textures));
    const std::uint8_t* from = result.packed.data();
    for (const Run& run : result.runs) {
      base::Bytes& buffer = buffers_[run.bucket];
      buffer.insert(buffer.end(), from, from + run.bytes);
      from += run.bytes;
      out_.counts_[run.bucket] += run.triangles;
      out_.totals_.triangles += run.triangles;
      if (buffer.size() >= buffer_limit_) LUMIGRID_TRY(flush(run.bucket));
    }
    out_.totals_.degenerate += result.counts.degenerate;
    out_.totals_.collapsed += result.counts.collapsed;
    out_.totals_.added += result.counts.added;
    border_.insert(border_.end(), result.border.begin(), result.border.end());
    if (border_.size() > border_limit_) {
      std::sort(border_.begin(), border_.end());
      border_.erase(std::unique(border_.begin(), border_.end()), border_.end());
      border_limit_ = std::max(border_limit_, 2 * border_.size());
    }
    return {};
  }

  base::Result<void> flush(std::size_t bucket) {
    base::Bytes& buffer = buffers_[bucket];
    if (buffer.empty()) return {};
    out_.extents_[bucket].push_back({out_.file_.size(), buffer.size()});
    LUMIGRID_TRY(out_.file_.append(buffer));
    buffer.clear();
    return {};
  }

  const SourceSpool& source_;
  const SourceInfo& info_;
  const SourceLattice& lattice_;
  const std::string& directory_;
  const BucketOptions& options_;
  Buckets out_;
  Stitches stitches_;
  bool is_two_sided_ = false;  // known when stitches are
  SpoolFile corners_;
  TexturePlaces textures_;
  std::uint64_t first_ = 0, last_ = 0;  // the window
  std::size_t room_ = 0;                // vertices that the following arrays hold
  std::unique_ptr<std::uint64_t[]> codes_;
  std::unique_ptr<std::uint32_t[]> colors_;
  std::unique_ptr<std::uint32_t[]> normals_;
  std::vector<std::uint64_t> samples_;
  std::uint64_t stride_ = 1;
  std::vector<std::uint64_t> splitters_;
  std::vector<std::uint32_t> table_;
  std::uint32_t shift_ = 0;
  std::vector<base::Bytes> buffers_;
  std::size_t buffer_limit_ = 0;
  std::vector<std::uint64_t> border_;
  std::size_t border_limit_ = std::size_t{1} << 18;
};

base::Result<Buckets> Buckets::sort(const SourceSpool& source, const SourceInfo& info, const SourceLattice& lattice,
                                    const std::string& directory, const BucketOptions& options) {
  return BucketSorter(source, info, lattice, directory, options).run();
}

}  // namespace lod::ingest
