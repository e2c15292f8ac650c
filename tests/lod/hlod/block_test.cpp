#include "lod/hlod/block.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <random>
#include <tuple>

#include "lod/patch/codec.h"
#include "lod/pmr/chunks.h"
#include "tests/support/made_hlod.h"

namespace lod::hlod {
namespace {

constexpr std::int32_t kLast = (1 << kPositionBits) - 1;

/// A vertex by its place and what its attributes are rounded to.
using Key = std::array<float, 9>;

Key keyOf(const NodeVertex& v, const glm::vec3& normal, const glm::u8vec3& color) {
  return {static_cast<float>(v.place.x),
          static_cast<float>(v.place.y),
          static_cast<float>(v.place.z),
          normal.x,
          normal.y,
          normal.z,
          static_cast<float>(color.x),
          static_cast<float>(color.y),
          static_cast<float>(color.z)};
}

Key cornerKey(const NodeVertex& vertex, const BlockOptions& options) {
  if (options.is_caster) return keyOf(vertex, glm::vec3(0.0F, 0.0F, 1.0F), glm::u8vec3(255));
  glm::vec3 normal = vertex.normal;
  patch::quantizeNormals({&normal, 1});
  const glm::u8vec4 color = patch::quantizedColor(glm::u8vec4(vertex.color, 255));
  return keyOf(vertex, normal, options.colors ? glm::u8vec3(color) : glm::u8vec3(255));
}

std::vector<std::array<Key, 3>> trianglesOf(const NodeGeometry& geometry, const BlockOptions& options) {
  std::vector<std::array<Key, 3>> triangles;
  for (std::size_t i = 0; i < geometry.triangles.size(); i += 3) {
    std::array<Key, 3> corners;
    for (std::size_t k = 0; k < 3; ++k) corners[k] = cornerKey(geometry.vertices[geometry.triangles[i + k]], options);
    std::rotate(corners.begin(), std::min_element(corners.begin(), corners.end()), corners.end());
    triangles.push_back(corners);
  }
  std::sort(triangles.begin(), triangles.end());
  return triangles;
}

std::vector<std::array<Key, 2>> edgesOf(const NodeGeometry& geometry, const BlockOptions& options) {
  std::vector<std::array<Key, 2>> edges;
  for (std::size_t i = 0; i < geometry.edges.size(); i += 2) {
    std::array<Key, 2> ends{cornerKey(geometry.vertices[geometry.edges[i]], options),
                            cornerKey(geometry.vertices[geometry.edges[i + 1]], options)};
    std::sort(ends.begin(), ends.end());
    edges.push_back(ends);
  }
  std::sort(edges.begin(), edges.end());
  return edges;
}

std::vector<Key> pointsOf(const NodeGeometry& geometry, const BlockOptions& options) {
  std::vector<Key> points;
  for (const NodeVertex& point : geometry.points)
    points.push_back(keyOf(point, pmr::decodeNormal(pmr::encodeNormal(point.normal)),
                           options.colors ? point.color : glm::u8vec3(255)));
  std::sort(points.begin(), points.end());
  return points;
}

Node rowOf(const NodeGeometry& geometry, std::uint32_t step_bits = 0) {
  Node row;
  row.step_bits = static_cast<std::uint8_t>(step_bits);
  row.triangles = row.caster_triangles = static_cast<std::uint32_t>(geometry.triangles.size() / 3);
  row.points = static_cast<std::uint32_t>(geometry.points.size());
  row.edges = static_cast<std::uint32_t>(geometry.edges.size() / 2);
  return row;
}

void expectReturns(const NodeGeometry& geometry, const BlockOptions& options) {
  const base::Bytes bytes = encodeBlock(geometry, options);
  EXPECT_EQ(bytes.empty(), geometry.triangles.empty() && geometry.points.empty());
  EXPECT_TRUE(isIntact(bytes, rowOf(geometry), options));
  const auto back = decodeBlock(bytes, rowOf(geometry), options);
  ASSERT_TRUE(back) << back.error().message;
  // Attributes that were rounded once stay as they are.
  EXPECT_EQ(trianglesOf(*back, options), trianglesOf(geometry, options));
  EXPECT_EQ(edgesOf(*back, options), edgesOf(geometry, options));
  EXPECT_EQ(pointsOf(*back, options), pointsOf(geometry, options));
}

const support::MadeHlod& made() {
  static const support::MadeHlod file = support::madeHlod(2, 16);
  return file;
}

NodeVertex randomVertex(std::mt19937& random, std::int32_t end) {
  const auto below = [&](std::int32_t limit) {
    return static_cast<std::int32_t>(random() % static_cast<std::uint32_t>(limit));
  };
  const auto number = [&] { return static_cast<float>(below(2001) - 1000) / 1000.0F; };
  return {{below(end), below(end), below(end)},
          glm::normalize(glm::vec3(number(), number(), number()) + glm::vec3(0.0F, 0.0F, 0.0003F)),
          glm::u8vec3(below(256), below(256), below(256))};
}

/// A flat grid of columns × rows quads, two triangles each.
NodeGeometry grid(std::uint32_t columns, std::uint32_t rows) {
  NodeGeometry geometry;
  for (std::uint32_t y = 0; y <= rows; ++y)
    for (std::uint32_t x = 0; x <= columns; ++x)
      geometry.vertices.push_back(
          {{static_cast<int>(x), static_cast<int>(y), 7}, glm::vec3(0, 0, 1), glm::u8vec3(x & 255, y & 255, 9)});
  const auto at = [&](std::uint32_t x, std::uint32_t y) { return y * (columns + 1) + x; };
  for (std::uint32_t y = 0; y < rows; ++y)
    for (std::uint32_t x = 0; x < columns; ++x)
      for (const std::uint32_t v : {at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y), at(x + 1, y + 1), at(x, y + 1)})
        geometry.triangles.push_back(v);
  // The first and the last row's outer edges.
  for (std::uint32_t x = 0; x < columns; ++x)
    for (const std::uint32_t v : {at(x + 1, 0), at(x, 0), at(x, rows), at(x + 1, rows)}) geometry.edges.push_back(v);
  return geometry;
}

TEST(HlodBlockTest, picturesAndCastersOfAFileReturn) {
  ASSERT_GT(made().pictures[0].points.size(), 100U);
  ASSERT_GT(made().pictures[0].edges.size(), 100U);
  for (std::size_t i = 0; i < made().nodes.size(); ++i) {
    for (const bool colors : {false, true}) expectReturns(made().pictures[i], {colors, false});
    expectReturns(made().casters[i], {true, true});
  }
}

TEST(HlodBlockTest, aFilesBlocksAreThoseOfItsNodes) {
  for (std::size_t i = 0; i < made().nodes.size(); ++i) {
    const Node& node = made().nodes[i];
    const auto part = base::ByteView(made().file).subspan(node.picture.offset, node.picture.bytes);
    const auto back = decodeBlock(part, node, {true, false});
    ASSERT_TRUE(back) << back.error().message;
    EXPECT_EQ(trianglesOf(*back, {true, false}), trianglesOf(made().pictures[i], {true, false}));
    for (const auto* list : {&back->vertices, &back->points})
      for (const NodeVertex& vertex : *list)
        EXPECT_TRUE(node.box.contains(made().header.lattice.position(vertex.place * (1 << node.step_bits))));
  }
}

TEST(HlodBlockTest, nothingHasNoBytes) {
  expectReturns({}, {true, false});
  expectReturns({}, {true, true});
  NodeGeometry point;
  point.points.push_back({glm::ivec3(kLast), glm::vec3(1, 0, 0), glm::u8vec3(1, 2, 3)});
  expectReturns(point, {true, false});
}

TEST(HlodBlockTest, moreTrianglesVerticesAndPointsThanAPieceHoldsReturn) {
  NodeGeometry many = grid(400, 100);  // 80 000 triangles
  expectReturns(many, {true, false});
  many.edges.clear();
  expectReturns(many, {true, true});

  // Triangles without common vertices: a piece is full of vertices first.
  NodeGeometry apart;
  std::mt19937 random(4);
  for (std::uint32_t i = 0; i < 3 * 30'000; ++i) {
    apart.vertices.push_back(randomVertex(random, kLast + 1));
    apart.triangles.push_back(i);
  }
  expectReturns(apart, {true, false});
  for (std::size_t i = 0; i < 140'000; ++i) apart.points.push_back(randomVertex(random, 1 << 12));
  apart.triangles.resize(3);
  expectReturns(apart, {true, false});
}

TEST(HlodBlockTest, verticesAtOnePlaceOfDifferentAttributesStayApart) {
  // Two quads that meet in a crease: along it each has normals and colours of its own.
  NodeGeometry crease = grid(1, 1);
  const NodeGeometry other = grid(1, 1);
  for (NodeVertex vertex : other.vertices) {
    vertex.normal = glm::vec3(1, 0, 0);
    vertex.color = glm::u8vec3(200, 10, 10);
    vertex.place.z += vertex.place.x * 5;
    crease.vertices.push_back(vertex);
  }
  for (const std::uint32_t v : other.triangles) crease.triangles.push_back(v + 4);
  for (const std::uint32_t v : other.edges) crease.edges.push_back(v + 4);
  expectReturns(crease, {true, false});
}

TEST(HlodBlockTest, anyTrianglesAndEdgesReturn) {
  std::mt19937 random(5);
  for (int round = 0; round < 30; ++round) {
    NodeGeometry soup;
    for (int i = 0; i < 40; ++i) soup.vertices.push_back(randomVertex(random, round < 10 ? 3 : 1000));
    for (int i = 0; i < 60; ++i) {
      const std::uint32_t a = random() % 40, b = random() % 40, c = random() % 40;
      const auto at = [&](std::uint32_t v) { return soup.vertices[v].place; };
      if (a == b || b == c || c == a || at(a) == at(b) || at(b) == at(c) || at(c) == at(a)) continue;
      soup.triangles.insert(soup.triangles.end(), {a, b, c});
    }
    // A few of the edges, some of them turned; each once.
    std::map<std::pair<std::uint32_t, std::uint32_t>, bool> taken;
    for (std::size_t i = 0; i < soup.triangles.size(); i += 4) {
      const std::uint32_t a = soup.triangles[i], b = soup.triangles[i % 3 == 2 ? i - 2 : i + 1];
      if (!taken.emplace(std::pair(std::min(a, b), std::max(a, b)), true).second) continue;
      soup.edges.insert(soup.edges.end(), {i % 8 == 0 ? a : b, i % 8 == 0 ? b : a});
    }
    expectReturns(soup, {true, false});
  }
}

TEST(HlodBlockTest, damagedBlocksAreRefused) {
  const NodeGeometry& geometry = made().pictures[1];
  const Node row = rowOf(geometry, made().nodes[1].step_bits);
  const BlockOptions options{true, false};
  const base::Bytes bytes = encodeBlock(geometry, options);
  ASSERT_TRUE(decodeBlock(bytes, row, options));
  for (std::size_t length = 0; length < bytes.size(); length += 5)
    EXPECT_FALSE(decodeBlock(base::ByteView(bytes).first(length), row, options));
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    base::Bytes spoilt = bytes;
    spoilt[i] ^= 0x10;
    EXPECT_FALSE(isIntact(spoilt, row, options));
    EXPECT_FALSE(decodeBlock(spoilt, row, options)) << "byte " << i;
  }
  const auto refused = [&](const auto& change) {
    Node other = row;
    change(other);
    EXPECT_FALSE(decodeBlock(bytes, other, options));
  };
  refused([](Node& n) { ++n.triangles; });
  refused([](Node& n) { --n.points; });
  refused([](Node& n) { ++n.edges; });
  refused([](Node& n) { --n.edges; });
  refused([](Node& n) { n.edges = 0; });
  refused([](Node& n) { n.triangles = n.points = n.edges = 0; });
  EXPECT_FALSE(decodeBlock(bytes, row, {false, false})) << "colours that nobody asked for";
}

TEST(HlodBlockTest, placesBeyondTheLatticeAreRefused) {
  NodeGeometry geometry = grid(2, 2);
  // 2^11 steps of 2^10 lattice steps are the lattice's end.
  geometry.vertices[3].place.x = 1 << 11;
  const base::Bytes bytes = encodeBlock(geometry, {false, false});
  EXPECT_TRUE(decodeBlock(bytes, rowOf(geometry, 10), {false, false}));
  EXPECT_FALSE(decodeBlock(bytes, rowOf(geometry, 11), {false, false}));
  geometry.vertices[3].place.x = -1;
  EXPECT_FALSE(decodeBlock(encodeBlock(geometry, {false, false}), rowOf(geometry), {false, false}));
  NodeGeometry points;
  points.points.push_back({glm::ivec3(1 << 11)});
  const base::Bytes chunk = encodeBlock(points, {false, false});
  EXPECT_TRUE(decodeBlock(chunk, rowOf(points, 10), {false, false}));
  EXPECT_FALSE(decodeBlock(chunk, rowOf(points, 11), {false, false}));
}

}  // namespace
}  // namespace lod::hlod
