#include "lod/build/source_spool.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>

namespace lod::build {
namespace {

// Squares of coordinates must stay finite in float32.
constexpr double kMaxCoordinate = 1e18;
constexpr std::size_t kMaxSampledTriangles = std::size_t{1} << 14;
constexpr std::uint32_t kDouble = 1, kNormals = 2, kColors = 4, kWide = 8;

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
void take(base::ByteView& in, std::vector<T>& values, std::size_t count) {
  values.resize(count);
  if (count > 0) std::memcpy(values.data(), in.data(), count * sizeof(T));
  in = in.subspan(count * sizeof(T));
}

base::Result<BlockHeader> readHeader(SpoolReader& reader) {
  const auto bytes = reader.next(sizeof(BlockHeader));
  if (!bytes) return bytes.error();
  BlockHeader header;
  std::memcpy(&header, bytes->data(), sizeof(header));
  return header;
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
  auto vertices = SpoolFile::create(directory + "/vertices");
  if (!vertices) return vertices.error();
  auto triangles = SpoolFile::create(directory + "/triangles");
  if (!triangles) return triangles.error();
  return SourceSpool(std::move(*vertices), std::move(*triangles));
}

base::Result<SourceSpool> SourceSpool::open(const std::string& directory) {
  auto vertices = SpoolFile::open(directory + "/vertices");
  if (!vertices) return vertices.error();
  auto triangles = SpoolFile::open(directory + "/triangles");
  if (!triangles) return triangles.error();
  return SourceSpool(std::move(*vertices), std::move(*triangles));
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
  // Marks of the first try would only say that more vertices are in use; numbers beyond this file's first are cleared.
  for (std::uint64_t v = file_.vertices; v < 64 * used_.size(); ++v) used_[v / 64] &= ~(std::uint64_t{1} << (v % 64));
  while (!sampled_.empty() && *std::max_element(sampled_.end() - 3, sampled_.end()) >= file_.vertices)
    sampled_.resize(sampled_.size() - 3);
  return {};
}

base::Result<void> SourceSpool::vertices(const VertexBlock& block) {
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
    put(scratch_, &c, 1);
  }
  info_.vertices += count;
  info_.has_normals |= !block.normals.empty();
  info_.has_colors |= !block.colors.empty();
  return vertices_.append(scratch_);
}

base::Result<void> SourceSpool::triangles(const TriangleBlock& block) {
  const std::size_t corners = block.corners.size();
  if (corners == 0) return {};
  std::uint64_t highest = 0;
  for (const std::uint64_t c : block.corners) highest = std::max(highest, c + file_.vertices);
  if (highest / 64 >= used_.size()) used_.resize(std::max<std::size_t>(highest / 64 + 1, used_.size() * 3 / 2), 0);
  const bool wide = highest > std::numeric_limits<std::uint32_t>::max();
  scratch_.clear();
  const BlockHeader header{static_cast<std::uint32_t>(corners / 3), (wide ? kWide : 0U) |
                                                                        (block.colors.empty() ? 0U : kColors) |
                                                                        (block.normals.empty() ? 0U : kNormals)};
  put(scratch_, &header, 1);
  const std::size_t at = scratch_.size();
  scratch_.resize(at + corners * (wide ? 8U : 4U));
  for (std::size_t i = 0; i < corners; ++i) {
    const std::uint64_t v = block.corners[i] + file_.vertices;
    used_[v / 64] |= std::uint64_t{1} << (v % 64);
    const auto narrow = static_cast<std::uint32_t>(v);
    if (wide)
      std::memcpy(scratch_.data() + at + 8 * i, &v, 8);
    else
      std::memcpy(scratch_.data() + at + 4 * i, &narrow, 4);
  }
  put(scratch_, block.colors.data(), block.colors.size());
  for (const glm::vec3& n : block.normals) {
    const std::uint32_t packed = packNormal(n);
    put(scratch_, &packed, 1);
  }
  sample(block.corners);
  info_.triangles += corners / 3;
  info_.has_colors |= !block.colors.empty();
  info_.has_normals |= !block.normals.empty();
  return triangles_.append(scratch_);
}

// Every so many triangles; twice as many when there are too many.
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

base::Result<SourceInfo> SourceSpool::finish(bool points) {
  LUMIGRID_TRY(vertices_.flush());
  LUMIGRID_TRY(triangles_.flush());
  if (info_.triangles == 0 && !points) return base::Error{base::ErrorCode::kInvalidInput, "the mesh has no triangles"};
  if (info_.vertices == 0) return base::Error{base::ErrorCode::kInvalidInput, "the mesh has no vertices"};
  LUMIGRID_TRY(measure());
  used_ = std::vector<std::uint64_t>();
  sampled_ = std::vector<std::uint64_t>();
  return info_;
}

// Box of what is in use, and the mean edge of the sample: its corners' positions are met in one pass.
base::Result<void> SourceSpool::measure() {
  struct Corner {
    std::uint64_t vertex = 0;
    std::uint32_t place = 0;
  };
  std::vector<Corner> wanted(sampled_.size());
  for (std::uint32_t i = 0; i < wanted.size(); ++i) wanted[i] = {sampled_[i], i};
  std::sort(wanted.begin(), wanted.end(), [](const Corner& a, const Corner& b) { return a.vertex < b.vertex; });
  std::vector<glm::dvec3> found(wanted.size());

  glm::dvec3 low(std::numeric_limits<double>::max());
  glm::dvec3 high(std::numeric_limits<double>::lowest());
  std::size_t next = 0;
  used_.resize(static_cast<std::size_t>(info_.vertices / 64 + 1), 0);
  LUMIGRID_TRY(forEachVertexBlock([&](const SpooledVertices& block) -> base::Result<void> {
    for (std::size_t i = 0; i < block.positions.size(); ++i) {
      const std::uint64_t v = block.first + i;
      if (info_.triangles != 0 && (used_[static_cast<std::size_t>(v / 64)] >> (v % 64) & 1U) == 0) continue;
      ++info_.referenced;
      low = glm::min(low, block.positions[i]);
      high = glm::max(high, block.positions[i]);
      for (; next < wanted.size() && wanted[next].vertex == v; ++next) found[wanted[next].place] = block.positions[i];
    }
    return {};
  }));
  info_.box_min = low;
  info_.box_max = high;

  double log_sum = 0.0;
  double count = 0.0;
  for (std::size_t i = 0; i < found.size(); ++i) {
    const glm::dvec3 edge = found[i % 3 == 2 ? i - 2 : i + 1] - found[i];
    if (const double length = glm::length(edge); length > 0.0) log_sum += std::log(length), count += 1.0;
  }
  info_.mean_edge = count > 0.0 ? std::exp(log_sum / count) : 0.0;
  return {};
}

base::Result<void> SourceSpool::readVertices(SpoolReader& reader, SpooledVertices& block) {
  const auto header = readHeader(reader);
  if (!header) return header.error();
  const bool wide = (header->flags & kDouble) != 0;
  const std::size_t count = header->count;
  const std::size_t normals = (header->flags & kNormals) != 0 ? count : 0;
  const std::size_t colors = (header->flags & kColors) != 0 ? count : 0;
  auto bytes = reader.next(count * (wide ? 24U : 12U) + 4 * (normals + colors));
  if (!bytes) return bytes.error();
  base::ByteView in = *bytes;
  if (wide) {
    take(in, block.positions, count);
  } else {
    block.positions.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
      glm::vec3 p;
      std::memcpy(&p, in.data() + i * sizeof(p), sizeof(p));
      block.positions[i] = glm::dvec3(p);
    }
    in = in.subspan(count * sizeof(glm::vec3));
  }
  take(in, block.normals, normals);
  take(in, block.colors, colors);
  return {};
}

base::Result<void> SourceSpool::readTriangles(SpoolReader& reader, SpooledTriangles& block) {
  const auto header = readHeader(reader);
  if (!header) return header.error();
  const bool wide = (header->flags & kWide) != 0;
  const std::size_t corners = 3 * std::size_t{header->count};
  const std::size_t colors = (header->flags & kColors) != 0 ? corners : 0;
  const std::size_t normals = (header->flags & kNormals) != 0 ? corners : 0;
  auto bytes = reader.next(corners * (wide ? 8U : 4U) + 4 * (colors + normals));
  if (!bytes) return bytes.error();
  base::ByteView in = *bytes;
  if (wide) {
    take(in, block.corners, corners);
  } else {
    block.corners.resize(corners);
    for (std::size_t i = 0; i < corners; ++i) {
      std::uint32_t v = 0;
      std::memcpy(&v, in.data() + 4 * i, 4);
      block.corners[i] = v;
    }
    in = in.subspan(4 * corners);
  }
  take(in, block.colors, colors);
  take(in, block.normals, normals);
  return {};
}

void SourceSpool::remove() {
  std::error_code ignored;
  std::filesystem::remove(vertices_.path(), ignored);
  std::filesystem::remove(triangles_.path(), ignored);
}

}  // namespace lod::build
