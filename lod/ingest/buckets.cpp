#include "lod/ingest/buckets.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>

#include "base/parallel.h"
#include "lod/ingest/work_directory.h"

namespace lod::ingest {
namespace {

using base::Error;
using base::ErrorCode;

// Of the vertices' codes, for each bucket: its size is right within a few hundredths. And in all.
constexpr std::uint64_t kBucketSamples = 2048;
constexpr std::uint64_t kMaxSamples = std::uint64_t{1} << 20;
constexpr std::uint32_t kTableBits = 18;       // of the codes' top bits, to look a bucket up by
constexpr std::uint32_t kSmallTableBits = 12;  // the same where there are few
constexpr std::size_t kFewSplitters = 16;
constexpr std::size_t kMaxBlocks = 10;    // of triangles, at a time
constexpr std::uint32_t kMaxOfRun = 256;  // triangles, so that no buffer grows far over its limit
constexpr std::uint64_t kBufferBytes = std::uint64_t{64} << 20;  // of all buckets together

// Fewer bits save nothing that counts on a small mesh, and cost accuracy at fine levels.
constexpr std::uint32_t kMinChosenBits = 14;
// What measureWinding takes for a bucket, about.
constexpr std::uint64_t kWindingBytes = std::uint64_t{80} << 20;

constexpr std::uint8_t kStateVersion = 3;

struct Record {
  Corner corner[3];
};

// A triangle in the buckets' file: two bytes that say how many bytes each code takes (four bits each) and whether the
// triangle starts a run; the codes' differing bytes, the first corner's from that of the triangle before it in the run,
// the others' from the first's; what else there is of each corner. Neighbours differ in few low bytes: half the bytes
// of whole codes.
constexpr std::uint32_t kStartsRun = 1U << 12;
constexpr std::size_t kHeadBytes = 2;
constexpr std::size_t kMaxTriangleBytes = kHeadBytes + 3 * sizeof(Corner);
constexpr std::size_t kSlack = 8;  // bytes that may be read or written past what counts

std::uint32_t bytesOf(std::uint64_t x) {
  return (static_cast<std::uint32_t>(std::bit_width(x)) + 7) / 8;
}

std::uint8_t* putLowBytes(std::uint64_t x, std::uint32_t bytes, std::uint8_t* to) {
  std::memcpy(to, &x, sizeof(x));
  return to + bytes;
}

std::uint64_t lowBytes(const std::uint8_t* from, std::uint32_t bytes) {
  std::uint64_t x = 0;
  std::memcpy(&x, from, sizeof(x));
  return bytes == 0 ? 0 : x & ~std::uint64_t{0} >> (64 - 8 * bytes);
}

void turn(const std::vector<bool>& flips, std::vector<BorderTriangle>& triangles) {
  if (flips.empty()) return;
  for (BorderTriangle& t : triangles) {
    if (!flips[t.triangle]) continue;
    std::swap(t.place[1], t.place[2]);
    std::swap(t.corner[1], t.corner[2]);
  }
}

}  // namespace

glm::ivec3 SourceLattice::point(const glm::dvec3& world) const {
  const double last = static_cast<double>((1U << bits) - 1);
  // Halves up; what is not negative needs no rounding from the library.
  const glm::dvec3 q = glm::clamp((world - corner) / lattice.step, 0.0, last);
  const glm::ivec3 whole(q);
  return whole + glm::ivec3(glm::greaterThanEqual(q - glm::dvec3(whole), glm::dvec3(0.5)));
}

SourceLattice makeLattice(const SourceInfo& info, const glm::dvec3& origin, std::uint32_t bits) {
  const glm::dvec3 size = info.box_max - info.box_min;
  const double longest = std::max({size.x, size.y, size.z});
  SourceLattice out;
  out.bits = bits;
  if (bits == 0) {
    out.bits = kMinChosenBits;
    if (info.mean_edge > 0.0 && longest > 0.0)
      out.bits = static_cast<std::uint32_t>(std::clamp(std::ceil(std::log2(16.0 * longest / info.mean_edge + 1.0)),
                                                       double{kMinChosenBits}, static_cast<double>(kMaxLatticeBits)));
  }
  out.corner = info.box_min;
  out.lattice.origin = info.box_min - origin;
  // An even number of steps: what is symmetric has lattice points on its middle plane.
  out.lattice.step = longest > 0.0 ? longest / static_cast<double>((1U << out.bits) - 2) : 1.0;
  return out;
}

glm::vec3 VertexSums::unitNormal() const {
  for (const std::int64_t* sum : {normal, face}) {
    const glm::dvec3 n(static_cast<double>(sum[0]), static_cast<double>(sum[1]), static_cast<double>(sum[2]));
    if (const double length = glm::length(n); length > 0.0) return glm::vec3(n / length);
  }
  return {0.0F, 0.0F, 1.0F};
}

glm::u8vec4 VertexSums::meanColor() const {
  if (colored == 0) return glm::u8vec4(255);
  auto mean = [this](int k) { return static_cast<std::uint8_t>((color[k] + colored / 2) / colored); };
  return {mean(0), mean(1), mean(2), 255};
}

constexpr std::uint32_t kFilterBits = 22;

std::size_t filterSlot(std::uint64_t code) {
  return static_cast<std::size_t>((code * 0x9E3779B97F4A7C15ULL) >> (64 - kFilterBits));
}

void BorderVertices::makeFilter() {
  if (codes.empty()) return;
  filter.assign(std::size_t{1} << kFilterBits, false);
  for (const std::uint64_t code : codes) filter[filterSlot(code)] = true;
}

std::int64_t BorderVertices::find(std::uint64_t code) const {
  if (codes.empty() || !filter[filterSlot(code)]) return -1;
  const auto at = std::lower_bound(codes.begin(), codes.end(), code);
  return at != codes.end() && *at == code ? at - codes.begin() : -1;
}

// One sorting: sample, splitters, windows.
class BucketSorter {
 public:
  BucketSorter(const SourceSpool& source, const SourceInfo& info, const SourceLattice& lattice,
               const std::string& directory, const BucketOptions& options)
      : source_(source), info_(info), lattice_(lattice), directory_(directory), options_(options) {}

  base::Result<Buckets> run() {
    LUMIGRID_ASSIGN_OR_RETURN(auto file, SpoolFile::create(directory_ + "/buckets"));
    out_.file_ = std::move(file);
    out_.has_colors_ = info_.has_colors;
    out_.has_normals_ = info_.has_normals;

    // As many vertices at a time as memory holds.
    const std::uint64_t vertex_bytes = out_.cornerBytes();
    const std::uint64_t window = std::max<std::uint64_t>(options_.limits.memory_bytes / vertex_bytes, 1U << 16);
    const std::uint64_t windows = (info_.vertices + window - 1) / window;
    const std::uint64_t samples = std::min(kMaxSamples, kBucketSamples * bucketsWanted());
    stride_ = std::max<std::uint64_t>(1, info_.vertices / samples);
    if (windows > 1) {
      LUMIGRID_ASSIGN_OR_RETURN(auto corners, SpoolFile::create(directory_ + "/corners"));
      corners_ = std::move(corners);
    }
    for (std::uint64_t w = 0; w < windows; ++w) {
      LUMIGRID_TRY(loadWindow(w * window, std::min(info_.vertices, (w + 1) * window), w == 0));
      if (w == 0) split();
      LUMIGRID_TRY(gather(w == 0, w + 1 == windows, (static_cast<double>(w) + 1.0) / static_cast<double>(windows)));
    }
    codes_.reset();
    colors_.reset();
    normals_.reset();
    if (windows > 1) {
      std::error_code ignored;
      std::filesystem::remove(corners_.path(), ignored);
    }
    for (std::size_t b = 0; b < buffers_.size(); ++b) LUMIGRID_TRY(flush(b));
    buffers_ = std::vector<base::Bytes>();
    LUMIGRID_TRY(out_.file_.flush());
    std::sort(border_.begin(), border_.end());
    border_.erase(std::unique(border_.begin(), border_.end()), border_.end());
    out_.border_.codes = std::move(border_);
    out_.border_.makeFilter();
    LUMIGRID_TRY(out_.windAlike(options_.limits));
    std::uint64_t with_area = 0;
    for (const Buckets::Area& area : out_.areas_) {
      with_area += area.triangles;
      out_.totals_.facing += area.facing;
    }
    out_.areas_ = {};
    // Triangles whose corners lie on a line stay where others need them: without them closed meshes would open.
    if (with_area == 0)
      return Error{ErrorCode::kInvalidInput, out_.totals_.collapsed == 0
                                                 ? "no triangle is left after cleaning (all are degenerate)"
                                                 : "no triangle keeps its area on a lattice of " +
                                                       std::to_string(lattice_.bits) +
                                                       " bits: the mesh has no extent, or raise --position-bits"};
    return std::move(out_);
  }

 private:
  std::uint64_t bucketsWanted() const { return (info_.vertices + Buckets::kVertices - 1) / Buckets::kVertices; }
  bool goOn(double done) const { return !options_.progress || options_.progress(done); }
  static Error cancelled() { return {ErrorCode::kCancelled, "sorting the triangles was cancelled"}; }

  // Vertices first … last − 1 onto the lattice; the first pass samples all of them.
  base::Result<void> loadWindow(std::uint64_t first, std::uint64_t last, bool sampling) {
    first_ = first;
    last_ = last;
    const auto size = static_cast<std::size_t>(last - first);
    // The threads fill them, all of them.
    if (!codes_ || size > room_) {
      room_ = size;
      codes_ = std::make_unique_for_overwrite<std::uint64_t[]>(size);
      if (out_.has_colors_) colors_ = std::make_unique_for_overwrite<std::uint32_t[]>(size);
      if (out_.has_normals_) normals_ = std::make_unique_for_overwrite<std::uint32_t[]>(size);
    }
    if (sampling) samples_.resize(static_cast<std::size_t>((info_.vertices + stride_ - 1) / stride_));
    return base::tryParallelFor(
        source_.vertexBlocks(), options_.limits.threads, [&](std::size_t b) -> base::Result<void> {
          const std::uint64_t begin = source_.firstVertex(b), end = begin + source_.vertexCount(b);
          if (!sampling && (end <= first || begin >= last)) return {};
          SpooledVertices block;
          LUMIGRID_TRY(source_.readVertices(b, block));
          for (std::uint64_t v = std::max(begin, first); v < std::min(end, last); ++v) keep(block, v);
          if (sampling)
            for (std::uint64_t v = (begin + stride_ - 1) / stride_ * stride_; v < end; v += stride_)
              samples_[static_cast<std::size_t>(v / stride_)] = codeOf(block, v);
          return {};
        });
  }

  std::uint64_t codeOf(const SpooledVertices& block, std::uint64_t vertex) const {
    return mortonCode(lattice_.point(block.positions[static_cast<std::size_t>(vertex - block.first)]));
  }

  // One of the window's vertices.
  void keep(const SpooledVertices& block, std::uint64_t vertex) {
    const auto i = static_cast<std::size_t>(vertex - block.first);
    const auto at = static_cast<std::size_t>(vertex - first_);
    codes_[at] = codeOf(block, vertex);
    if (out_.has_colors_) colors_[at] = block.colors.empty() ? 0xFFFFFFFFU : block.colors[i];
    if (out_.has_normals_) normals_[at] = block.normals.empty() ? 0 : block.normals[i];
  }

  // Splitters at the sample's quantiles, and a table that says for the top bits of a code which it may lie between.
  void split() {
    std::sort(samples_.begin(), samples_.end());
    const std::uint64_t buckets = bucketsWanted();
    for (std::uint64_t b = 1; b < buckets; ++b) {
      const std::uint64_t code = samples_[static_cast<std::size_t>(b * samples_.size() / buckets)];
      if (splitters_.empty() ? code > 0 : code > splitters_.back()) splitters_.push_back(code);
    }
    samples_ = {};
    // A table longer than the mesh is not worth making.
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
  // Triangles on end that go to the same bucket: mostly neighbours.
  struct Run {
    std::uint32_t bucket = 0;
    std::uint32_t triangles = 0;
    std::size_t bytes = 0;
  };
  struct Gathered {
    SpooledTriangles block;
    std::vector<Record> records;  // where another window needs them or has left them
    base::Bytes packed;           // of the triangles kept, as the buckets hold them
    std::vector<Run> runs;        // of them
    std::vector<std::uint64_t> border;
    BucketCounts counts;
  };

  // Triangles with what this window knows of their corners.
  base::Result<void> gather(bool first, bool last, double done) {
    const GatherPass pass{first, last};
    // A block is some ten megabytes here: no more of them than keep the threads busy.
    std::vector<Gathered> slots(
        options_.limits.threads > 1 ? std::min<std::size_t>(kMaxBlocks, options_.limits.threads + 2) : 1);
    const auto make = [&](std::size_t block, std::size_t slot) { return gatherBlock(block, slots[slot], pass); };
    const auto take = [&](std::size_t, std::size_t slot) -> base::Result<void> {
      Gathered& gathered = slots[slot];
      LUMIGRID_TRY(storeAny(gathered, pass));
      const std::uint64_t stored = gathered.block.first + gathered.block.corners.size() / 3;
      const double share = static_cast<double>(stored) / static_cast<double>(info_.triangles);
      return goOn(done * share) ? base::Result<void>() : cancelled();
    };
    LUMIGRID_TRY(base::parallelInOrder(source_.triangleBlocks(), options_.limits.threads, slots.size(), make, take));
    return first && !last ? corners_.flush() : base::Result<void>();
  }

  base::Result<void> gatherBlock(std::size_t number, Gathered& result, const GatherPass& pass) const {
    SpooledTriangles& block = result.block;
    LUMIGRID_TRY(source_.readTriangles(number, block));
    if (!pass.first || !pass.last) result.records.assign(block.corners.size() / 3, Record{});
    if (!pass.first) LUMIGRID_TRY(corners_.readAt(block.first * sizeof(Record), recordBytes(result)));
    if (pass.last) {
      sift(block, result);
      return {};
    }
    for (std::size_t t = 0; t < result.records.size(); ++t) fill(&block.corners[3 * t], result.records[t]);
    return {};
  }

  static std::span<std::uint8_t> recordBytes(Gathered& gathered) {
    return {reinterpret_cast<std::uint8_t*>(gathered.records.data()), gathered.records.size() * sizeof(Record)};
  }

  base::Result<void> storeAny(Gathered& gathered, const GatherPass& pass) {
    if (pass.last) return store(gathered);
    return pass.first ? corners_.append(recordBytes(gathered))
                      : corners_.writeAt(gathered.block.first * sizeof(Record), recordBytes(gathered));
  }

  // What this window knows of a triangle's corners.
  void fill(const std::uint64_t* corners, Record& record) const {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint64_t v = corners[k];
      if (v < first_ || v >= last_) continue;
      const auto at = static_cast<std::size_t>(v - first_);
      record.corner[k].code = codes_[at];
      if (out_.has_colors_) record.corner[k].color = colors_[at];
      if (out_.has_normals_) record.corner[k].normal = normals_[at];
    }
  }

  // Leaves out triangles that are none, packs the others and says where they go.
  void sift(const SpooledTriangles& block, Gathered& result) const {
    const std::size_t triangles = block.corners.size() / 3;
    result.packed.resize((kHeadBytes + 3 * out_.cornerBytes()) * triangles + kSlack);
    result.runs.clear();
    result.border.clear();
    result.counts = {};
    std::uint8_t* to = result.packed.data();
    std::uint64_t before = 0;
    for (std::size_t t = 0; t < triangles; ++t) {
      const std::uint64_t* v = &block.corners[3 * t];
      Record record = result.records.empty() ? Record{} : result.records[t];
      fill(v, record);
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
      const std::uint32_t bucket = bucketOf(medianCode(a, b, c));
      if (!splitters_.empty())
        for (const std::uint64_t code : {a, b, c})
          if (bucketOf(code) != bucket) result.border.push_back(code);
      const bool starts_run =
          result.runs.empty() || result.runs.back().bucket != bucket || result.runs.back().triangles == kMaxOfRun;
      if (starts_run) result.runs.push_back({bucket, 0, 0});
      std::uint8_t* const end = out_.packTriangle(record.corner, starts_run, before, to);
      ++result.runs.back().triangles;
      result.runs.back().bytes += static_cast<std::size_t>(end - to);
      to = end;
    }
  }

  base::Result<void> store(const Gathered& result) {
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
  SpoolFile corners_;
  std::uint64_t first_ = 0, last_ = 0;  // the window
  std::size_t room_ = 0;                // vertices, of the following
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

std::uint8_t* Buckets::pack(const Corner& corner, std::uint8_t* to) const {
  std::memcpy(to, &corner.code, 8), to += 8;
  return packAttributes(corner, to);
}

std::uint8_t* Buckets::packAttributes(const Corner& corner, std::uint8_t* to) const {
  if (has_colors_) std::memcpy(to, &corner.color, 4), to += 4;
  if (has_normals_) std::memcpy(to, &corner.normal, 4), to += 4;
  return to;
}

const std::uint8_t* Buckets::unpack(const std::uint8_t* from, Corner& corner) const {
  std::memcpy(&corner.code, from, 8), from += 8;
  return unpackAttributes(from, corner);
}

const std::uint8_t* Buckets::unpackAttributes(const std::uint8_t* from, Corner& corner) const {
  if (has_colors_) std::memcpy(&corner.color, from, 4), from += 4;
  if (has_normals_) std::memcpy(&corner.normal, from, 4), from += 4;
  return from;
}

// Which way a bucket's triangles face, and how many have an area at all.
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

std::uint8_t* Buckets::packTriangle(std::span<const Corner, 3> corner, bool starts_run, std::uint64_t& before,
                                    std::uint8_t* to) const {
  if (starts_run) before = 0;
  std::uint8_t* const head = to;
  to += kHeadBytes;
  std::uint32_t lengths = starts_run ? kStartsRun : 0;
  for (std::uint32_t k = 0; k < 3; ++k) {
    const std::uint64_t differs = corner[k].code ^ (k == 0 ? before : corner[0].code);
    const std::uint32_t bytes = bytesOf(differs);
    lengths |= bytes << (4 * k);
    to = putLowBytes(differs, bytes, to);
  }
  before = corner[0].code;
  const auto stored = static_cast<std::uint16_t>(lengths);
  std::memcpy(head, &stored, sizeof(stored));
  for (const Corner& c : corner) to = packAttributes(c, to);
  return to;
}

// Goes on by at most kMaxTriangleBytes, whatever lies there.
const std::uint8_t* Buckets::unpackTriangle(const std::uint8_t* from, std::span<Corner, 3> corner,
                                            std::uint64_t& before) const {
  std::uint16_t head = 0;
  std::memcpy(&head, from, sizeof(head)), from += sizeof(head);
  if ((head & kStartsRun) != 0) before = 0;
  for (std::uint32_t k = 0; k < 3; ++k) {
    const std::uint32_t bytes = std::min(head >> (4 * k) & 15U, 8U);
    corner[k].code = lowBytes(from, bytes) ^ (k == 0 ? before : corner[0].code);
    from += bytes;
  }
  before = corner[0].code;
  for (Corner& c : corner) from = unpackAttributes(from, c);
  return from;
}

base::Result<std::vector<Corner>> Buckets::readAsGiven(std::size_t bucket) const {
  const Error broken = damagedWorkFiles(std::filesystem::path(file_.path()).parent_path());
  std::vector<Corner> corners(3 * static_cast<std::size_t>(counts_[bucket]));
  std::size_t count = 0;
  base::Bytes packed;
  for (const Extent& extent : extents_[bucket]) {
    const auto bytes = static_cast<std::size_t>(extent.bytes);
    packed.resize(std::max(packed.size(), bytes + kMaxTriangleBytes + kSlack));
    LUMIGRID_TRY(file_.readAt(extent.offset, std::span(packed).first(bytes)));
    const std::uint8_t* from = packed.data();
    const std::uint8_t* const end = from + bytes;
    std::uint64_t before = 0;
    for (; from < end; count += 3) {
      if (count == corners.size()) return broken;
      from = unpackTriangle(from, std::span<Corner, 3>(&corners[count], 3), before);
    }
    if (from != end) return broken;
  }
  if (count != corners.size()) return broken;
  return corners;
}

base::Result<Buckets::Numbered> Buckets::readNumbered(std::size_t bucket) const {
  auto once = readOnce(bucket);
  if (once && once->mesh.number.empty()) once->mesh = NumberedCorners(once->corners);
  return once;
}

base::Result<Buckets::Numbered> Buckets::readOnce(std::size_t bucket) const {
  if (only_) {
    Numbered ready = std::move(*only_);
    only_.reset();
    return ready;
  }
  LUMIGRID_ASSIGN_OR_RETURN(auto corners, read(bucket));
  return Numbered{std::move(corners), NumberedCorners()};
}

base::Result<std::vector<Corner>> Buckets::read(std::size_t bucket) const {
  if (only_) return only_->corners;
  LUMIGRID_ASSIGN_OR_RETURN(const auto flips, measureFlips(bucket));
  auto corners = readAsGiven(bucket);
  if (!corners) return corners;
  for (std::size_t t = 0; t < flips.size(); ++t)
    if (flips[t]) std::swap((*corners)[3 * t + 1], (*corners)[3 * t + 2]);
  return corners;
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

// Not safe from several threads. Of each triangle: its place, those of its corners, its corners.
base::Result<void> Buckets::storeBorder(std::size_t bucket, std::span<const BorderTriangle> triangles) {
  base::Bytes packed(triangles.size() * borderTriangleBytes());
  std::uint8_t* to = packed.data();
  for (const BorderTriangle& t : triangles) {
    std::memcpy(to, &t.triangle, sizeof(t.triangle)), to += sizeof(t.triangle);
    std::memcpy(to, t.place, sizeof(t.place)), to += sizeof(t.place);
    for (const Corner& corner : t.corner) to = pack(corner, to);
  }
  border_extents_[bucket] = {file_.size(), packed.size()};
  return file_.append(packed);
}

base::Result<std::vector<BorderTriangle>> Buckets::borderAsGiven(std::size_t bucket) const {
  base::Bytes packed(static_cast<std::size_t>(border_extents_[bucket].bytes));
  LUMIGRID_TRY(file_.readAt(border_extents_[bucket].offset, packed));
  std::vector<BorderTriangle> out(packed.size() / borderTriangleBytes());
  const std::uint8_t* from = packed.data();
  for (BorderTriangle& t : out) {
    std::memcpy(&t.triangle, from, sizeof(t.triangle)), from += sizeof(t.triangle);
    std::memcpy(t.place, from, sizeof(t.place)), from += sizeof(t.place);
    for (Corner& corner : t.corner) from = unpack(from, corner);
    const bool inside = std::all_of(std::begin(t.place), std::end(t.place), [this](std::uint32_t place) {
      return place == kNotOnBorder || place < border_.codes.size();
    });
    if (!inside || t.triangle >= counts_[bucket])
      return damagedWorkFiles(std::filesystem::path(file_.path()).parent_path());
  }
  return out;
}

base::Result<std::vector<BorderTriangle>> Buckets::borderTriangles(std::size_t bucket) const {
  LUMIGRID_ASSIGN_OR_RETURN(const auto flips, measureFlips(bucket));
  auto triangles = borderAsGiven(bucket);
  if (triangles) turn(flips, *triangles);
  return triangles;
}

// Colours and normals of border vertices, over all the triangles that use them. Any number of threads at a time.
void Buckets::addToBorders(std::span<const BorderTriangle> triangles) {
  const auto add = [](std::int64_t& sum, std::int64_t value) {
    if (value != 0) std::atomic_ref(sum).fetch_add(value, std::memory_order_relaxed);
  };
  for (const BorderTriangle& t : triangles) {
    const glm::i64vec3 normal =
        latticeNormal(mortonPoint(t.corner[0].code), mortonPoint(t.corner[1].code), mortonPoint(t.corner[2].code));
    for (std::size_t c = 0; c < 3; ++c) {
      if (t.place[c] == kNotOnBorder) continue;
      VertexSums share;
      share.add(normal, t.corner[c]);
      VertexSums& sums = border_.sums[t.place[c]];
      for (int k = 0; k < 3; ++k) {
        add(sums.face[k], share.face[k]);
        add(sums.normal[k], share.normal[k]);
        add(sums.color[k], share.color[k]);
      }
      add(sums.colored, share.colored);
    }
  }
}

// Which triangles to turn over is known in the run that found it out; a later one finds it out once more.
base::Result<Buckets::Flips> Buckets::measureFlips(std::size_t bucket) const {
  if (!winding_.mayFlip(bucket)) return Flips();
  if (!flips_.empty()) return flips_[bucket];
  LUMIGRID_ASSIGN_OR_RETURN(const auto corners, readAsGiven(bucket));
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

// What the first look at all buckets finds.
struct Buckets::FirstLook {
  std::atomic<bool> alike = true;
  std::mutex mutex;
  std::vector<QuickWinding::Edge> open;                // while they are alike
  std::vector<std::optional<BucketWinding>> measured;  // by bucket, where they are not
  std::uint64_t most_parts = 0;                        // triangles whose part may be kept
  std::atomic<std::uint64_t> parts = 0;
};

// Most meshes are wound alike as they are: that needs a look at the edges, no more, and the sums of what is read for it
// hold as well. Where they are not, the rest is measured at once.
base::Result<void> Buckets::lookAt(std::size_t bucket, FirstLook& look) {
  LUMIGRID_ASSIGN_OR_RETURN(auto corners, readAsGiven(bucket));
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
  QuickWinding quick;
  if (look.alike) quick = lookAtWinding(mesh, places);
  if (!quick.alike) look.alike = false;
  if (look.alike)
    addToBorders(on_border);
  else
    look.measured[bucket] = measure(mesh, places, look);
  if (count() == 1 && look.alike) only_ = Numbered{std::move(corners), std::move(mesh)};
  const std::lock_guard lock(look.mutex);
  look.open.insert(look.open.end(), quick.open.begin(), quick.open.end());
  return storeBorder(bucket, on_border);
}

BucketWinding Buckets::measure(const NumberedCorners& mesh, std::span<const std::uint32_t> places,
                               FirstLook& look) const {
  BucketWinding measured = measureWinding(mesh, places);
  // What memory does not hold is worked out once more.
  if (look.parts.fetch_add(measured.part.size()) + measured.part.size() > look.most_parts) measured.part = {};
  return measured;
}

base::Result<void> Buckets::windAlike(base::ResourceLimits limits) {
  FirstLook look;
  look.measured.resize(count());
  look.most_parts = limits.memory_bytes / 4 / sizeof(std::uint32_t);
  const std::uint64_t at_once = std::max<std::uint64_t>(1, limits.memory_bytes / 4 * 3 / kWindingBytes);
  const auto threads = static_cast<unsigned>(std::min<std::uint64_t>(std::max(1U, limits.threads), at_once));
  border_.sums.assign(border_.codes.size(), {});
  border_extents_.resize(count());
  areas_.resize(count());
  LUMIGRID_TRY(base::tryParallelFor(count(), threads, [&](std::size_t bucket) { return lookAt(bucket, look); }));
  LUMIGRID_TRY(file_.flush());
  if (look.alike && ingest::windAlike(look.open)) {
    winding_.setAlike(count());
    return {};
  }
  look.open = {};
  only_.reset();
  return turnOver(look, threads);
}

base::Result<void> Buckets::turnOver(FirstLook& look, unsigned threads) {
  LUMIGRID_TRY(base::tryParallelFor(count(), threads, [&](std::size_t bucket) -> base::Result<void> {
    if (look.measured[bucket]) return {};
    LUMIGRID_ASSIGN_OR_RETURN(const auto corners, readAsGiven(bucket));
    const NumberedCorners mesh(corners);
    look.measured[bucket] = measure(mesh, borderPlaces(mesh), look);
    return {};
  }));
  for (std::optional<BucketWinding>& measured : look.measured) {
    winding_.add(*measured);
    measured->parts = {}, measured->open = {}, measured->opposing = {};
  }
  winding_.finish();

  std::vector<Flips> flips(count());
  border_.sums.assign(border_.codes.size(), {});
  LUMIGRID_TRY(base::tryParallelFor(count(), threads, [&](std::size_t bucket) -> base::Result<void> {
    const std::vector<std::uint32_t>& part = look.measured[bucket]->part;
    LUMIGRID_ASSIGN_OR_RETURN(auto found, part.empty() ? measureFlips(bucket) : flipsOf(bucket, part));
    flips[bucket] = std::move(found);
    LUMIGRID_ASSIGN_OR_RETURN(auto triangles, borderAsGiven(bucket));
    turn(flips[bucket], triangles);
    addToBorders(triangles);
    return {};
  }));
  flips_ = std::move(flips);
  return {};
}

void Buckets::release() {
  only_.reset();
  file_.release(0, file_.size());
}

base::Bytes Buckets::state() const {
  base::ByteWriter out;
  out.u8(kStateVersion);
  out.u8(has_colors_ ? 1 : 0);
  out.u8(has_normals_ ? 1 : 0);
  out.write(totals_);
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
  return out.take();
}

base::Result<Buckets> Buckets::open(const std::string& directory, base::ByteView state) {
  const Error broken = damagedWorkFiles(directory);
  LUMIGRID_ASSIGN_OR_RETURN(auto file, SpoolFile::open(directory + "/buckets"));
  Buckets out;
  base::ByteReader in(state);
  if (in.u8() != kStateVersion) return broken;
  out.has_colors_ = in.u8() != 0;
  out.has_normals_ = in.u8() != 0;
  out.totals_ = in.read<BucketCounts>();
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
