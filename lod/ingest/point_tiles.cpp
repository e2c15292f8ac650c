#include "lod/ingest/point_tiles.h"

#include <algorithm>

#include "base/fields.h"
#include "lod/ingest/morton.h"
#include "lod/ingest/work_directory.h"

namespace lod::ingest {
namespace {

constexpr std::size_t kMaxSamples = std::size_t{1} << 20;           // 8 MB
constexpr std::uint64_t kBufferBytes = std::uint64_t{64} << 20;     // bytes of all tiles together
constexpr std::uint64_t kMaxColorBytes = std::uint64_t{128} << 20;  // of 32 million vertices

std::uint64_t codeOf(const SourceLattice& lattice, const glm::dvec3& world) {
  return mortonCode(lattice.point(world));
}

// The first codes of all tiles but the first tile are quantiles of a sample.
base::Result<std::vector<std::uint64_t>> splitters(const SourceSpool& source, const SourceInfo& info,
                                                   const SourceLattice& lattice) {
  const std::uint64_t stride = (info.vertices + kMaxSamples - 1) / kMaxSamples;
  std::vector<std::uint64_t> samples;
  LUMIGRID_TRY(source.forEachVertexBlock([&](const SpooledVertices& block) -> base::Result<void> {
    for (std::uint64_t v = (block.first + stride - 1) / stride * stride; v < block.first + block.positions.size();
         v += stride)
      samples.push_back(codeOf(lattice, block.positions[static_cast<std::size_t>(v - block.first)]));
    return {};
  }));
  std::sort(samples.begin(), samples.end());
  const std::uint64_t tiles = (info.vertices + PointTiles::kPoints - 1) / PointTiles::kPoints;
  std::vector<std::uint64_t> out;
  for (std::uint64_t t = 1; t < tiles; ++t) {
    const std::uint64_t code = samples[static_cast<std::size_t>(t * samples.size() / tiles)];
    if (out.empty() ? code > 0 : code > out.back()) out.push_back(code);
  }
  return out;
}

// The vertices of a mesh that triangles use, with the colours and normals of their corners where these have some.
class UsedVertices {
 public:
  // Reads all triangles. The last of several corners counts. `max_bytes` bounds what colours take, and normals; above,
  // vertices keep their own.
  static base::Result<UsedVertices> find(const SourceSpool& source, const SourceInfo& info, std::uint64_t max_bytes) {
    UsedVertices out;
    if (info.triangles == 0) return out;
    out.used_.resize(static_cast<std::size_t>(info.vertices), false);
    SpooledTriangles block;
    for (std::size_t b = 0; b < source.triangleBlocks(); ++b) {
      LUMIGRID_TRY(source.readTriangles(b, block));
      for (const std::uint64_t corner : block.corners) out.used_[static_cast<std::size_t>(corner)] = true;
      if (sizeof(std::uint32_t) * info.vertices > max_bytes) continue;
      out.take(block.corners, block.colors, out.colors_);
      out.take(block.corners, block.normals, out.normals_);
    }
    return out;
  }
  bool contains(std::uint64_t vertex) const { return used_.empty() || used_[static_cast<std::size_t>(vertex)]; }
  std::uint32_t colorOf(std::uint64_t vertex, std::uint32_t own) const { return either(colors_, vertex, own); }
  std::uint32_t normalOf(std::uint64_t vertex, std::uint32_t own) const { return either(normals_, vertex, own); }

 private:
  void take(const std::vector<std::uint64_t>& corners, const std::vector<std::uint32_t>& values,
            std::vector<std::uint32_t>& of_vertices) const {
    if (!values.empty()) of_vertices.resize(used_.size(), 0);
    for (std::size_t c = 0; c < values.size(); ++c)
      if (values[c] != 0) of_vertices[static_cast<std::size_t>(corners[c])] = values[c];
  }
  static std::uint32_t either(const std::vector<std::uint32_t>& of_corners, std::uint64_t vertex, std::uint32_t own) {
    const std::uint32_t of_corner = of_corners.empty() ? 0 : of_corners[static_cast<std::size_t>(vertex)];
    return of_corner != 0 ? of_corner : own;
  }

  std::vector<bool> used_;
  std::vector<std::uint32_t> colors_, normals_;  // by vertex, 0 where unknown; empty where no corner has one
};

}  // namespace

base::Result<PointTiles> PointTiles::sort(const SourceSpool& source, const SourceInfo& info,
                                          const SourceLattice& lattice, const std::string& directory,
                                          const std::function<bool(double)>& progress) {
  LUMIGRID_ASSIGN_OR_RETURN(auto file, SpoolFile::create(directory + "/points"));
  LUMIGRID_ASSIGN_OR_RETURN(const auto first_codes, splitters(source, info, lattice));
  LUMIGRID_ASSIGN_OR_RETURN(const auto used, UsedVertices::find(source, info, kMaxColorBytes));
  PointTiles out;
  out.file_ = std::move(file);
  out.lattice_ = lattice;
  out.tiles_.resize(first_codes.size() + 1);
  std::vector<base::Bytes> buffers(out.tiles_.size());
  const auto limit =
      static_cast<std::size_t>(std::clamp<std::uint64_t>(kBufferBytes / buffers.size(), 4096, std::uint64_t{1} << 18));
  const auto flush = [&](std::size_t tile) -> base::Result<void> {
    if (buffers[tile].empty()) return {};
    out.tiles_[tile].extents.push_back({out.file_.size(), buffers[tile].size()});
    LUMIGRID_TRY(out.file_.append(buffers[tile]));
    buffers[tile].clear();
    return {};
  };
  const auto store = [&](const SpooledVertices& block) -> base::Result<void> {
    for (std::size_t i = 0; i < block.positions.size(); ++i) {
      const std::uint64_t vertex = block.first + i;
      if (!used.contains(vertex)) continue;
      const Record record{codeOf(lattice, block.positions[i]),
                          used.colorOf(vertex, block.colors.empty() ? 0 : block.colors[i]),
                          used.normalOf(vertex, block.normals.empty() ? 0 : block.normals[i])};
      const auto tile = static_cast<std::size_t>(std::upper_bound(first_codes.begin(), first_codes.end(), record.code) -
                                                 first_codes.begin());
      const auto* bytes = reinterpret_cast<const std::uint8_t*>(&record);
      buffers[tile].insert(buffers[tile].end(), bytes, bytes + sizeof(record));
      ++out.tiles_[tile].points;
      out.tiles_[tile].box.add(lattice.lattice.position(mortonPoint(record.code)));
      if (buffers[tile].size() >= limit) LUMIGRID_TRY(flush(tile));
    }
    if (progress && !progress(static_cast<double>(block.first) / static_cast<double>(info.vertices)))
      return base::Error{base::ErrorCode::kCancelled, "sorting the points was cancelled"};
    return {};
  };
  LUMIGRID_TRY(source.forEachVertexBlock(store));
  for (std::size_t t = 0; t < buffers.size(); ++t) LUMIGRID_TRY(flush(t));
  LUMIGRID_TRY(out.file_.flush());
  return out;
}

base::Bytes PointTiles::encodeTables() const {
  base::ByteWriter out;
  out.u64(file_.size());
  out.u64(tiles_.size());
  for (const Tile& tile : tiles_) {
    const std::uint64_t extents = tile.extents.size();
    base::writeFields(out, std::tie(tile.points, tile.box, extents));
    for (const Extent& extent : tile.extents) out.write(extent);
  }
  return out.takeBytes();
}

base::Result<PointTiles> PointTiles::open(const std::string& directory, const SourceLattice& lattice,
                                          base::ByteView state) {
  const base::Error broken = damagedWorkFiles(directory);
  LUMIGRID_ASSIGN_OR_RETURN(auto file, SpoolFile::open(directory + "/points"));
  PointTiles out;
  base::ByteReader in(state);
  if (in.u64() != file.size()) return broken;
  const std::uint64_t tiles = in.u64();
  if (!in.ok() || tiles > in.remaining() / 16) return broken;
  out.tiles_.resize(static_cast<std::size_t>(tiles));
  for (Tile& tile : out.tiles_) {
    std::uint64_t extents = 0;
    base::readFields(in, std::tie(tile.points, tile.box, extents));
    if (!in.ok() || extents > in.remaining() / sizeof(Extent)) return broken;
    for (std::uint64_t e = 0; e < extents; ++e) tile.extents.push_back(in.read<Extent>());
  }
  if (!in.atEnd()) return broken;
  out.file_ = std::move(file);
  out.lattice_ = lattice;
  return out;
}

base::Result<std::vector<PointTiles::Record>> PointTiles::readRecords(std::size_t tile) const {
  std::vector<Record> records(static_cast<std::size_t>(tiles_[tile].points));
  auto* to = reinterpret_cast<std::uint8_t*>(records.data());
  for (const Extent& extent : tiles_[tile].extents) {
    LUMIGRID_TRY(file_.readAt(extent.offset, std::span(to, static_cast<std::size_t>(extent.bytes))));
    to += extent.bytes;
  }
  return records;
}

base::Result<std::vector<std::uint64_t>> PointTiles::codes(std::size_t tile) const {
  LUMIGRID_ASSIGN_OR_RETURN(const auto records, readRecords(tile));
  std::vector<std::uint64_t> codes;
  codes.reserve(records.size());
  for (const Record& record : records) codes.push_back(record.code);
  std::sort(codes.begin(), codes.end());
  return codes;
}

base::Result<std::vector<SourcePoint>> PointTiles::read(std::size_t tile) const {
  LUMIGRID_ASSIGN_OR_RETURN(auto records, readRecords(tile));
  // Points at one place stay in the source's order, so that sums are the same each time.
  std::stable_sort(records.begin(), records.end(), [](const Record& a, const Record& b) { return a.code < b.code; });

  std::vector<SourcePoint> points;
  points.reserve(records.size());
  for (std::size_t begin = 0, end = 0; begin < records.size(); begin = end) {
    VertexSums sums;
    for (; end < records.size() && records[end].code == records[begin].code; ++end)
      sums.add({}, {records[end].code, records[end].color, records[end].normal});
    SourcePoint& point = points.emplace_back();
    point.code = records[begin].code;
    point.position = lattice_.lattice.position(mortonPoint(point.code));
    point.normal = glm::vec3(sums.normal);
    point.color = glm::u8vec3(sums.meanColor());
  }
  return points;
}

}  // namespace lod::ingest
