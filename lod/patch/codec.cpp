#include "lod/patch/codec.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "base/check.h"
#include "base/crc32c.h"

namespace lod::patch {
namespace {

constexpr std::uint8_t kCodecVersion = 1;
constexpr std::uint8_t kWidePositions = 1;
constexpr std::uint8_t kHasColors = 2;
constexpr std::size_t kHeaderBytes = 32;
constexpr std::size_t kCrcOffset = 28;

struct PatchHeader {
  std::uint8_t flags = 0;
  std::uint32_t vertices = 0;
  std::uint32_t triangles = 0;
  glm::ivec3 minimum{0};
  std::uint32_t vertex_bytes = 0;
  std::uint32_t index_bytes = 0;
  std::uint32_t crc = 0;

  bool wide() const { return (flags & kWidePositions) != 0; }
  bool colored() const { return (flags & kHasColors) != 0; }
};

// Where each attribute lies in a stored vertex; the whole is a multiple of four bytes, as the vertex codec wants it.
struct VertexLayout {
  explicit VertexLayout(const PatchHeader& header)
      : normal(header.wide() ? 12 : 6),
        color(normal + 2),
        size(header.wide() ? (header.colored() ? 20 : 16) : (header.colored() ? 12 : 8)) {}
  std::size_t normal;
  std::size_t color;
  std::size_t size;
};

// Octahedral normals ------------------------------------------------------------------------------

struct OctahedralCode {
  std::int8_t u = 0;
  std::int8_t v = 0;
};

float signOf(float x) {
  return x >= 0.0F ? 1.0F : -1.0F;
}

std::int8_t toSnorm8(float x) {
  return static_cast<std::int8_t>(std::lround(std::clamp(x, -1.0F, 1.0F) * 127.0F));
}

OctahedralCode encodeNormal(const glm::vec3& n) {
  // Project onto the octahedron |x| + |y| + |z| = 1; a NaN anywhere makes the sum fail the test.
  const float sum = std::abs(n.x) + std::abs(n.y) + std::abs(n.z);
  if (!(sum > 0.0F) || !std::isfinite(sum)) return {};
  const float x = n.x / sum;
  const float y = n.y / sum;

  // Fold the lower half outwards.
  if (n.z >= 0.0F) return {toSnorm8(x), toSnorm8(y)};
  return {toSnorm8((1.0F - std::abs(y)) * signOf(x)), toSnorm8((1.0F - std::abs(x)) * signOf(y))};
}

glm::vec3 decodeNormal(OctahedralCode code) {
  // −128 means −127; integers until the fold is done, so that directions with two codes come out bit-equal.
  const int u = std::max<int>(code.u, -127);
  const int v = std::max<int>(code.v, -127);
  int x = u;
  int y = v;
  const int z = 127 - std::abs(u) - std::abs(v);
  if (z < 0) {
    x = (127 - std::abs(v)) * (u >= 0 ? 1 : -1);
    y = (127 - std::abs(u)) * (v >= 0 ? 1 : -1);
  }
  const float length = std::sqrt(static_cast<float>(x * x + y * y + z * z));
  return {static_cast<float>(x) / length, static_cast<float>(y) / length, static_cast<float>(z) / length};
}

// Encoding ----------------------------------------------------------------------------------------

// The versions are globals of the library: set once, before the first encoding in any thread.
void fixCodecVersions() {
  static const bool done = [] {
    meshopt_encodeIndexVersion(1);
    meshopt_encodeVertexVersion(0);
    return true;
  }();
  static_cast<void>(done);
}

void checkGeometry(const PatchGeometry& geometry) {
  LUMIGRID_CHECK_EQ(geometry.indices.size() % 3, 0U);
  LUMIGRID_CHECK(!geometry.indices.empty());
  LUMIGRID_CHECK_LE(geometry.indices.size() / 3, kMaxPatchTriangles);
  LUMIGRID_CHECK_LE(geometry.positions.size(), kMaxPatchVertices);
  LUMIGRID_CHECK_EQ(geometry.normals.size(), geometry.positions.size());
  if (!geometry.colors.empty()) LUMIGRID_CHECK_EQ(geometry.colors.size(), geometry.positions.size());
  for (const std::uint16_t index : geometry.indices) LUMIGRID_CHECK_LT(std::size_t{index}, geometry.positions.size());
  for (const glm::ivec3& q : geometry.positions)
    for (int axis = 0; axis < 3; ++axis) LUMIGRID_CHECK(q[axis] >= -kMaxLattice && q[axis] <= kMaxLattice);
}

// Triangles in cache order, and the old number of each vertex that is still used, in the order of first use.
struct Order {
  std::vector<unsigned int> indices;
  std::vector<unsigned int> vertices;
};

// Which source triangle each one of `ordered` is: both sorted, equal ones in the order they come.
std::vector<std::uint32_t> sourceTriangles(const PatchGeometry& geometry, const std::vector<unsigned int>& ordered) {
  using Keyed = std::array<std::uint32_t, 4>;
  const auto sorted = [](const auto& indices) {
    std::vector<Keyed> all;
    for (std::size_t t = 0; 3 * t < indices.size(); ++t)
      all.push_back({indices[3 * t], indices[3 * t + 1], indices[3 * t + 2], static_cast<std::uint32_t>(t)});
    std::sort(all.begin(), all.end());
    return all;
  };
  const std::vector<Keyed> from = sorted(geometry.indices);
  const std::vector<Keyed> to = sorted(ordered);
  std::vector<std::uint32_t> source(from.size());
  for (std::size_t i = 0; i < from.size(); ++i) source[to[i][3]] = from[i][3];
  return source;
}

Order optimizedOrder(const PatchGeometry& geometry, std::vector<std::uint32_t>* triangle_order) {
  const std::size_t vertex_count = geometry.positions.size();
  const std::vector<unsigned int> source(geometry.indices.begin(), geometry.indices.end());
  Order order;
  order.indices.resize(source.size());
  meshopt_optimizeVertexCache(order.indices.data(), source.data(), source.size(), vertex_count);
  if (triangle_order != nullptr) *triangle_order = sourceTriangles(geometry, order.indices);

  // Number the vertices by first use and remember where each came from, so that every attribute moves alike.
  std::vector<unsigned int> new_from_old(vertex_count);
  const std::size_t used =
      meshopt_optimizeVertexFetchRemap(new_from_old.data(), order.indices.data(), order.indices.size(), vertex_count);
  order.vertices.resize(used);
  for (unsigned int old = 0; old < vertex_count; ++old)
    if (new_from_old[old] < used) order.vertices[new_from_old[old]] = old;
  for (unsigned int& index : order.indices) index = new_from_old[index];
  return order;
}

PatchHeader headerFor(const PatchGeometry& geometry, const Order& order) {
  PatchHeader header;
  header.vertices = static_cast<std::uint32_t>(order.vertices.size());
  header.triangles = static_cast<std::uint32_t>(order.indices.size() / 3);
  glm::ivec3 low(kMaxLattice);
  glm::ivec3 high(-kMaxLattice);
  for (const unsigned int old : order.vertices) {
    low = glm::min(low, geometry.positions[old]);
    high = glm::max(high, geometry.positions[old]);
  }
  header.minimum = low;
  const glm::ivec3 extent = high - low;
  if (std::max({extent.x, extent.y, extent.z}) > 65535) header.flags |= kWidePositions;
  if (!geometry.colors.empty()) header.flags |= kHasColors;
  return header;
}

base::Bytes packVertices(const PatchGeometry& geometry, const Order& order, const PatchHeader& header) {
  const VertexLayout layout(header);
  base::Bytes packed(order.vertices.size() * layout.size, 0);
  std::uint8_t* out = packed.data();
  for (const unsigned int old : order.vertices) {
    const glm::uvec3 wide(geometry.positions[old] - header.minimum);
    const glm::u16vec3 narrow(wide);
    if (header.wide()) {
      std::memcpy(out, &wide, sizeof(wide));
    } else {
      std::memcpy(out, &narrow, sizeof(narrow));
    }
    const OctahedralCode code = encodeNormal(geometry.normals[old]);
    std::memcpy(out + layout.normal, &code, sizeof(code));
    if (header.colored()) std::memcpy(out + layout.color, &geometry.colors[old], 4);
    out += layout.size;
  }
  return packed;
}

base::Bytes encodeVertices(const base::Bytes& packed, std::size_t count, std::size_t size) {
  base::Bytes stream(meshopt_encodeVertexBufferBound(count, size));
  stream.resize(meshopt_encodeVertexBuffer(stream.data(), stream.size(), packed.data(), count, size));
  LUMIGRID_CHECK(!stream.empty());
  return stream;
}

base::Bytes encodeIndices(const std::vector<unsigned int>& indices, std::size_t vertex_count) {
  base::Bytes stream(meshopt_encodeIndexBufferBound(indices.size(), vertex_count));
  stream.resize(meshopt_encodeIndexBuffer(stream.data(), stream.size(), indices.data(), indices.size()));
  LUMIGRID_CHECK(!stream.empty());
  return stream;
}

void writeHeader(base::ByteWriter& out, const PatchHeader& header) {
  out.u8(kCodecVersion);
  out.u8(header.flags);
  out.u16(static_cast<std::uint16_t>(header.vertices));
  out.u16(static_cast<std::uint16_t>(header.triangles));
  out.u16(0);
  out.write(header.minimum);
  out.u32(header.vertex_bytes);
  out.u32(header.index_bytes);
  out.u32(header.crc);
}

// Everything but the checksum's own four bytes.
std::uint32_t checksum(base::ByteView bytes) {
  return base::crc32c(bytes.subspan(kHeaderBytes), base::crc32c(bytes.first(kCrcOffset)));
}

// Decoding ----------------------------------------------------------------------------------------

base::Error broken(const std::string& what) {
  return {base::ErrorCode::kInvalidInput, "patch bytes: " + what};
}

base::Result<PatchHeader> readHeader(base::ByteView bytes) {
  if (bytes.size() < kHeaderBytes)
    return broken("cut short: " + std::to_string(bytes.size()) + " bytes, the header alone has 32");
  base::ByteReader in(bytes);
  const std::uint8_t version = in.u8();
  if (version != kCodecVersion)
    return base::Error{base::ErrorCode::kVersion,
                       "patch bytes: codec version " + std::to_string(version) + ", this program reads 1"};

  PatchHeader header;
  header.flags = in.u8();
  header.vertices = in.u16();
  header.triangles = in.u16();
  const std::uint16_t reserved = in.u16();
  header.minimum = in.read<glm::ivec3>();
  header.vertex_bytes = in.u32();
  header.index_bytes = in.u32();
  header.crc = in.u32();

  if ((header.flags & ~(kWidePositions | kHasColors)) != 0 || reserved != 0) return broken("unknown flags");
  if (header.vertices == 0 || header.triangles == 0) return broken("no triangles");
  const std::uint64_t stated = std::uint64_t{kHeaderBytes} + header.vertex_bytes + header.index_bytes;
  if (stated != bytes.size())
    return broken(std::to_string(bytes.size()) + " bytes, but the header says " + std::to_string(stated));
  return header;
}

base::Result<void> unpackVertices(const PatchHeader& header, const base::Bytes& packed, PatchGeometry& geometry) {
  const VertexLayout layout(header);
  geometry.positions.resize(header.vertices);
  geometry.normals.resize(header.vertices);
  geometry.colors.resize(header.colored() ? header.vertices : 0);
  const glm::i64vec3 minimum(header.minimum);
  const std::uint8_t* in = packed.data();
  for (std::size_t i = 0; i < header.vertices; ++i, in += layout.size) {
    // Lattice point: offsets are unsigned, so only sums can leave the lattice.
    glm::uvec3 wide(0U);
    glm::u16vec3 narrow(0);
    if (header.wide()) {
      std::memcpy(&wide, in, sizeof(wide));
    } else {
      std::memcpy(&narrow, in, sizeof(narrow));
      wide = glm::uvec3(narrow);
    }
    const glm::i64vec3 q = minimum + glm::i64vec3(wide);
    if (std::min({q.x, q.y, q.z}) < -kMaxLattice || std::max({q.x, q.y, q.z}) > kMaxLattice)
      return broken("vertex " + std::to_string(i) + " lies outside the lattice");
    geometry.positions[i] = glm::ivec3(q);

    OctahedralCode code;
    std::memcpy(&code, in + layout.normal, sizeof(code));
    geometry.normals[i] = decodeNormal(code);
    if (header.colored()) std::memcpy(&geometry.colors[i], in + layout.color, 4);
  }
  return {};
}

}  // namespace

base::Bytes encodePatch(const PatchGeometry& geometry) {
  return encodePatch(geometry, nullptr);
}

base::Bytes encodePatch(const PatchGeometry& geometry, std::vector<std::uint32_t>* triangle_order) {
  checkGeometry(geometry);
  fixCodecVersions();
  const Order order = optimizedOrder(geometry, triangle_order);

  // Both streams, then the header that knows their lengths.
  PatchHeader header = headerFor(geometry, order);
  const base::Bytes packed = packVertices(geometry, order, header);
  const base::Bytes vertices = encodeVertices(packed, header.vertices, VertexLayout(header).size);
  const base::Bytes indices = encodeIndices(order.indices, header.vertices);
  header.vertex_bytes = static_cast<std::uint32_t>(vertices.size());
  header.index_bytes = static_cast<std::uint32_t>(indices.size());

  base::ByteWriter out;
  writeHeader(out, header);
  out.bytes(vertices);
  out.bytes(indices);
  out.patch(kCrcOffset, checksum(out.view()));
  return out.take();
}

base::Result<PatchGeometry> decodePatch(base::ByteView bytes) {
  const auto header = readHeader(bytes);
  if (!header) return header.error();
  if (checksum(bytes) != header->crc) return broken("checksum does not match");

  // Vertices. The decoder is safe on any bytes but may yield any values: those are checked behind it.
  PatchGeometry geometry;
  const base::ByteView vertices = bytes.subspan(kHeaderBytes, header->vertex_bytes);
  const std::size_t vertex_size = VertexLayout(*header).size;
  base::Bytes packed(header->vertices * vertex_size);
  if (meshopt_decodeVertexBuffer(packed.data(), header->vertices, vertex_size, vertices.data(), vertices.size()) != 0)
    return broken("the vertex stream does not decode");
  LUMIGRID_TRY(unpackVertices(*header, packed, geometry));

  // Triangles.
  const base::ByteView indices = bytes.subspan(kHeaderBytes + header->vertex_bytes);
  geometry.indices.resize(std::size_t{header->triangles} * 3);
  if (meshopt_decodeIndexBuffer(geometry.indices.data(), geometry.indices.size(), 2, indices.data(), indices.size()) !=
      0)
    return broken("the index stream does not decode");
  const std::uint16_t largest = *std::max_element(geometry.indices.begin(), geometry.indices.end());
  if (largest >= header->vertices)
    return broken("index " + std::to_string(largest) + " of " + std::to_string(header->vertices) + " vertices");
  return geometry;
}

base::Result<PatchCounts> encodedCounts(base::ByteView bytes) {
  const auto header = readHeader(bytes);
  if (!header) return header.error();
  return PatchCounts{header->vertices, header->triangles};
}

glm::vec3 quantizedNormal(const glm::vec3& n) {
  return decodeNormal(encodeNormal(n));
}

}  // namespace lod::patch
