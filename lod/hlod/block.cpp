#include "lod/hlod/block.h"

#include <algorithm>
#include <array>
#include <optional>
#include <set>
#include <utility>

#include "base/check.h"
#include "lod/patch/codec.h"
#include "lod/pmr/chunk_checksum.h"
#include "lod/pmr/chunks.h"

namespace lod::hlod {
namespace {

/// A piece of a block has at most so many triangles, vertices, or points.
constexpr std::size_t kMaxPiece =
    std::min<std::size_t>({patch::kMaxPatchTriangles, patch::kMaxPatchVertices, pmr::kMaxVertices});

using Corners = std::array<std::uint32_t, 3>;

Corners cornersOf(const NodeGeometry& geometry, std::size_t triangle) {
  const auto* first = geometry.triangles.data() + 3 * triangle;
  return {first[0], first[1], first[2]};
}

/// Some of a node's triangles, with vertices of their own.
struct Piece {
  patch::PatchGeometry geometry;
  std::vector<std::uint32_t> vertices;  ///< the node's vertex of each
};

/// Takes triangles in their order until a piece is full.
class PieceMaker {
 public:
  PieceMaker(const NodeGeometry& geometry, const BlockOptions& options)
      : geometry_(geometry), options_(options), numbers_(geometry.vertices.size(), kNone) {}

  std::size_t triangles() const { return geometry_.triangles.size() / 3; }
  bool atEnd() const { return next_ == triangles(); }

  Piece next() {
    Piece piece;
    while (!atEnd() && piece.geometry.indices.size() < 3 * kMaxPiece && piece.vertices.size() + 3 <= kMaxPiece) {
      for (const std::uint32_t vertex : cornersOf(geometry_, next_))
        piece.geometry.indices.push_back(add(piece, vertex));
      ++next_;
    }
    for (const std::uint32_t vertex : piece.vertices) numbers_[vertex] = kNone;
    return piece;
  }

 private:
  static constexpr std::uint32_t kNone = 0xFFFFFFFF;

  std::uint16_t add(Piece& piece, std::uint32_t vertex) {
    LUMIGRID_CHECK_LT(vertex, geometry_.vertices.size());
    if (numbers_[vertex] == kNone) {
      const NodeVertex& from = geometry_.vertices[vertex];
      numbers_[vertex] = static_cast<std::uint32_t>(piece.vertices.size());
      piece.vertices.push_back(vertex);
      piece.geometry.positions.push_back(from.place);
      piece.geometry.normals.push_back(from.normal);
      if (options_.colors && !options_.is_caster) piece.geometry.colors.emplace_back(from.color, 255);
    }
    return static_cast<std::uint16_t>(numbers_[vertex]);
  }

  const NodeGeometry& geometry_;
  const BlockOptions& options_;
  std::vector<std::uint32_t> numbers_;
  std::size_t next_ = 0;
};

/// By how many corners the decoded triangle is turned.
std::size_t turnOf(const std::array<glm::ivec3, 3>& given, const std::array<glm::ivec3, 3>& decoded) {
  for (std::size_t turn = 0; turn < 3; ++turn)
    if (decoded[0] == given[turn] && decoded[1] == given[(turn + 1) % 3] && decoded[2] == given[(turn + 2) % 3])
      return turn;
  return 0;
}

/// The corners of a piece's triangles in the order in which they are decoded, as vertices of the node.
std::vector<std::uint32_t> decodedCorners(const Piece& piece, base::ByteView bytes,
                                          const std::vector<std::uint32_t>& order) {
  const auto decoded = patch::decodePatch(bytes);
  LUMIGRID_CHECK(static_cast<bool>(decoded));
  std::vector<std::uint32_t> corners;
  for (std::size_t t = 0; t < order.size(); ++t) {
    const std::uint16_t* from = piece.geometry.indices.data() + std::size_t{3} * order[t];
    std::array<glm::ivec3, 3> given, came;
    for (std::size_t k = 0; k < 3; ++k) {
      given[k] = piece.geometry.positions[from[k]];
      came[k] = decoded->positions[decoded->indices[3 * t + k]];
    }
    const std::size_t turn = turnOf(given, came);
    for (std::size_t k = 0; k < 3; ++k) corners.push_back(piece.vertices[from[(turn + k) % 3]]);
  }
  return corners;
}

/// The places 3 · triangle + corner of the decoded triangles at which the edges begin, ascending.
std::vector<std::uint32_t> edgePlaces(const NodeGeometry& geometry, const std::vector<std::uint32_t>& corners) {
  std::set<std::pair<std::uint32_t, std::uint32_t>> edges;
  const auto ends = [](std::uint32_t a, std::uint32_t b) { return std::pair(std::min(a, b), std::max(a, b)); };
  for (std::size_t i = 0; i < geometry.edges.size(); i += 2)
    edges.insert(ends(geometry.edges[i], geometry.edges[i + 1]));
  LUMIGRID_CHECK_EQ(edges.size(), geometry.edges.size() / 2);
  std::vector<std::uint32_t> places;
  for (std::size_t place = 0; place < corners.size() && !edges.empty(); ++place) {
    const std::size_t next = place % 3 == 2 ? place - 2 : place + 1;
    if (edges.erase(ends(corners[place], corners[next])) > 0) places.push_back(static_cast<std::uint32_t>(place));
  }
  LUMIGRID_CHECK(edges.empty());
  return places;
}

/// Appends a piece's bytes behind their length.
void writePiece(base::ByteWriter& out, const base::Bytes& bytes) {
  out.varint(bytes.size());
  out.bytes(bytes);
}

void writeTriangles(base::ByteWriter& out, const NodeGeometry& geometry, const BlockOptions& options) {
  const auto normals = options.is_caster ? patch::StoredNormals::kOfFacets : patch::StoredNormals::kOfVertices;
  std::vector<std::uint32_t> corners;
  for (PieceMaker maker(geometry, options); !maker.atEnd();) {
    const Piece piece = maker.next();
    std::vector<std::uint32_t> order;
    const base::Bytes bytes = patch::encodePatch(piece.geometry, &order, normals);
    writePiece(out, bytes);
    if (geometry.edges.empty()) continue;
    const auto decoded = decodedCorners(piece, bytes, order);
    corners.insert(corners.end(), decoded.begin(), decoded.end());
  }
  std::uint32_t next = 0;
  for (const std::uint32_t place : edgePlaces(geometry, corners)) {
    out.varint(place - next);
    next = place + 1;
  }
}

void writePoints(base::ByteWriter& out, const NodeGeometry& geometry, const BlockOptions& options) {
  std::vector<pmr::CodedPoint> points;
  for (const NodeVertex& point : geometry.points)
    points.push_back({point.place, pmr::encodeNormal(point.normal), point.color});
  pmr::sortForChunk(points);
  for (std::size_t first = 0; first < points.size(); first += kMaxPiece)
    writePiece(out, pmr::encodePoints(std::span(points).subspan(first, std::min(kMaxPiece, points.size() - first)), {},
                                      options.colors));
}

/// The counts that a block's checksum covers.
struct BlockCounts {
  std::uint32_t triangles = 0, points = 0, edges = 0;
};
BlockCounts countsOf(const Node& row, const BlockOptions& options) {
  return options.is_caster ? BlockCounts{row.caster_triangles, 0, 0}
                           : BlockCounts{row.triangles, row.points, row.edges};
}

/// Decodes a block whose checksum is right. Each function returns false where the bytes cannot be.
class BlockReader {
 public:
  BlockReader(base::ByteView coded, const Node& row, const BlockOptions& options)
      : in_(coded), counts_(countsOf(row, options)), options_(options), end_(kLatticeEnd >> row.step_bits) {}

  std::optional<NodeGeometry> read() {
    if (!readTriangles() || !readEdges() || !readPoints() || !in_.atEnd()) return std::nullopt;
    return std::move(geometry_);
  }

 private:
  base::ByteView nextPiece() {
    const std::uint64_t length = in_.varint();
    return in_.bytes(static_cast<std::size_t>(std::min<std::uint64_t>(length, kMaxBlockBytes)));
  }

  bool isInside(const glm::ivec3& place) const {
    return glm::all(glm::greaterThanEqual(place, glm::ivec3(0))) &&
           glm::all(glm::lessThanEqual(place, glm::ivec3(end_)));
  }

  bool readTriangles() {
    const std::size_t corners = std::size_t{3} * counts_.triangles;
    while (geometry_.triangles.size() < corners) {
      const auto piece = patch::decodePatch(nextPiece());
      if (!piece || piece->indices.empty() || piece->indices.size() > corners - geometry_.triangles.size())
        return false;
      if (!options_.is_caster && piece->colors.empty() == options_.colors) return false;
      if (!append(*piece)) return false;
    }
    return true;
  }

  bool append(const patch::PatchGeometry& piece) {
    const auto first = static_cast<std::uint32_t>(geometry_.vertices.size());
    for (std::size_t v = 0; v < piece.positions.size(); ++v) {
      if (!isInside(piece.positions[v])) return false;
      NodeVertex& vertex = geometry_.vertices.emplace_back();
      vertex.place = piece.positions[v];
      if (options_.is_caster) continue;
      vertex.normal = piece.normals[v];
      if (options_.colors) vertex.color = glm::u8vec3(piece.colors[v]);
    }
    for (const std::uint16_t corner : piece.indices) geometry_.triangles.push_back(first + corner);
    return true;
  }

  bool readEdges() {
    std::uint64_t next = 0;
    for (std::uint32_t i = 0; i < counts_.edges; ++i) {
      const std::uint64_t gap = in_.varint();
      if (!in_.ok() || gap >= geometry_.triangles.size() - next) return false;
      const std::uint64_t place = next + gap;
      geometry_.edges.push_back(geometry_.triangles[place]);
      geometry_.edges.push_back(geometry_.triangles[place % 3 == 2 ? place - 2 : place + 1]);
      next = place + 1;
    }
    return true;
  }

  bool readPoints() {
    std::vector<pmr::CodedPoint> points;
    while (points.size() < counts_.points) {
      const std::size_t count = std::min(kMaxPiece, counts_.points - points.size());
      if (!pmr::decodePoints(nextPiece(), static_cast<std::uint32_t>(count), 0, options_.colors, points)) return false;
    }
    geometry_.points.reserve(points.size());
    for (const pmr::CodedPoint& point : points) {
      if (!isInside(point.place)) return false;
      geometry_.points.push_back({point.place, pmr::decodeNormal(point.normal), point.color});
    }
    return true;
  }

  base::ByteReader in_;
  const BlockCounts counts_;
  const BlockOptions options_;
  const std::int32_t end_;
  NodeGeometry geometry_;
};

std::optional<base::ByteView> intactBytes(base::ByteView bytes, const BlockCounts& counts) {
  return pmr::intactChunk(bytes, counts.triangles, counts.points);
}

}  // namespace

base::Bytes encodeBlock(const NodeGeometry& geometry, const BlockOptions& options) {
  LUMIGRID_CHECK(geometry.triangles.size() % 3 == 0 && geometry.edges.size() % 2 == 0);
  LUMIGRID_CHECK(!options.is_caster || (geometry.points.empty() && geometry.edges.empty()));
  const std::size_t triangles = geometry.triangles.size() / 3;
  LUMIGRID_CHECK_LE(std::max({triangles, geometry.points.size(), geometry.edges.size() / 2}), kMaxPrimitives);
  if (triangles == 0 && geometry.points.empty()) return {};
  base::ByteWriter out;
  writeTriangles(out, geometry, options);
  writePoints(out, geometry, options);
  return pmr::sealedChunk(out.takeBytes(), static_cast<std::uint32_t>(triangles),
                          static_cast<std::uint32_t>(geometry.points.size()));
}

bool isIntact(base::ByteView bytes, const Node& row, const BlockOptions& options) {
  return intactBytes(bytes, countsOf(row, options)).has_value();
}

base::Result<NodeGeometry> decodeBlock(base::ByteView bytes, const Node& row, const BlockOptions& options) {
  const auto coded = intactBytes(bytes, countsOf(row, options));
  if (!coded) return damaged("block: checksum does not match");
  auto geometry = BlockReader(*coded, row, options).read();
  if (!geometry) return damaged("block: its geometry cannot be");
  return std::move(*geometry);
}

}  // namespace lod::hlod
