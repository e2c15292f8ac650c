#include "lod/patch/codec.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <tuple>

#include "base/crc32c.h"
#include "tests/lod/patch/patch_testing.h"
#include "tests/support/quantized_normal.h"

namespace lod::patch {
namespace {

using patch_testing::drawPatch;
using patch_testing::Shape;
using patch_testing::shapes;
using patch_testing::surfaceOf;

bool sameBits(const glm::vec3& a, const glm::vec3& b) {
  return std::memcmp(&a, &b, sizeof(a)) == 0;
}

// Returns the bytes with a right checksum.
base::Bytes sealed(base::Bytes bytes) {
  const base::ByteView view(bytes);
  const std::uint32_t crc = base::crc32c(view.subspan(32), base::crc32c(view.first(28)));
  std::memcpy(bytes.data() + 28, &crc, sizeof(crc));
  return bytes;
}

template <class T>
base::Bytes withField(base::Bytes bytes, std::size_t offset, T value) {
  std::memcpy(bytes.data() + offset, &value, sizeof(value));
  return sealed(std::move(bytes));
}

base::Bytes smallPatch() {
  std::mt19937 random(11);
  return encodePatch(drawPatch({40, 70, 3000, true}, random));
}

// Returns a flat grid of side × side vertices.
PatchGeometry gridPatch(int side) {
  PatchGeometry g;
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x) g.positions.emplace_back(x, y, 0);
  g.normals.assign(g.positions.size(), glm::vec3(0.0F, 0.0F, 1.0F));
  for (int y = 0; y + 1 < side; ++y)
    for (int x = 0; x + 1 < side; ++x)
      for (const int corner : {0, 1, side + 1, 0, side + 1, side})
        g.indices.push_back(static_cast<std::uint16_t>(y * side + x + corner));
  return g;
}

std::string faultOf(base::ByteView bytes) {
  const auto decoded = decodePatch(bytes);
  return decoded ? "" : decoded.error().message;
}

// Returns the offset of the first plane of residuals.
std::size_t firstPlane(base::ByteView bytes) {
  std::uint32_t steps = 0, escapes = 0;
  std::memcpy(&steps, &bytes[20], sizeof(steps));
  std::memcpy(&escapes, &bytes[24], sizeof(escapes));
  return 32 + (std::size_t{steps} + 3) / 4 + escapes;
}

TEST(PatchCodec, anySurfaceComesBack) {
  std::mt19937 random(1);
  for (const Shape& shape : shapes()) {
    const PatchGeometry source = drawPatch(shape, random);
    const auto decoded = decodePatch(encodePatch(source));
    ASSERT_TRUE(decoded) << decoded.error().message;
    EXPECT_TRUE(surfaceOf(*decoded) == surfaceOf(source)) << shape.vertices << " vertices over " << shape.extent;
    EXPECT_EQ(decoded->colors.size(), shape.colors ? decoded->positions.size() : 0);
  }
}

// All decoders give the same surface bit for bit, and refuse the same broken bytes.
TEST(PatchCodec, everyMachineDecodesTheSame) {
  std::mt19937 random(5);
  std::size_t refused = 0, read = 0;
  const auto compare = [&](base::ByteView bytes) {
    const auto one = decodePatch(bytes);
    ++(one ? read : refused);
    for (const auto decode : {decodePatchPortably, decodePatchByAvx2}) {
      const auto other = decode(bytes);
      ASSERT_EQ(static_cast<bool>(one), static_cast<bool>(other));
      if (!one) {
        EXPECT_EQ(one.error().message, other.error().message);
        continue;
      }
      EXPECT_EQ(one->indices, other->indices);
      EXPECT_EQ(one->positions, other->positions);
      EXPECT_EQ(one->colors, other->colors);
      ASSERT_EQ(one->normals.size(), other->normals.size());
      for (std::size_t v = 0; v < one->normals.size(); ++v) EXPECT_TRUE(sameBits(one->normals[v], other->normals[v]));
    }
  };
  for (const Shape& shape : shapes()) {
    const PatchGeometry patch = drawPatch(shape, random);
    const base::Bytes bytes = encodePatch(patch);
    compare(bytes);
    compare(encodePatch(patch, nullptr, StoredNormals::kOfFacets));
    for (int i = 0; i < 200; ++i) {
      base::Bytes hurt = bytes;
      const std::size_t at = 32 + random() % (hurt.size() - 32);
      hurt[at] = static_cast<std::uint8_t>(hurt[at] ^ 1U << random() % 8);
      compare(sealed(std::move(hurt)));
    }
    // With fewer front bits the front outgrows its ring.
    for (std::uint8_t bits = 0; bits < bytes[7]; ++bits) compare(withField(bytes, 7, bits));
  }
  compare(encodePatch(gridPatch(60)));
  const base::Bytes torn = encodePatch(patch_testing::tornGrid());
  for (std::size_t at = 32; at < firstPlane(torn); ++at)
    for (int bit = 0; bit < 8; ++bit) {
      base::Bytes hurt = torn;
      hurt[at] = static_cast<std::uint8_t>(hurt[at] ^ 1U << bit);
      compare(sealed(std::move(hurt)));
    }
  EXPECT_GT(refused, 100U);
  EXPECT_GT(read, 100U);
}

// Unary bits have to fill their bytes, and a group has at most 56 of them.
TEST(PatchCodec, strayUnaryBytesAreRefused) {
  const base::Bytes bytes = smallPatch();
  std::uint16_t vertices = 0, unary_bytes = 0;
  std::uint32_t steps = 0, escapes = 0;
  std::memcpy(&vertices, &bytes[2], sizeof(vertices));
  std::memcpy(&steps, &bytes[20], sizeof(steps));
  std::memcpy(&escapes, &bytes[24], sizeof(escapes));
  const std::size_t plane = 32 + (std::size_t{steps} + 3) / 4 + escapes;
  std::memcpy(&unary_bytes, &bytes[plane], sizeof(unary_bytes));
  const std::size_t groups = (std::size_t{vertices} + 15) / 16;
  std::size_t unary = plane + 2 + (groups + 1) / 2;
  for (std::size_t g = 0, low = 0; g < groups; ++g, unary += low) {
    low = 2 * std::size_t{static_cast<std::uint8_t>(bytes[plane + 2 + g / 2] >> (4 * (g % 2)) & 15U)};
    ASSERT_LT(low, 30U);
  }

  const auto faults = [&](std::size_t at, std::size_t count, std::uint8_t value) {
    base::Bytes longer = bytes;
    longer.insert(longer.begin() + static_cast<std::ptrdiff_t>(at), count, value);
    longer = withField(std::move(longer), plane, static_cast<std::uint16_t>(unary_bytes + count));
    const auto one = decodePatch(longer);
    const auto other = decodePatchPortably(longer);
    const auto third = decodePatchByAvx2(longer);
    return (one ? "" : one.error().message) + "; " + (other ? "" : other.error().message) + "; " +
           (third ? "" : third.error().message);
  };
  const std::string fault = "patch bytes: the vertices do not decode";
  const std::string refused = fault + "; " + fault + "; " + fault;
  EXPECT_EQ(faults(unary + unary_bytes, 0, 0), "; ; ");
  for (const std::uint8_t value : {0, 1, 255}) EXPECT_EQ(faults(unary + unary_bytes, 1, value), refused);
  // 32 bytes are 256 bits, which a place of eight bits does not show.
  for (const std::size_t count : {6, 8, 31, 32, 33, 64, 8192}) EXPECT_EQ(faults(unary, count, 0), refused) << count;
}

TEST(PatchCodec, widthsNearEachOtherTakeTwoBitsAndTheLeastIsChecked) {
  std::mt19937 random(3);
  const PatchGeometry source = drawPatch({2000, 3000, 200, false}, random);
  const base::Bytes bytes = encodePatch(source);
  const std::size_t plane = firstPlane(bytes);
  ASSERT_NE(bytes[plane + 1] & 0x80, 0);
  for (const std::uint8_t least : {12, 13, 15, 255})
    EXPECT_NE(faultOf(withField(bytes, plane + 2, least)).find("vertices do not decode"), std::string::npos);
  // Every other byte there decodes alike everywhere.
  for (std::size_t at = plane; at < plane + 40; ++at)
    for (int bit = 0; bit < 8; ++bit) {
      const base::Bytes hurt = withField(bytes, at, static_cast<std::uint8_t>(bytes[at] ^ 1U << bit));
      const auto other = decodePatchPortably(hurt);
      EXPECT_EQ(faultOf(hurt), other ? "" : other.error().message);
    }
}

// On a noisy surface half a parallelogram predicts better than a whole one; on a grid a whole one is exact.
TEST(PatchCodec, roughSurfacesSaySo) {
  std::mt19937 random(4);
  PatchGeometry grid = gridPatch(40);
  EXPECT_EQ(encodePatch(grid)[1], 0);
  for (glm::ivec3& q : grid.positions) q = q * 10 + glm::ivec3(random() % 200, random() % 200, random() % 200);
  const base::Bytes rough = encodePatch(grid);
  EXPECT_EQ(rough[1], 4);
  const auto decoded = decodePatch(rough);
  ASSERT_TRUE(decoded);
  EXPECT_TRUE(surfaceOf(*decoded) == surfaceOf(grid));
}

TEST(PatchCodec, aFlatGridCostsLittle) {
  // A grid has one new vertex for two triangles, and all its numbers are predicted.
  const PatchGeometry grid = gridPatch(50);
  const base::Bytes bytes = encodePatch(grid);
  const auto decoded = decodePatch(bytes);
  ASSERT_TRUE(decoded);
  EXPECT_TRUE(surfaceOf(*decoded) == surfaceOf(grid));
  EXPECT_LT(bytes.size(), grid.indices.size() / 3);
}

// Returns a rough surface whose positions are multiples of 16, but for every `other`-th vertex.
PatchGeometry coarsePatch(int side, std::size_t other) {
  std::mt19937 random(6);
  PatchGeometry g = gridPatch(side);
  for (std::size_t v = 0; v < g.positions.size(); ++v) {
    g.positions[v] = 16 * (8 * g.positions[v] + glm::ivec3(random() % 3, random() % 3, random() % 9));
    if (v % other == 1) g.positions[v] += glm::ivec3(random() % 16, random() % 16, 1);
  }
  return g;
}

// The number of bits that a patch stores apart stands in the upper half of its flags.
TEST(PatchCodec, coarsePositionsTakeFewerBitsAndOthersComeBackToo) {
  std::size_t plain = 0;
  for (const std::size_t other : {2U, 3U, 7U, 100'000U}) {
    const PatchGeometry source = coarsePatch(40, other);
    const base::Bytes bytes = encodePatch(source, nullptr, StoredNormals::kOfFacets);
    EXPECT_EQ(bytes[1] >> 4, 4) << other;
    EXPECT_EQ(bytes[0], 2);
    for (const auto decode : {decodePatch, decodePatchPortably, decodePatchByAvx2}) {
      const auto decoded = decode(bytes);
      ASSERT_TRUE(decoded) << decoded.error().message;
      auto positions = decoded->positions, given = source.positions;
      const auto less = [](const glm::ivec3& a, const glm::ivec3& b) {
        return std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z);
      };
      std::sort(positions.begin(), positions.end(), less);
      std::sort(given.begin(), given.end(), less);
      EXPECT_EQ(positions, given);
    }
    plain = bytes.size();
  }
  // Steps of a sixteenth have four bits more a coordinate, less the one that says that a vertex has none.
  PatchGeometry fine = coarsePatch(40, 100'000);
  for (glm::ivec3& q : fine.positions) q.x += 1;
  fine.positions[0].x -= 1;
  const std::size_t with_all = encodePatch(fine, nullptr, StoredNormals::kOfFacets).size();
  EXPECT_LT(plain + (3 * 4 - 2) * 1600 / 8, with_all);
}

TEST(PatchCodec, lowBitsWhereNoneMayBeAreRefused) {
  const base::Bytes bytes = encodePatch(coarsePatch(9, 3), nullptr, StoredNormals::kOfFacets);
  ASSERT_EQ(bytes[1] >> 4, 4);
  // 81 vertices have eleven bytes of marks, and every third of them 12 bits behind those, at the end of the patch.
  const std::size_t marks = bytes.size() - (27 * 12 + 7) / 8 - 11;
  const auto hurt = [&](std::size_t at, std::uint8_t bit) {
    return faultOf(withField(bytes, at, static_cast<std::uint8_t>(bytes[at] ^ bit)));
  };
  const std::string fault = "patch bytes: the vertices do not decode";
  EXPECT_EQ(hurt(marks, 1), fault) << "the first vertex has none";
  EXPECT_EQ(hurt(marks + 10, 2), fault) << "a mark behind the last vertex";
  EXPECT_EQ(hurt(bytes.size() - 1, 0x10), fault) << "bits behind the last";
  EXPECT_EQ(hurt(bytes.size() - 1, 0x01), "") << "another position";
  base::Bytes cut = bytes;
  cut.pop_back();
  EXPECT_EQ(faultOf(sealed(cut)), fault);
  // Marks of vertices that have bits are as many as there are bits for.
  std::size_t unmarked = 1;
  while ((bytes[marks + unmarked / 8] >> unmarked % 8 & 1) != 0) ++unmarked;
  EXPECT_EQ(hurt(marks + unmarked / 8, static_cast<std::uint8_t>(1U << unmarked % 8)), fault);
  EXPECT_EQ(faultOf(withField<std::uint8_t>(bytes, 0, 1)), "patch bytes: unknown flags");
}

// Vertex y has three triangles, and the front has the edges b y and y v. The gate a b meets the third, a b v, first. If
// b y v is written before it, as a fold, the front is not split.
TEST(PatchCodec, trianglesBeforeTheThirdCornerAreWrittenAsFolds) {
  PatchGeometry grid = gridPatch(30);
  // Every tenth triangle gets a vertex in its middle.
  std::vector<std::uint16_t> indices;
  for (std::size_t t = 0; t < grid.indices.size(); t += 3) {
    const std::uint16_t a = grid.indices[t], b = grid.indices[t + 1], c = grid.indices[t + 2];
    if (t % 30 != 0) {
      indices.insert(indices.end(), {a, b, c});
      continue;
    }
    const auto middle = static_cast<std::uint16_t>(grid.positions.size());
    grid.positions.push_back((grid.positions[a] + grid.positions[b] + grid.positions[c]) / 3);
    grid.normals.push_back(grid.normals[a]);
    indices.insert(indices.end(), {a, b, middle, b, c, middle, c, a, middle});
  }
  grid.indices = indices;
  const base::Bytes bytes = encodePatch(grid);
  EXPECT_TRUE(surfaceOf(*decodePatch(bytes)) == surfaceOf(grid));
  std::uint32_t steps = 0;
  std::memcpy(&steps, &bytes[20], sizeof(steps));
  std::size_t folds = 0;
  for (std::size_t at = 32 + (std::size_t{steps} + 3) / 4; at < firstPlane(bytes); ++at) folds += bytes[at] == 250;
  EXPECT_GT(folds, 10U);
}

TEST(PatchCodec, anyAlphaComesBack) {
  PatchGeometry grid = gridPatch(9);
  for (std::size_t v = 0; v < grid.positions.size(); ++v)
    grid.colors.push_back(glm::u8vec4(10, 20, 30, static_cast<std::uint8_t>(3 * v)));
  const auto decoded = decodePatch(encodePatch(grid));
  ASSERT_TRUE(decoded);
  EXPECT_TRUE(surfaceOf(*decoded) == surfaceOf(grid));
  // Opaque costs nothing.
  for (glm::u8vec4& c : grid.colors) c.a = 255;
  const std::size_t opaque = encodePatch(grid).size();
  grid.colors[40].a = 254;
  EXPECT_GT(encodePatch(grid).size(), opaque);
}

TEST(PatchCodec, nonManifoldTrianglesComeBack) {
  // The surface gets edges of three triangles, a triangle twice and turned over, triangles without area, a fan around
  // one vertex, and islands.
  PatchGeometry odd = gridPatch(6);
  const std::vector<std::uint16_t> more{0, 1, 8, 0, 1, 9, 1, 0, 9, 0,  1,  9, 3, 3, 4,  5, 5,
                                        5, 7, 8, 7, 0, 8, 9, 9, 8, 30, 30, 8, 9, 2, 20, 35};
  odd.indices.insert(odd.indices.end(), more.begin(), more.end());
  for (std::uint16_t v = 1; v + 1 < 36; ++v)
    odd.indices.insert(odd.indices.end(), {0, v, static_cast<std::uint16_t>(v + 1)});
  const auto decoded = decodePatch(encodePatch(odd));
  ASSERT_TRUE(decoded);
  EXPECT_TRUE(surfaceOf(*decoded) == surfaceOf(odd));
}

TEST(PatchCodec, facetsBeyondWhatFloatsHoldComeBack) {
  // With long edges and many triangles at one vertex the sums of facet normals need a shift.
  for (const int step : {3, 3000, 3'000'000, 20'000'000}) {
    PatchGeometry grid = gridPatch(40);
    for (glm::ivec3& q : grid.positions) q = (q - 20) * step;
    for (std::uint16_t v = 1; v + 1 < 1600; ++v)
      grid.indices.insert(grid.indices.end(), {0, v, static_cast<std::uint16_t>(v + 1)});
    const base::Bytes bytes = encodePatch(grid);
    EXPECT_EQ(bytes[6] > 0, step > 3);
    const auto decoded = decodePatch(bytes);
    ASSERT_TRUE(decoded);
    EXPECT_TRUE(surfaceOf(*decoded) == surfaceOf(grid)) << step;
  }
}

TEST(PatchCodec, decodedNormalsAreTheQuantizedOnesBitForBit) {
  std::mt19937 random(2);
  PatchGeometry source = drawPatch({2000, 1, 0}, random);
  // One triangle per vertex keeps all of them; the vertex's number is its place.
  source.indices.clear();
  for (int v = 0; v < 2000; ++v) {
    source.positions[static_cast<std::size_t>(v)] = glm::ivec3(v);
    source.indices.insert(source.indices.end(), 3, static_cast<std::uint16_t>(v));
  }
  const auto decoded = decodePatch(encodePatch(source));
  ASSERT_TRUE(decoded);
  ASSERT_EQ(decoded->positions.size(), 2000U);
  for (std::size_t v = 0; v < 2000; ++v) {
    const auto place = static_cast<std::size_t>(decoded->positions[v].x);
    EXPECT_TRUE(sameBits(decoded->normals[v], support::quantizedNormal(source.normals[place])));
  }
}

TEST(PatchCodec, quantizingANormalTwiceChangesNothing) {
  // Directions all over the sphere reach every code.
  int tried = 0;
  for (int u = -127; u <= 127; ++u) {
    for (int v = -127; v <= 127; ++v, ++tried) {
      const float z = 127.0F - static_cast<float>(std::abs(u) + std::abs(v));
      glm::vec3 n(u, v, z);
      if (z < 0.0F) n = glm::vec3((127 - std::abs(v)) * (u >= 0 ? 1 : -1), (127 - std::abs(u)) * (v >= 0 ? 1 : -1), z);
      const glm::vec3 once = support::quantizedNormal(n);
      ASSERT_TRUE(sameBits(once, support::quantizedNormal(once))) << u << " " << v;
      ASSERT_NEAR(glm::dot(once, glm::normalize(n)), 1.0F, 1e-6F) << u << " " << v;
    }
  }
  EXPECT_EQ(tried, 255 * 255);
}

TEST(PatchCodec, quantizedNormalIsWithinOneDegree) {
  std::mt19937 random(3);
  std::normal_distribution<float> direction;
  float worst = 1.0F;
  for (int i = 0; i < 100'000; ++i) {
    const glm::vec3 n = glm::normalize(glm::vec3(direction(random), direction(random), direction(random)));
    worst = std::min(worst, glm::dot(n, support::quantizedNormal(n)));
  }
  EXPECT_GT(worst, std::cos(glm::radians(1.0F)));
  EXPECT_LT(worst, std::cos(glm::radians(0.3F))) << "8 + 8 bits can't be as good as this: is anything quantized?";
}

TEST(PatchCodec, manyNormalsAreQuantizedAsEachAlone) {
  std::vector<glm::vec3> normals{{0.0F, 0.0F, 0.0F}, {NAN, 1.0F, 0.0F}, {0.0F, -INFINITY, 0.0F}, {0.0F, 0.0F, -1.0F}};
  for (int i = 0; i < 333; ++i) normals.emplace_back(std::sin(i), std::cos(2 * i), std::sin(3 * i + 1));
  std::vector<glm::vec3> quantized = normals;
  quantizeNormals(quantized);
  for (std::size_t v = 0; v < normals.size(); ++v)
    EXPECT_TRUE(sameBits(quantized[v], support::quantizedNormal(normals[v]))) << v;
}

TEST(PatchCodec, aZeroOrInfiniteNormalBecomesUp) {
  const glm::vec3 up(0.0F, 0.0F, 1.0F);
  EXPECT_EQ(support::quantizedNormal(glm::vec3(0.0F)), up);
  EXPECT_EQ(support::quantizedNormal(glm::vec3(NAN, 1.0F, 0.0F)), up);
  EXPECT_EQ(support::quantizedNormal(glm::vec3(INFINITY, 1.0F, 0.0F)), up);
}

// On a bowl of 40 x 40 facets those of the facets are near those of the surface; what was given does not matter.
TEST(PatchCodec, normalsOfFacetsTakeNextToNoBytes) {
  PatchGeometry bowl = gridPatch(41);
  std::vector<glm::vec3> true_normals;
  for (glm::ivec3& p : bowl.positions) {
    const glm::ivec2 from_middle(p.x - 20, p.y - 20);
    p = {100 * p.x, 100 * p.y, from_middle.x * from_middle.x + from_middle.y * from_middle.y};
    true_normals.push_back(glm::normalize(glm::vec3(-0.02F * glm::vec2(from_middle), 1.0F)));
  }
  bowl.normals.assign(bowl.positions.size(), glm::vec3(1.0F, 0.0F, 0.0F));
  const base::Bytes with_facets = encodePatch(bowl, nullptr, StoredNormals::kOfFacets);
  const auto decoded = decodePatch(with_facets);
  ASSERT_TRUE(decoded) << decoded.error().message;
  ASSERT_EQ(decoded->positions.size(), bowl.positions.size());
  for (std::size_t v = 0; v < decoded->positions.size(); ++v) {
    const auto number = static_cast<std::size_t>(decoded->positions[v].x / 100 + 41 * (decoded->positions[v].y / 100));
    EXPECT_GT(glm::dot(decoded->normals[v], true_normals[number]), std::cos(glm::radians(3.0F))) << number;
  }
  std::mt19937 random(7);
  std::normal_distribution<float> direction;
  for (glm::vec3& n : bowl.normals) n = glm::normalize(glm::vec3(direction(random), direction(random), 1.0F));
  EXPECT_EQ(encodePatch(bowl, nullptr, StoredNormals::kOfFacets), with_facets);
  EXPECT_GT(encodePatch(bowl).size(), with_facets.size() + bowl.normals.size()) << "at least a byte each";
}

TEST(PatchCodec, quantizedColorIsNearAndQuantizingTwiceChangesNothing) {
  double squares = 0.0;
  for (int c = 0; c < 256; ++c) {
    const auto channel = static_cast<std::uint8_t>(c);
    const glm::u8vec4 once = quantizedColor({channel, channel, channel, channel});
    EXPECT_EQ(once, quantizedColor(once));
    EXPECT_EQ(once, glm::u8vec4(once.r, once.r, once.r, channel));
    EXPECT_LE(std::abs(int{once.r} - c), 4);
    squares += (int{once.r} - c) * (int{once.r} - c);
  }
  EXPECT_LT(std::sqrt(squares / 256), 2.0);
  EXPECT_EQ(quantizedColor({0, 255, 0, 1}), glm::u8vec4(0, 255, 0, 1));
}

TEST(PatchCodec, decodedColorsAreTheQuantizedOnes) {
  // The colours are a grid of 16 levels a channel.
  PatchGeometry source;
  for (int c = 0; c < 4096; ++c) {
    source.positions.emplace_back(c, 0, 0);
    source.normals.emplace_back(0.0F, 0.0F, 1.0F);
    source.colors.push_back(glm::u8vec4((c & 15) * 17, (c >> 4 & 15) * 17, (c >> 8) * 17, 255));
    source.indices.insert(source.indices.end(), 3, static_cast<std::uint16_t>(c));
  }
  const auto decoded = decodePatch(encodePatch(source));
  ASSERT_TRUE(decoded);
  ASSERT_EQ(decoded->colors.size(), 4096U);
  for (std::size_t v = 0; v < 4096; ++v)
    ASSERT_EQ(decoded->colors[v], quantizedColor(source.colors[static_cast<std::size_t>(decoded->positions[v].x)]));
}

TEST(PatchCodec, encodingTwiceGivesTheSameBytes) {
  EXPECT_EQ(smallPatch(), smallPatch());
}

TEST(PatchCodec, triangleOrderNamesEachTrianglesSource) {
  std::mt19937 random(7);
  for (const Shape& shape : shapes()) {
    const PatchGeometry source = drawPatch(shape, random);
    std::vector<std::uint32_t> order;
    const auto decoded = decodePatch(encodePatch(source, &order));
    ASSERT_TRUE(decoded);
    ASSERT_EQ(order.size() * 3, decoded->indices.size());
    std::vector<bool> seen(order.size(), false);
    for (std::size_t t = 0; t < order.size(); ++t) {
      ASSERT_LT(order[t], order.size());
      ASSERT_FALSE(seen[order[t]]);
      seen[order[t]] = true;
      PatchGeometry one = source;
      PatchGeometry other = *decoded;
      one.indices.assign(source.indices.begin() + 3 * order[t], source.indices.begin() + 3 * order[t] + 3);
      other.indices.assign(decoded->indices.begin() + static_cast<std::ptrdiff_t>(3 * t),
                           decoded->indices.begin() + static_cast<std::ptrdiff_t>(3 * t + 3));
      ASSERT_TRUE(surfaceOf(one) == surfaceOf(other)) << t;
      if (t == 300) break;
    }
  }
}

TEST(PatchCodec, unusedVerticesAreLeftOut) {
  std::mt19937 random(4);
  PatchGeometry source = drawPatch({30, 10, 100}, random);
  for (std::uint16_t& index : source.indices) index = static_cast<std::uint16_t>(index % 7);
  const auto decoded = decodePatch(encodePatch(source));
  ASSERT_TRUE(decoded);
  EXPECT_LE(decoded->positions.size(), 7U);
  EXPECT_TRUE(surfaceOf(*decoded) == surfaceOf(source));
}

TEST(PatchCodec, countsAreReadWithoutDecoding) {
  const base::Bytes bytes = smallPatch();
  const auto decoded = decodePatch(bytes);
  const auto counts = encodedCounts(bytes);
  ASSERT_TRUE(decoded && counts);
  EXPECT_EQ(counts->vertices, decoded->positions.size());
  EXPECT_EQ(counts->triangles, 70U);
}

TEST(PatchCodec, everyCutIsRefused) {
  const base::Bytes bytes = smallPatch();
  for (std::size_t length = 0; length < bytes.size(); ++length)
    EXPECT_FALSE(decodePatch(base::ByteView(bytes).first(length))) << length;
  base::Bytes longer = bytes;
  longer.push_back(0);
  EXPECT_FALSE(decodePatch(longer));
}

TEST(PatchCodec, everyFlippedBitIsNoticed) {
  base::Bytes bytes = smallPatch();
  for (std::size_t bit = 0; bit < bytes.size() * 8; ++bit) {
    bytes[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
    EXPECT_FALSE(decodePatch(bytes)) << bit;
    bytes[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
  }
  EXPECT_TRUE(decodePatch(bytes));
}

TEST(PatchCodec, cutStreamsUnderARightChecksumAreRefused) {
  const base::Bytes bytes = smallPatch();
  for (std::size_t length = 32; length < bytes.size(); ++length)
    EXPECT_FALSE(decodePatch(sealed(base::Bytes(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(length)))))
        << length;
  base::Bytes longer = bytes;
  longer.push_back(0);
  EXPECT_NE(faultOf(sealed(longer)).find("vertices do not decode"), std::string::npos);
}

TEST(PatchCodec, wrongFieldsUnderARightChecksumAreNamed) {
  const base::Bytes bytes = smallPatch();
  const auto names = [&](const base::Bytes& changed, const std::string& what) {
    const std::string fault = faultOf(changed);
    EXPECT_NE(fault.find(what), std::string::npos) << fault << ", not " << what;
  };
  names(withField<std::uint8_t>(bytes, 0, 0), "version 0");
  names(withField<std::uint8_t>(bytes, 0, 3), "version 3");
  names(withField<std::uint8_t>(bytes, 0, 2), "unknown flags");
  names(withField<std::uint8_t>(bytes, 1, 16), "unknown flags");
  names(withField<std::uint8_t>(bytes, 1, 6), "unknown flags");
  names(withField<std::uint8_t>(bytes, 1, 2), "unknown flags");
  names(withField<std::uint8_t>(bytes, 1, 0), "vertices do not decode");
  names(withField<std::uint16_t>(bytes, 2, 0), "no triangles");
  names(withField<std::uint16_t>(bytes, 2, 3), "triangles do not decode");
  names(withField<std::uint16_t>(bytes, 4, 0), "no triangles");
  names(withField<std::uint16_t>(bytes, 4, 69), "triangles do not decode");
  names(withField<std::uint8_t>(bytes, 6, 32), "unknown parameters");
  names(withField<std::uint8_t>(bytes, 7, 18), "unknown parameters");
  names(withField<std::int32_t>(bytes, 8, kMaxLattice), "outside the lattice");
  names(withField<std::int32_t>(bytes, 12, std::numeric_limits<std::int32_t>::min()), "outside the lattice");
  names(withField<std::uint32_t>(bytes, 20, 0xFFFFFFFF), "header says");
  names(withField<std::uint32_t>(bytes, 24, 0xFFFFFFFF), "header says");
}

TEST(PatchCodec, escapesThatNameNoVertexAreRefused) {
  const base::Bytes bytes = smallPatch();
  std::uint32_t steps = 0;
  std::memcpy(&steps, bytes.data() + 20, 4);
  const std::size_t escapes = 32 + (steps + 3) / 4;
  ASSERT_EQ(bytes[escapes], 252) << "a start with two new vertices";
  EXPECT_NE(faultOf(withField<std::uint8_t>(bytes, escapes, 0)).find("triangles do not decode"), std::string::npos);
  EXPECT_NE(faultOf(withField<std::uint8_t>(bytes, escapes, 251)).find("triangles do not decode"), std::string::npos);
  EXPECT_NE(faultOf(withField<std::uint8_t>(bytes, escapes, 255)).find("triangles do not decode"), std::string::npos);
}

using PatchCodecDeathTest = ::testing::Test;

TEST(PatchCodecDeathTest, aCallersMistakeStops) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  PatchGeometry g{{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}}, std::vector<glm::vec3>(3, glm::vec3(0, 0, 1)), {}, {0, 1, 3}};
  EXPECT_DEATH(encodePatch(g), "3 against 3");
  g.indices.clear();
  EXPECT_DEATH(encodePatch(g), "check failed");
  g.indices = {0, 1, 2};
  g.positions[0].x = kMaxLattice + 1;
  EXPECT_DEATH(encodePatch(g), "check failed");
}

}  // namespace
}  // namespace lod::patch
