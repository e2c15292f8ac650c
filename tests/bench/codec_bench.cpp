// codec_bench PATCH.LGP … measures the size and speed of the codec. Every patch of a built hierarchy (patch.lgp) is
// encoded and decoded by our codec and by libmeshoptimizer's vertex and index codecs in the same run on one thread:
// bytes per stored triangle by part, and millions of triangles a second of CPU time.
#include <meshoptimizer.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "lod/patch/codec.h"
#include "lod/patch/format.h"
#include "tests/bench/bench.h"

namespace {

using lod::patch::PatchGeometry;

constexpr int kRuns = 5;

// The least time of some runs.
template <class F>
double timed(F&& run) {
  double best = 1e30;
  for (int i = 0; i < kRuns; ++i) {
    const double start = bench::seconds(CLOCK_THREAD_CPUTIME_ID);
    run();
    best = std::min(best, bench::seconds(CLOCK_THREAD_CPUTIME_ID) - start);
  }
  return best;
}

// Bytes of a patch by part, from its layout (docs/formats/patch.md).
struct Parts {
  std::size_t header = 0, connectivity = 0, positions = 0, normals = 0, colors = 0;
};

std::size_t planeBytes(base::ByteView bytes, std::size_t at, std::size_t groups) {
  const std::size_t first = bytes[at] + std::size_t{bytes[at + 1]} * 256;
  const bool is_narrow = first >= 0x8000;
  const std::size_t widths = at + (is_narrow ? 3 : 2);
  const std::size_t bits = is_narrow ? 2 : 4;
  std::size_t size = widths - at + (bits * groups + 7) / 8 + first % 0x8000;
  for (std::size_t g = 0; g < groups; ++g) {
    const std::size_t stored = bytes[widths + bits * g / 8] >> (bits * g % 8) & ((1U << bits) - 1);
    const std::size_t width = stored + (is_narrow ? bytes[at + 2] : 0);
    size += width == 15 ? 64 : 2 * width;
  }
  return size;
}

// Bytes of the low bits that stand at the front of `bytes`.
std::size_t lowBytes(base::ByteView bytes, std::size_t vertices, int low_bits) {
  const std::size_t marks = (vertices + 7) / 8;
  int count = 0;
  for (const std::uint8_t mark : bytes.first(marks)) count += std::popcount(mark);
  return marks + (3 * static_cast<std::size_t>(low_bits * count) + 7) / 8;
}

void addParts(base::ByteView bytes, Parts& parts) {
  std::uint32_t steps = 0, escapes = 0;
  std::memcpy(&steps, bytes.data() + 20, 4);
  std::memcpy(&escapes, bytes.data() + 24, 4);
  const std::size_t vertices = lod::patch::encodedCounts(bytes)->vertices;
  const std::size_t groups = (vertices + 15) / 16;
  parts.header += 32;
  parts.connectivity += (std::size_t{steps} + 3) / 4 + escapes;
  std::size_t at = 32 + (std::size_t{steps} + 3) / 4 + escapes;
  const int low_bits = bytes[1] >> 4;
  const int first_color = (bytes[1] & 8) != 0 ? 3 : 5;
  for (int plane = 0; at < bytes.size(); ++plane) {
    std::size_t size = planeBytes(bytes, at, groups);
    if (plane == 2 && low_bits > 0) size += lowBytes(bytes.subspan(at + size), vertices, low_bits);
    (plane < 3 ? parts.positions : plane < first_color ? parts.normals : parts.colors) += size;
    at += size;
  }
}

// A vertex as meshoptimizer's vertex codec gets it.
struct PlainVertex {
  std::array<std::uint16_t, 3> position;
  std::array<std::int8_t, 2> normal;
  glm::u8vec4 color;
};
static_assert(sizeof(PlainVertex) == 12);

struct Peer {
  std::vector<PlainVertex> vertices;
  std::vector<unsigned> indices;
  std::size_t stride = 12;
  base::Bytes vertex_stream, index_stream;
};

std::vector<std::uint8_t> strided(const Peer& peer) {
  std::vector<std::uint8_t> bytes;
  for (const PlainVertex& v : peer.vertices) {
    const auto* at = reinterpret_cast<const std::uint8_t*>(&v);
    bytes.insert(bytes.end(), at, at + peer.stride);
  }
  return bytes;
}

Peer peerOf(const PatchGeometry& g) {
  Peer peer;
  peer.stride = g.colors.empty() ? 8 : 12;
  glm::ivec3 low = g.positions[0];
  for (const glm::ivec3& q : g.positions) low = glm::min(low, q);
  for (std::size_t v = 0; v < g.positions.size(); ++v) {
    const glm::u16vec3 q(g.positions[v] - low);
    const glm::vec3 n = g.normals[v] / (std::abs(g.normals[v].x) + std::abs(g.normals[v].y) + std::abs(g.normals[v].z));
    glm::vec2 code(n.x, n.y);
    if (n.z < 0.0F)
      code = {(1.0F - std::abs(n.y)) * (n.x < 0.0F ? -1.0F : 1.0F),
              (1.0F - std::abs(n.x)) * (n.y < 0.0F ? -1.0F : 1.0F)};
    peer.vertices.push_back({{q.x, q.y, q.z},
                             {static_cast<std::int8_t>(code.x * 127.0F), static_cast<std::int8_t>(code.y * 127.0F)},
                             g.colors.empty() ? glm::u8vec4(0) : g.colors[v]});
  }
  peer.indices.assign(g.indices.begin(), g.indices.end());
  return peer;
}

void encodePeer(Peer& peer) {
  const std::size_t count = peer.vertices.size();
  std::vector<unsigned> indices(peer.indices.size());
  meshopt_optimizeVertexCache(indices.data(), peer.indices.data(), indices.size(), count);
  const std::vector<std::uint8_t> bytes = strided(peer);
  std::vector<std::uint8_t> fetched(bytes.size());
  meshopt_optimizeVertexFetch(fetched.data(), indices.data(), indices.size(), bytes.data(), count, peer.stride);
  peer.vertex_stream.resize(meshopt_encodeVertexBufferBound(count, peer.stride));
  peer.vertex_stream.resize(meshopt_encodeVertexBuffer(peer.vertex_stream.data(), peer.vertex_stream.size(),
                                                       fetched.data(), count, peer.stride));
  peer.index_stream.resize(meshopt_encodeIndexBufferBound(indices.size(), count));
  peer.index_stream.resize(
      meshopt_encodeIndexBuffer(peer.index_stream.data(), peer.index_stream.size(), indices.data(), indices.size()));
}

int compareCodecs(const char* path) {
  const auto file = lod::patch::PatchFile::open(path);
  if (!file) return std::fprintf(stderr, "%s\n", file.error().message.c_str()), 1;
  std::vector<PatchGeometry> patches;
  std::size_t triangles = 0;
  std::size_t vertices = 0;
  for (std::uint32_t p = 0; p < file->hierarchy().patches.size(); ++p) {
    patches.push_back(*file->geometry(p));
    triangles += patches.back().indices.size() / 3;
    vertices += patches.back().positions.size();
  }
  const auto count = static_cast<double>(triangles);

  std::vector<base::Bytes> encoded(patches.size());
  const double encode = timed([&] {
    for (std::size_t p = 0; p < patches.size(); ++p) encoded[p] = lod::patch::encodePatch(patches[p]);
  });
  std::size_t decoded_triangles = 0;
  const double decode = timed([&] {
    for (const base::Bytes& bytes : encoded) decoded_triangles += lod::patch::decodePatch(bytes)->indices.size() / 3;
  });
  if (decoded_triangles != kRuns * triangles) return std::fprintf(stderr, "decoding failed\n"), 1;
  Parts parts;
  std::size_t bytes = 0;
  for (const base::Bytes& patch : encoded) addParts(patch, parts), bytes += patch.size();

  std::vector<Peer> peers;
  for (const PatchGeometry& patch : patches) peers.push_back(peerOf(patch));
  const double peer_encode = timed([&] {
    for (Peer& peer : peers) encodePeer(peer);
  });
  int faults = 0;
  std::size_t peer_bytes = 0;
  // This decodes the streams alone, without checksum, and makes no normals or positions of them.
  const double peer_decode = timed([&] {
    for (const Peer& peer : peers) {
      std::vector<std::uint8_t> out(peer.vertices.size() * peer.stride);
      std::vector<std::uint16_t> indices(peer.indices.size());
      faults += meshopt_decodeVertexBuffer(out.data(), peer.vertices.size(), peer.stride, peer.vertex_stream.data(),
                                           peer.vertex_stream.size());
      faults +=
          meshopt_decodeIndexBuffer(indices.data(), indices.size(), peer.index_stream.data(), peer.index_stream.size());
    }
  });
  if (faults != 0) return std::fprintf(stderr, "the peer's decoding failed\n"), 1;
  for (const Peer& peer : peers) peer_bytes += peer.vertex_stream.size() + peer.index_stream.size();

  const auto per = [&](std::size_t b) { return static_cast<double>(b) / count; };
  std::printf("%s: %zu patches, %zu triangles stored, %.3f vertices per triangle\n", path, patches.size(), triangles,
              static_cast<double>(vertices) / count);
  std::printf("              B/triangle  encode ns/triangle  decode Mtriangles/s\n");
  std::printf("this codec    %10.3f  %18.1f  %19.1f\n", per(bytes), encode / count * 1e9, count / decode * 1e-6);
  std::printf("meshoptimizer %10.3f  %18.1f  %19.1f   (streams only)\n", per(peer_bytes), peer_encode / count * 1e9,
              count / peer_decode * 1e-6);
  std::printf("parts: header %.3f, connectivity %.3f, positions %.3f, normals %.3f, colours %.3f\n", per(parts.header),
              per(parts.connectivity), per(parts.positions), per(parts.normals), per(parts.colors));
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) return std::fprintf(stderr, "codec_bench PATCH.LGP …\n"), 2;
  int status = 0;
  for (int i = 1; i < argc; ++i) status |= compareCodecs(argv[i]);
  return status;
}
