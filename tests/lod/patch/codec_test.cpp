#include "lod/patch/codec.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "base/crc32c.h"
#include "tests/lod/patch/patch_testing.h"

namespace lod::patch {
namespace {

using patch_testing::drawPatch;
using patch_testing::Shape;
using patch_testing::shapes;
using patch_testing::surfaceOf;

bool sameBits(const glm::vec3& a, const glm::vec3& b) {
  return std::memcmp(&a, &b, sizeof(a)) == 0;
}

// Bytes with the checksum made right for whatever else they say.
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

std::string faultOf(base::ByteView bytes) {
  const auto decoded = decodePatch(bytes);
  return decoded ? "" : decoded.error().message;
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

TEST(PatchCodec, positionsAreNarrowUpTo65535StepsAndWideBeyond) {
  for (const int extent : {65535, 65536}) {
    const PatchGeometry source{
        {{0, 5, 0}, {1, 5 + extent, 0}, {1, 7, 0}}, std::vector<glm::vec3>(3, glm::vec3(0, 0, 1)), {}, {0, 1, 2}};
    const base::Bytes bytes = encodePatch(source);
    EXPECT_EQ(bytes[1] & 1, extent > 65535 ? 1 : 0);
    const auto decoded = decodePatch(bytes);
    ASSERT_TRUE(decoded);
    EXPECT_TRUE(surfaceOf(*decoded) == surfaceOf(source));
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
    EXPECT_TRUE(sameBits(decoded->normals[v], quantizedNormal(source.normals[place])));
  }
}

TEST(PatchCodec, quantizingANormalTwiceChangesNothing) {
  // Every code there is, reached through directions all over the sphere.
  int tried = 0;
  for (int u = -127; u <= 127; ++u) {
    for (int v = -127; v <= 127; ++v, ++tried) {
      const float z = 127.0F - static_cast<float>(std::abs(u) + std::abs(v));
      glm::vec3 n(u, v, z);
      if (z < 0.0F) n = glm::vec3((127 - std::abs(v)) * (u >= 0 ? 1 : -1), (127 - std::abs(u)) * (v >= 0 ? 1 : -1), z);
      const glm::vec3 once = quantizedNormal(n);
      ASSERT_TRUE(sameBits(once, quantizedNormal(once))) << u << " " << v;
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
    worst = std::min(worst, glm::dot(n, quantizedNormal(n)));
  }
  EXPECT_GT(worst, std::cos(glm::radians(1.0F)));
  EXPECT_LT(worst, std::cos(glm::radians(0.3F))) << "8 + 8 bits can't be as good as this: is anything quantized?";
}

TEST(PatchCodec, aNormalThatIsNoneBecomesUp) {
  const glm::vec3 up(0.0F, 0.0F, 1.0F);
  EXPECT_EQ(quantizedNormal(glm::vec3(0.0F)), up);
  EXPECT_EQ(quantizedNormal(glm::vec3(NAN, 1.0F, 0.0F)), up);
  EXPECT_EQ(quantizedNormal(glm::vec3(INFINITY, 1.0F, 0.0F)), up);
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
  std::uint32_t vertex_bytes = 0;
  std::memcpy(&vertex_bytes, bytes.data() + 20, 4);
  std::uint32_t index_bytes = 0;
  std::memcpy(&index_bytes, bytes.data() + 24, 4);
  for (std::uint32_t cut = 1; cut <= index_bytes; ++cut) {
    base::Bytes shorter(bytes.begin(), bytes.end() - static_cast<std::ptrdiff_t>(cut));
    EXPECT_NE(faultOf(withField(shorter, 24, index_bytes - cut)).find("index stream"), std::string::npos) << cut;
  }
  for (std::uint32_t cut = 1; cut <= vertex_bytes; ++cut) {
    base::Bytes shorter = bytes;
    shorter.erase(shorter.begin() + 32, shorter.begin() + 32 + static_cast<std::ptrdiff_t>(cut));
    EXPECT_FALSE(decodePatch(withField(shorter, 20, vertex_bytes - cut))) << cut;
  }
}

TEST(PatchCodec, wrongFieldsUnderARightChecksumAreNamed) {
  const base::Bytes bytes = smallPatch();
  EXPECT_NE(faultOf(withField<std::uint8_t>(bytes, 0, 2)).find("version 2"), std::string::npos);
  EXPECT_NE(faultOf(withField<std::uint8_t>(bytes, 1, 4)).find("unknown flags"), std::string::npos);
  EXPECT_NE(faultOf(withField<std::uint16_t>(bytes, 4, 0)).find("no triangles"), std::string::npos);
  EXPECT_NE(faultOf(withField<std::uint16_t>(bytes, 6, 1)).find("unknown flags"), std::string::npos);
  EXPECT_NE(faultOf(withField<std::int32_t>(bytes, 8, kMaxLattice)).find("outside the lattice"), std::string::npos);
  EXPECT_NE(
      faultOf(withField<std::int32_t>(bytes, 12, std::numeric_limits<std::int32_t>::min())).find("outside the lattice"),
      std::string::npos);
  EXPECT_NE(faultOf(withField<std::uint32_t>(bytes, 20, 0xFFFFFFFF)).find("header says"), std::string::npos);
}

TEST(PatchCodec, indicesBeyondTheVerticesAreRefused) {
  // 3 vertices' stream, but triangles that name 4: two patches crossed.
  PatchGeometry square{{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}},
                       std::vector<glm::vec3>(4, glm::vec3(0, 0, 1)),
                       {},
                       {0, 1, 2, 0, 2, 3}};
  PatchGeometry half = square;
  half.indices = {0, 1, 2, 0, 1, 2};
  const base::Bytes four = encodePatch(square);
  const base::Bytes three = encodePatch(half);
  std::uint32_t vertices_three = 0;
  std::memcpy(&vertices_three, three.data() + 20, 4);
  std::uint32_t vertices_four = 0;
  std::memcpy(&vertices_four, four.data() + 20, 4);
  base::Bytes crossed(three.begin(), three.begin() + 32 + vertices_three);
  crossed.insert(crossed.end(), four.begin() + 32 + vertices_four, four.end());
  const auto index_bytes = static_cast<std::uint32_t>(crossed.size() - 32 - vertices_three);
  EXPECT_NE(faultOf(withField(crossed, 24, index_bytes)).find("index 3 of 3 vertices"), std::string::npos);
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
