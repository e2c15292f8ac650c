#include "lod/ingest/source_spool.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <numeric>

#include "base/parallel.h"
#include "lod/ingest/source_lattice.h"
#include "lod/ingest/work_directory.h"

namespace lod::ingest {
namespace {

// Squares of coordinates must stay finite in float32.
constexpr double kMaxCoordinate = 1e18;
constexpr std::size_t kMaxSampledTriangles = std::size_t{1} << 14;  // the mean edge is known within 1 %
constexpr std::uint32_t kDouble = 1, kNormals = 2, kColors = 4, kWide = 8, kTextures = 16;

struct BlockHeader {
  std::uint32_t count = 0;
  std::uint32_t flags = 0;
};

template <class T>
void put(base::Bytes& out, const T* values, std::size_t count) {
  const std::size_t at = out.size();
  out.resize(at + count * sizeof(T));
  if (count > 0) std::memcpy(out.data() + at, values, count * sizeof(T));
}

template <class T>
void unpack(base::ByteView& in, std::vector<T>& values, std::size_t count) {
  values.resize(count);
  if (count > 0) std::memcpy(values.data(), in.data(), count * sizeof(T));
  in = in.subspan(count * sizeof(T));
}

// Unpacks values that are stored as the narrower type Stored, or as they are.
template <class Stored, class T>
void unpackNarrow(base::ByteView& in, std::vector<T>& values, std::size_t count, bool narrow) {
  if (!narrow) return unpack(in, values, count);
  values.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    Stored stored;
    std::memcpy(&stored, in.data() + i * sizeof(stored), sizeof(stored));
    values[i] = T(stored);
  }
  in = in.subspan(count * sizeof(Stored));
}

// Bytes of a block after its header.
std::uint64_t vertexBlockBytes(std::uint64_t count, std::uint32_t flags) {
  return count * (((flags & kDouble) != 0 ? 24U : 12U) + ((flags & kNormals) != 0 ? 4U : 0U) +
                  ((flags & kColors) != 0 ? 4U : 0U));
}
std::uint64_t triangleBlockBytes(std::uint64_t count, std::uint32_t flags) {
  return 3 * count *
             (((flags & kWide) != 0 ? 8U : 4U) + ((flags & kColors) != 0 ? 4U : 0U) +
              ((flags & kNormals) != 0 ? 4U : 0U)) +
         ((flags & kTextures) != 0 ? count * (3 * sizeof(glm::vec2) + sizeof(std::uint32_t)) : 0U);
}

bool fitsFloat(std::span<const glm::dvec3> positions) {
  return std::all_of(positions.begin(), positions.end(),
                     [](const glm::dvec3& p) { return glm::dvec3(glm::vec3(p)) == p; });
}

}  // namespace

std::uint32_t packNormal(const glm::vec3& n) {
  const float length = glm::length(n);
  if (!(length > 0.0F) || !std::isfinite(length)) return 0;
  const glm::ivec3 q(glm::round(127.0F * (n / length)));
  auto byte = [](int v) { return static_cast<std::uint32_t>(static_cast<std::uint8_t>(static_cast<std::int8_t>(v))); };
  return byte(q.x) | byte(q.y) << 8 | byte(q.z) << 16 | 0xFF000000U;
}

glm::ivec3 unpackNormal(std::uint32_t packed) {
  auto part = [packed](int shift) { return static_cast<int>(static_cast<std::int8_t>(packed >> shift)); };
  return packed == 0 ? glm::ivec3(0) : glm::ivec3(part(0), part(8), part(16));
}

base::Result<SourceSpool> SourceSpool::create(const std::string& directory) {
  LUMIGRID_ASSIGN_OR_RETURN(auto vertices, SpoolFile::create(directory + "/vertices"));
  LUMIGRID_ASSIGN_OR_RETURN(auto triangles, SpoolFile::create(directory + "/triangles"));
  SourceSpool spool(std::move(vertices), std::move(triangles));
  LUMIGRID_ASSIGN_OR_RETURN(spool.units_, PictureUnits::create(directory));
  return spool;
}

base::Result<SourceSpool> SourceSpool::open(const std::string& directory) {
  LUMIGRID_ASSIGN_OR_RETURN(auto vertices, SpoolFile::open(directory + "/vertices"));
  LUMIGRID_ASSIGN_OR_RETURN(auto triangles, SpoolFile::open(directory + "/triangles"));
  SourceSpool spool(std::move(vertices), std::move(triangles));
  LUMIGRID_TRY(spool.findBlocks(directory));
  return spool;
}

base::Result<void> SourceSpool::findBlocks(const std::string& directory) {
  const auto find = [&](const SpoolFile& file, std::vector<Block>& blocks, auto bytes) -> base::Result<void> {
    Block block;
    while (block.offset < file.size()) {
      BlockHeader header;
      if (file.size() - block.offset < sizeof(header)) return damagedWorkFiles(directory);
      std::uint8_t room[sizeof(header)];
      LUMIGRID_TRY(file.readAt(block.offset, room));
      std::memcpy(&header, room, sizeof(header));
      block.count = header.count, block.flags = header.flags;
      const std::uint64_t end = block.offset + sizeof(header) + bytes(header.count, header.flags);
      if (end > file.size()) return damagedWorkFiles(directory);
      blocks.push_back(block);
      block.first += header.count, block.offset = end;
    }
    return {};
  };
  LUMIGRID_TRY(find(vertices_, vertex_blocks_, vertexBlockBytes));
  return find(triangles_, triangle_blocks_, triangleBlockBytes);
}

void SourceSpool::beginFile(const std::string& name) {
  name_ = name;
  file_ = {info_.vertices, info_.triangles, vertices_.size(), triangles_.size()};
}

base::Result<void> SourceSpool::restart() {
  LUMIGRID_TRY(vertices_.flush());
  LUMIGRID_TRY(triangles_.flush());
  LUMIGRID_TRY(vertices_.truncate(file_.vertex_bytes));
  LUMIGRID_TRY(triangles_.truncate(file_.triangle_bytes));
  info_.vertices = file_.vertices;
  info_.triangles = file_.triangles;
  std::erase_if(vertex_blocks_, [this](const Block& block) { return block.offset >= file_.vertex_bytes; });
  std::erase_if(triangle_blocks_, [this](const Block& block) { return block.offset >= file_.triangle_bytes; });
  // Only bits of this file's vertices are cleared. A bit left set would count an unused vertex as referenced.
  for (std::uint64_t v = file_.vertices; v < 64 * used_.size(); ++v) used_[v / 64] &= ~(std::uint64_t{1} << (v % 64));
  while (!sampled_.empty() && *std::max_element(sampled_.end() - 3, sampled_.end()) >= file_.vertices)
    sampled_.resize(sampled_.size() - 3);
  return {};
}

base::Result<void> SourceSpool::vertices(const mesh::VertexBlock& block) {
  const std::size_t count = block.positions.size();
  if (count == 0) return {};
  for (std::size_t i = 0; i < count; ++i) {
    const glm::dvec3& p = block.positions[i];
    if (std::abs(p.x) <= kMaxCoordinate && std::abs(p.y) <= kMaxCoordinate && std::abs(p.z) <= kMaxCoordinate) continue;
    const bool finite = std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
    return base::Error{base::ErrorCode::kInvalidInput,
                       name_ + ": vertex " + std::to_string(info_.vertices - file_.vertices + i) +
                           ": a coordinate is " + (finite ? "larger than 1e18" : "not finite (NaN or infinite)") +
                           "; mend or remove the vertex"};
  }
  const bool wide = !fitsFloat(block.positions);
  scratch_.clear();
  const BlockHeader header{static_cast<std::uint32_t>(count), (wide ? kDouble : 0U) |
                                                                  (block.normals.empty() ? 0U : kNormals) |
                                                                  (block.colors.empty() ? 0U : kColors)};
  put(scratch_, &header, 1);
  if (wide) {
    put(scratch_, block.positions.data(), count);
  } else {
    const std::size_t at = scratch_.size();
    scratch_.resize(at + count * sizeof(glm::vec3));
    for (std::size_t i = 0; i < count; ++i) {
      const glm::vec3 p(block.positions[i]);
      std::memcpy(scratch_.data() + at + i * sizeof(p), &p, sizeof(p));
    }
  }
  for (const glm::vec3& n : block.normals) {
    const std::uint32_t packed = packNormal(n);
    put(scratch_, &packed, 1);
  }
  for (glm::u8vec4 c : block.colors) {
    c.a = 255;
    colors_.add(c);
    put(scratch_, &c, 1);
  }
  vertex_blocks_.push_back({info_.vertices, vertices_.size(), header.count, header.flags});
  info_.vertices += count;
  info_.has_normals |= !block.normals.empty();
  info_.has_colors |= !block.colors.empty();
  return vertices_.append(scratch_);
}

base::Result<void> SourceSpool::triangles(const mesh::TriangleBlock& block) {
  const std::size_t corners = block.corners.size();
  if (corners == 0) return {};
  std::uint64_t highest = 0;
  for (const std::uint64_t c : block.corners) highest = std::max(highest, c + file_.vertices);
  if (highest / 64 >= used_.size()) used_.resize(std::max<std::size_t>(highest / 64 + 1, used_.size() * 3 / 2), 0);
  const bool wide = highest > std::numeric_limits<std::uint32_t>::max();
  scratch_.clear();
  const BlockHeader header{static_cast<std::uint32_t>(corners / 3),
                           (wide ? kWide : 0U) | (block.colors.empty() ? 0U : kColors) |
                               (block.normals.empty() ? 0U : kNormals) | (block.pictures.empty() ? 0U : kTextures)};
  put(scratch_, &header, 1);
  const std::size_t at = scratch_.size();
  scratch_.resize(at + corners * (wide ? 8U : 4U));
  for (std::size_t i = 0; i < corners; i += 3) {
    const std::uint64_t *c = &block.corners[i], first = file_.vertices;
    if (c[0] == c[1] || c[1] == c[2] || c[2] == c[0]) continue;  // the sorter leaves it out
    for (std::size_t k = 0; k < 3; ++k) used_[(c[k] + first) / 64] |= std::uint64_t{1} << ((c[k] + first) % 64);
  }
  for (std::size_t i = 0; i < corners; ++i) {
    const std::uint64_t v = block.corners[i] + file_.vertices;
    const auto narrow = static_cast<std::uint32_t>(v);
    if (wide)
      std::memcpy(scratch_.data() + at + 8 * i, &v, 8);
    else
      std::memcpy(scratch_.data() + at + 4 * i, &narrow, 4);
  }
  put(scratch_, block.colors.data(), block.colors.size());
  for (const glm::u8vec4& c : block.colors)
    if (c.a != 0) colors_.add(c);
  for (const glm::vec3& n : block.normals) {
    const std::uint32_t packed = packNormal(n);
    put(scratch_, &packed, 1);
  }
  // The file's pictures are numbered behind those of the files before.
  put(scratch_, block.uv.data(), block.uv.size());
  for (std::uint32_t picture : block.pictures) {
    if (picture != mesh::kNoPicture) picture += static_cast<std::uint32_t>(info_.pictures.size());
    put(scratch_, &picture, 1);
  }
  sample(block.corners);
  triangle_blocks_.push_back({info_.triangles, triangles_.size(), header.count, header.flags});
  info_.triangles += corners / 3;
  info_.has_colors |= !block.colors.empty();
  info_.has_normals |= !block.normals.empty();
  return triangles_.append(scratch_);
}

// Samples every sample_stride_-th triangle; where there are too many, drops every other one and doubles the stride.
void SourceSpool::sample(std::span<const std::uint64_t> corners) {
  const std::uint64_t first = (info_.triangles + sample_stride_ - 1) / sample_stride_ * sample_stride_;
  for (std::uint64_t t = first; t < info_.triangles + corners.size() / 3; t += sample_stride_) {
    if (t % sample_stride_ != 0) t += sample_stride_ - t % sample_stride_;
    if (t >= info_.triangles + corners.size() / 3) break;
    for (std::size_t k = 0; k < 3; ++k)
      sampled_.push_back(corners[3 * static_cast<std::size_t>(t - info_.triangles) + k] + file_.vertices);
    if (sampled_.size() < 3 * kMaxSampledTriangles) continue;
    std::size_t kept = 0;
    for (std::size_t i = 0; i < sampled_.size(); i += 6)
      for (std::size_t k = 0; k < 3; ++k) sampled_[kept++] = sampled_[i + k];
    sampled_.resize(kept);
    sample_stride_ *= 2;
  }
}

base::Result<SourceInfo> SourceSpool::finish(bool accepts_points, unsigned threads) {
  info_.is_painted = info_.triangles > 0 && info_.pictures.empty() && colors_.areOfPaint();
  LUMIGRID_TRY(vertices_.flush());
  LUMIGRID_TRY(triangles_.flush());
  if (info_.triangles == 0 && !accepts_points)
    return base::Error{base::ErrorCode::kInvalidInput, "the mesh has no triangles"};
  if (info_.vertices == 0) return base::Error{base::ErrorCode::kInvalidInput, "the mesh has no vertices"};
  LUMIGRID_TRY(measure(threads));
  used_ = std::vector<std::uint64_t>();
  sampled_ = std::vector<std::uint64_t>();
  return info_;
}

struct SourceSpool::BlockMeasure {
  std::uint64_t referenced = 0;
  glm::dvec3 sum{0.0};
  std::array<glm::dvec3, 3> lowest{}, highest{};  // by axis: the vertex of the least and of the largest coordinate

  void add(const glm::dvec3& p) {
    if (referenced++ == 0) lowest = highest = {p, p, p};
    sum += p;
    addEnd(p);
  }
  void add(const BlockMeasure& block) {
    if (block.referenced == 0) return;
    if (referenced == 0) lowest = block.lowest, highest = block.highest;
    referenced += block.referenced;
    sum += block.sum;
    for (const auto* ends : {&block.lowest, &block.highest})
      for (const glm::dvec3& end : *ends) addEnd(end);
  }
  glm::dvec3 low() const { return {lowest[0].x, lowest[1].y, lowest[2].z}; }
  glm::dvec3 high() const { return {highest[0].x, highest[1].y, highest[2].z}; }
  // The end that is farthest from the middle along its axis.
  glm::dvec3 farthest() const {
    const glm::dvec3 middle = sum / static_cast<double>(referenced);
    glm::dvec3 place = lowest[0];
    double distance = -1.0;
    for (int k = 0; k < 3; ++k)
      for (const auto* ends : {&lowest, &highest}) {
        const glm::dvec3& end = (*ends)[static_cast<std::size_t>(k)];
        if (std::abs(end[k] - middle[k]) > distance) distance = std::abs(end[k] - middle[k]), place = end;
      }
    return place;
  }

 private:
  void addEnd(const glm::dvec3& p) {
    for (int k = 0; k < 3; ++k) {
      const auto axis = static_cast<std::size_t>(k);
      if (p[k] < lowest[axis][k]) lowest[axis] = p;
      if (p[k] > highest[axis][k]) highest[axis] = p;
    }
  }
};

// The sampled corners, ordered by block, and their positions as they are read.
struct SourceSpool::SampledCorners {
  std::vector<std::uint32_t> corners;  // places in sampled_
  std::vector<std::size_t> begin;      // by block: the first of its own
  std::vector<glm::dvec3> found;       // as many as sampled_
};

// Measures the box of the referenced vertices and the edges of the sampled triangles in one pass over the vertices.
base::Result<void> SourceSpool::measure(unsigned threads) {
  used_.resize(static_cast<std::size_t>(info_.vertices / 64 + 1), 0);
  const auto blockOf = [this](std::uint64_t vertex) {
    const auto after = std::upper_bound(vertex_blocks_.begin(), vertex_blocks_.end(), vertex,
                                        [](std::uint64_t v, const Block& block) { return v < block.first; });
    return static_cast<std::size_t>(after - vertex_blocks_.begin()) - 1;
  };
  SampledCorners sampled;
  sampled.found.resize(sampled_.size());
  sampled.corners.resize(sampled_.size());
  sampled.begin.assign(vertexBlocks() + 1, 0);
  std::vector<std::size_t> blocks;
  blocks.reserve(sampled_.size());
  for (const std::uint64_t vertex : sampled_) ++sampled.begin[blocks.emplace_back(blockOf(vertex)) + 1];
  std::partial_sum(sampled.begin.begin(), sampled.begin.end(), sampled.begin.begin());
  std::vector<std::size_t> next = sampled.begin;
  for (std::uint32_t i = 0; i < blocks.size(); ++i) sampled.corners[next[blocks[i]]++] = i;

  std::vector<BlockMeasure> measured(vertexBlocks());
  LUMIGRID_TRY(base::tryParallelFor(vertexBlocks(), threads,
                                    [&](std::size_t block) { return measureBlock(block, measured[block], sampled); }));
  BlockMeasure all;
  for (const BlockMeasure& block : measured) all.add(block);
  info_.referenced = all.referenced;
  if (all.referenced > 0)  // else all triangles are degenerate, which the sorter says
    info_.box_min = all.low(), info_.box_max = all.high(), info_.far_place = all.farthest();
  measureEdges(sampled.found);
  return {};
}

void SourceSpool::measureEdges(std::span<const glm::dvec3> corners) {
  std::vector<double> lengths;
  lengths.reserve(corners.size());
  double log_sum = 0.0;
  std::size_t coincident = 0;
  for (std::size_t t = 0; t < corners.size(); t += 3) {
    bool has_short = false;
    for (std::size_t k = 0; k < 3; ++k) {
      const double length = glm::length(corners[t + (k + 1) % 3] - corners[t + k]);
      if (length > 0.0) log_sum += std::log(length), lengths.push_back(length);
      has_short |= length == 0.0 && sampled_[t + (k + 1) % 3] != sampled_[t + k];
    }
    coincident += has_short ? 1 : 0;
  }
  if (lengths.empty()) return;
  info_.mean_edge = std::exp(log_sum / static_cast<double>(lengths.size()));
  const auto tenth = lengths.begin() + static_cast<std::ptrdiff_t>(lengths.size() / 10);
  std::nth_element(lengths.begin(), tenth, lengths.end());
  info_.short_edge = *tenth;
  info_.coincident = static_cast<double>(coincident) / static_cast<double>(corners.size() / 3);
  for (std::uint32_t bits = kMinLatticeBits; bits <= kMaxLatticeBits; ++bits)
    info_.lost[bits] = lostShare(corners, bits);
}

double SourceSpool::lostShare(std::span<const glm::dvec3> corners, std::uint32_t bits) const {
  const SourceLattice lattice = makeLattice(info_, glm::dvec3(0.0), bits);
  std::size_t lost = 0;
  for (std::size_t t = 0; t < corners.size(); t += 3) {
    bool meets = false, is_lost_anyway = false;
    for (std::size_t k = 0; k < 3; ++k) {
      const glm::dvec3 &from = corners[t + k], &to = corners[t + (k + 1) % 3];
      is_lost_anyway |= from == to;
      meets |= lattice.point(from) == lattice.point(to);
    }
    lost += meets && !is_lost_anyway ? 1 : 0;
  }
  return static_cast<double>(lost) / static_cast<double>(corners.size() / 3);
}

base::Result<void> SourceSpool::measureBlock(std::size_t block, BlockMeasure& out, SampledCorners& sampled) const {
  SpooledVertices vertices;
  LUMIGRID_TRY(readVertices(block, vertices));
  for (std::size_t i = 0; i < vertices.positions.size(); ++i) {
    const std::uint64_t v = vertices.first + i;
    if (info_.triangles != 0 && (used_[static_cast<std::size_t>(v / 64)] >> (v % 64) & 1U) == 0) continue;
    out.add(vertices.positions[i]);
  }
  for (std::size_t c = sampled.begin[block]; c < sampled.begin[block + 1]; ++c)
    sampled.found[sampled.corners[c]] =
        vertices.positions[static_cast<std::size_t>(sampled_[sampled.corners[c]] - vertices.first)];
  return {};
}

// Reads a block's bytes after its header into `packed`, and returns them.
base::Result<base::ByteView> SourceSpool::readPacked(const SpoolFile& file, const Block& block, std::uint64_t bytes,
                                                     base::Bytes& packed) {
  packed.resize(static_cast<std::size_t>(bytes));
  LUMIGRID_TRY(file.readAt(block.offset + sizeof(BlockHeader), packed));
  return base::ByteView(packed);
}

base::Result<void> SourceSpool::readVertices(std::size_t block, SpooledVertices& out) const {
  const Block& at = vertex_blocks_[block];
  out.first = at.first;
  LUMIGRID_ASSIGN_OR_RETURN(auto in, readPacked(vertices_, at, vertexBlockBytes(at.count, at.flags), out.packed));
  unpackNarrow<glm::vec3>(in, out.positions, at.count, (at.flags & kDouble) == 0);
  unpack(in, out.normals, (at.flags & kNormals) != 0 ? at.count : 0);
  unpack(in, out.colors, (at.flags & kColors) != 0 ? at.count : 0);
  return {};
}

base::Result<void> SourceSpool::readTriangles(std::size_t block, SpooledTriangles& out) const {
  const Block& at = triangle_blocks_[block];
  out.first = at.first;
  LUMIGRID_ASSIGN_OR_RETURN(auto in, readPacked(triangles_, at, triangleBlockBytes(at.count, at.flags), out.packed));
  const std::size_t corners = 3 * std::size_t{at.count};
  unpackNarrow<std::uint32_t>(in, out.corners, corners, (at.flags & kWide) == 0);
  unpack(in, out.colors, (at.flags & kColors) != 0 ? corners : 0);
  unpack(in, out.normals, (at.flags & kNormals) != 0 ? corners : 0);
  unpack(in, out.uv, (at.flags & kTextures) != 0 ? corners : 0);
  unpack(in, out.pictures, (at.flags & kTextures) != 0 ? at.count : 0);
  return {};
}

void SourceSpool::remove(const std::string& directory) {
  std::error_code ignored;
  for (const char* name : {"/vertices", "/triangles"}) std::filesystem::remove(directory + name, ignored);
}

}  // namespace lod::ingest
