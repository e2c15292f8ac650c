#include "lod/qsplat/builder/point_tiles.h"

#include <algorithm>
#include <cstring>

#include "base/fields.h"
#include "lod/ingest/morton.h"
#include "lod/ingest/work_directory.h"

namespace lod::qsplat::builder {
namespace {

constexpr std::size_t kMaxSamples = std::size_t{1} << 20;        // 8 MB
constexpr std::uint64_t kBufferBytes = std::uint64_t{64} << 20;  // bytes of all tiles together

// A source point as it lies in the file.
struct Record {
  std::uint64_t code = 0;
  std::uint32_t color = 0;   // R G B A from the lowest byte; A = 0 where unknown
  std::uint32_t normal = 0;  // packNormal; 0 where unknown
};

std::uint64_t codeOf(const ingest::SourceLattice& lattice, const glm::dvec3& world) {
  return ingest::mortonCode(lattice.point(world));
}

// The first codes of all tiles but the first tile are quantiles of a sample.
base::Result<std::vector<std::uint64_t>> splitters(const ingest::SourceSpool& source, const ingest::SourceInfo& info,
                                                   const ingest::SourceLattice& lattice) {
  const std::uint64_t stride = (info.vertices + kMaxSamples - 1) / kMaxSamples;
  std::vector<std::uint64_t> samples;
  LUMIGRID_TRY(source.forEachVertexBlock([&](const ingest::SpooledVertices& block) -> base::Result<void> {
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

}  // namespace

base::Result<PointTiles> PointTiles::sort(const ingest::SourceSpool& source, const ingest::SourceInfo& info,
                                          const ingest::SourceLattice& lattice, const std::string& directory,
                                          const std::function<bool(double)>& progress) {
  LUMIGRID_ASSIGN_OR_RETURN(auto file, ingest::SpoolFile::create(directory + "/points"));
  LUMIGRID_ASSIGN_OR_RETURN(const auto first_codes, splitters(source, info, lattice));
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
  const auto store = [&](const ingest::SpooledVertices& block) -> base::Result<void> {
    for (std::size_t i = 0; i < block.positions.size(); ++i) {
      const Record record{codeOf(lattice, block.positions[i]), block.colors.empty() ? 0 : block.colors[i],
                          block.normals.empty() ? 0 : block.normals[i]};
      const auto tile = static_cast<std::size_t>(std::upper_bound(first_codes.begin(), first_codes.end(), record.code) -
                                                 first_codes.begin());
      const auto* bytes = reinterpret_cast<const std::uint8_t*>(&record);
      buffers[tile].insert(buffers[tile].end(), bytes, bytes + sizeof(record));
      ++out.tiles_[tile].points;
      out.tiles_[tile].box.add(lattice.lattice.position(ingest::mortonPoint(record.code)));
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
    for (const ingest::Extent& extent : tile.extents) out.write(extent);
  }
  return out.takeBytes();
}

base::Result<PointTiles> PointTiles::open(const std::string& directory, const ingest::SourceLattice& lattice,
                                          base::ByteView state) {
  const base::Error broken = ingest::damagedWorkFiles(directory);
  LUMIGRID_ASSIGN_OR_RETURN(auto file, ingest::SpoolFile::open(directory + "/points"));
  PointTiles out;
  base::ByteReader in(state);
  if (in.u64() != file.size()) return broken;
  const std::uint64_t tiles = in.u64();
  if (!in.ok() || tiles > in.remaining() / 16) return broken;
  out.tiles_.resize(static_cast<std::size_t>(tiles));
  for (Tile& tile : out.tiles_) {
    std::uint64_t extents = 0;
    base::readFields(in, std::tie(tile.points, tile.box, extents));
    if (!in.ok() || extents > in.remaining() / sizeof(ingest::Extent)) return broken;
    for (std::uint64_t e = 0; e < extents; ++e) tile.extents.push_back(in.read<ingest::Extent>());
  }
  if (!in.atEnd()) return broken;
  out.file_ = std::move(file);
  out.lattice_ = lattice;
  return out;
}

base::Result<std::vector<SourcePoint>> PointTiles::read(std::size_t tile) const {
  std::vector<Record> records(static_cast<std::size_t>(tiles_[tile].points));
  auto* to = reinterpret_cast<std::uint8_t*>(records.data());
  for (const ingest::Extent& extent : tiles_[tile].extents) {
    LUMIGRID_TRY(file_.readAt(extent.offset, std::span(to, static_cast<std::size_t>(extent.bytes))));
    to += extent.bytes;
  }
  // Points at one place stay in the source's order, so that sums are the same each time.
  std::stable_sort(records.begin(), records.end(), [](const Record& a, const Record& b) { return a.code < b.code; });

  std::vector<SourcePoint> points;
  points.reserve(records.size());
  for (std::size_t begin = 0, end = 0; begin < records.size(); begin = end) {
    ingest::VertexSums sums;
    for (; end < records.size() && records[end].code == records[begin].code; ++end)
      sums.add(glm::i64vec3(0), {records[end].code, records[end].color, records[end].normal});
    SourcePoint& point = points.emplace_back();
    point.code = records[begin].code;
    point.position = lattice_.lattice.position(ingest::mortonPoint(point.code));
    point.normal = glm::vec3(sums.normal);
    point.color = glm::u8vec3(sums.meanColor());
  }
  return points;
}

}  // namespace lod::qsplat::builder
