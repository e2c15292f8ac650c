#include "lod/hlod/format.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <tuple>

#include "base/crc32c.h"
#include "tests/support/made_hlod.h"

namespace lod::hlod {
namespace {

const support::MadeHlod& made() {
  static const support::MadeHlod file = support::madeHlod(4, 4);
  return file;
}

base::Bytes tableOf(const support::MadeHlod& file) {
  const auto begin = file.file.begin() + kHeaderBytes;
  return {begin, begin + file.header.table_bytes};
}

/// Seals changed bytes again.
void seal(base::Bytes& bytes) {
  const std::uint32_t crc = base::crc32c(base::ByteView(bytes).first(bytes.size() - sizeof(crc)));
  std::memcpy(bytes.data() + bytes.size() - sizeof(crc), &crc, sizeof(crc));
}

TEST(HlodFormatTest, headersReturn) {
  Header header = made().header;
  for (const bool colors : {false, true}) {
    header.colors = colors;
    const base::Bytes bytes = headerBytes(header);
    ASSERT_EQ(bytes.size(), kHeaderBytes);
    const auto read = readHeader(bytes);
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_EQ(headerBytes(*read), bytes);
    EXPECT_EQ(read->colors, colors);
    EXPECT_EQ(std::tie(read->file_bytes, read->source_triangles, read->nodes, read->table_bytes),
              std::tie(header.file_bytes, header.source_triangles, header.nodes, header.table_bytes));
    EXPECT_EQ(std::tie(read->low, read->high, read->bounds.center, read->bounds.radius),
              std::tie(header.low, header.high, header.bounds.center, header.bounds.radius));
  }
}

TEST(HlodFormatTest, damagedAndForeignHeadersAreRefused) {
  const base::Bytes bytes = headerBytes(made().header);
  for (std::size_t length = 0; length < bytes.size(); ++length)
    EXPECT_FALSE(readHeader(base::ByteView(bytes).first(length)));
  for (std::size_t at = 0; at < bytes.size(); ++at) {
    base::Bytes spoilt = bytes;
    spoilt[at] ^= 4;
    EXPECT_FALSE(readHeader(spoilt)) << "byte " << at;
  }
  for (const std::uint8_t version : {1, 3}) {
    base::Bytes other = bytes;
    other[8] = version;
    ASSERT_FALSE(readHeader(other));
    EXPECT_EQ(readHeader(other).error().code, base::ErrorCode::kVersion);
    EXPECT_NE(readHeader(other).error().message.find("build the scene again"), std::string::npos);
  }
}

TEST(HlodFormatTest, headersThatContradictThemselvesAreRefused) {
  const auto refused = [](const auto& change) {
    Header header = made().header;
    change(header);
    EXPECT_FALSE(readHeader(headerBytes(header)));
  };
  refused([](Header& h) { h.nodes = 0; });
  refused([](Header& h) { h.source_triangles = std::uint64_t{h.nodes} * kMaxPrimitives + 1; });
  refused([](Header& h) { h.table_bytes = kMinNodeBytes * h.nodes - 1; });
  refused([](Header& h) { h.table_bytes = static_cast<std::uint32_t>(h.file_bytes); });
  refused([](Header& h) { h.file_bytes = std::uint64_t{1} << 48; });
  refused([](Header& h) { h.file_bytes = 100; });
  refused([](Header& h) { h.lattice.step = 0.0; });
  refused([](Header& h) { h.lattice.step = 1e300; });
  refused([](Header& h) { h.lattice.origin.y = std::numeric_limits<double>::quiet_NaN(); });
  refused([](Header& h) { h.low.x = -1; });
  refused([](Header& h) { h.low.y = h.high.y + 1; });
  refused([](Header& h) { h.high.z = kLatticeEnd + 1; });
  base::Bytes flagged = headerBytes(made().header);
  flagged[12] |= 2;
  seal(flagged);
  EXPECT_FALSE(readHeader(flagged));
  base::Bytes padded = headerBytes(made().header);
  padded[kHeaderBytes - 5] = 1;
  seal(padded);
  EXPECT_FALSE(readHeader(padded));
}

/// The nodes of made(), with boxes, cones, errors and counts of chance. Children's boxes lie in their parents'.
std::vector<Node> randomNodes(unsigned seed) {
  std::mt19937 random(seed);
  const auto number = [&](double low, double high) {
    return low + (high - low) * (static_cast<double>(random()) / 4294967296.0);
  };
  std::vector<Node> nodes = made().nodes;
  for (Node& node : nodes) {
    node.cone.axis = glm::normalize(glm::vec3(number(-1, 1), number(-1, 1), number(-1, 1)) + glm::vec3(1e-4F));
    node.cone.cos_angle = static_cast<float>(number(-1.0, 1.0));
    node.step_bits = static_cast<std::uint8_t>(random() % kPositionBits);
    if (!node.isLeaf()) {
      node.shape_error = random() % 5 == 0 ? 0.0F : std::exp2(static_cast<float>(number(-30.0, 1.0)));
      node.error = node.shape_error * static_cast<float>(number(1.0, 4.0));
      node.caster_error = random() % 5 == 0 ? 0.0F : std::exp2(static_cast<float>(number(-30.0, 1.0)));
      node.caster_triangles = random() % 3 == 0 ? 0 : random() % kMaxPrimitives;
      node.caster.bytes = node.caster_triangles == 0 ? 0 : 1 + random() % kMaxBlockBytes;
    }
    node.triangles = random() % 3 == 0 ? 0 : random() % kMaxPrimitives;
    node.points = random() % 3 == 0 ? 0 : random() % kMaxPrimitives;
    node.edges = random() % (1 + std::min(kMaxPrimitives, 3 * node.triangles));
    node.picture.bytes = node.triangles + node.points == 0 ? 0 : 1 + random() % kMaxBlockBytes;
    for (std::uint32_t c = node.first_child; c < node.first_child + node.children; ++c) {
      nodes[c].box = {};
      for (int i = 0; i < 2; ++i)
        nodes[c].box.add(node.box.min + glm::vec3(number(0, 1), number(0, 1), number(0, 1)) * node.box.size());
    }
  }
  // Errors of parents are not below those of their children.
  for (std::size_t i = nodes.size(); i-- > 0;)
    for (std::uint32_t c = nodes[i].first_child; c < nodes[i].first_child + nodes[i].children; ++c) {
      nodes[i].error = std::max(nodes[i].error, nodes[c].error);
      nodes[i].caster_error = std::max(nodes[i].caster_error, nodes[c].caster_error);
      nodes[i].shape_error = std::max(nodes[i].shape_error, nodes[c].shape_error);
    }
  return nodes;
}

/// Whether all directions of one cone lie in the other.
bool isConeWithin(const base::NormalCone& inner, const base::NormalCone& outer) {
  if (outer.cos_angle <= -1.0F) return true;
  const glm::dvec3 a(inner.axis), b(outer.axis);
  const double between = std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b));
  return between + std::acos(static_cast<double>(inner.cos_angle)) <=
         std::acos(static_cast<double>(outer.cos_angle)) + 1e-6;
}

TEST(HlodFormatTest, tablesReturnWithWhatIsRoundedOutward) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    std::vector<Node> nodes = randomNodes(seed);
    Header header = made().header;
    const base::Bytes table = tableBytes(nodes, header);
    header.source_triangles = 0;
    for (const Node& node : nodes) header.source_triangles += node.isLeaf() ? node.triangles : 0;
    placeBlocks(header, nodes);
    const auto read = readTable(header, table);
    ASSERT_TRUE(read) << read.error().message;
    ASSERT_EQ(read->size(), nodes.size());
    const auto smallest = static_cast<float>(header.lattice.step * std::exp2(-20.0));
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      const Node &a = nodes[i], &b = (*read)[i];
      EXPECT_EQ(std::tie(a.first_child, a.children, a.step_bits, a.triangles, a.points, a.edges),
                std::tie(b.first_child, b.children, b.step_bits, b.triangles, b.points, b.edges));
      EXPECT_EQ(std::tie(a.picture.offset, a.picture.bytes, a.caster.offset, a.caster.bytes),
                std::tie(b.picture.offset, b.picture.bytes, b.caster.offset, b.caster.bytes));
      EXPECT_EQ(a.caster_triangles, b.caster_triangles);
      EXPECT_TRUE(b.box.contains(a.box.min) && b.box.contains(a.box.max)) << "node " << i;
      EXPECT_TRUE(isConeWithin(a.cone, b.cone)) << "node " << i;
      for (const auto error : {&Node::error, &Node::shape_error, &Node::caster_error}) {
        EXPECT_GE(b.*error, a.*error);
        EXPECT_EQ(a.*error == 0.0F, b.*error == 0.0F);
        EXPECT_LE(b.*error, std::max(1.01F * a.*error, smallest));
      }
      for (std::uint32_t c = b.first_child; c < b.first_child + b.children; ++c) {
        const Node& child = (*read)[c];
        EXPECT_TRUE(b.box.contains(child.box.min) && b.box.contains(child.box.max));
        EXPECT_GE(b.error, child.error);
        EXPECT_GE(b.shape_error, child.shape_error);
        EXPECT_GE(b.caster_error, child.caster_error);
        // A box is known to a 64th of its parent's.
        for (int axis = 0; axis < 3; ++axis)
          EXPECT_LE(child.box.size()[axis], nodes[c].box.size()[axis] + b.box.size()[axis] / 30.0F + 1e-5F);
      }
    }
    EXPECT_EQ(tableBytes(*read, header), table) << "a table that was read is written as it was";
  }
}

TEST(HlodFormatTest, parentsAreWidenedToWhatTheirChildrenHave) {
  std::vector<Node> nodes = made().nodes;
  nodes[0].error = nodes[0].caster_error = 0.0F;
  nodes[0].box.max = nodes[0].box.center();
  Header header = made().header;
  const base::Bytes table = tableBytes(nodes, header);
  placeBlocks(header, nodes);
  const auto read = readTable(header, table);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_GE((*read)[0].error, made().nodes[1].error);
  EXPECT_GE((*read)[0].caster_error, made().nodes[1].caster_error);
  EXPECT_TRUE((*read)[0].box.contains(made().nodes[0].box.max));
}

// Its box is not known to a share of the lattice, of which a small mesh uses a corner.
TEST(HlodFormatTest, theRootsBoxIsTheGeometrys) {
  std::vector<Node> nodes(1);
  Header header = made().header;
  const glm::ivec3 low(3, 5, 7), high(16000, 900, kLatticeEnd);
  for (const glm::ivec3& corner : {low, high}) nodes[0].box.add(header.lattice.position(corner));
  header.source_triangles = nodes[0].triangles = 1;
  nodes[0].picture.bytes = 30;
  const base::Bytes table = tableBytes(nodes, header);
  EXPECT_EQ(header.low, low);
  EXPECT_EQ(header.high, high);
  placeBlocks(header, nodes);
  const auto read = readTable(header, table);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->front().box.min, nodes[0].box.min);
  EXPECT_EQ(read->front().box.max, nodes[0].box.max);
  for (int corner = 0; corner < 8; ++corner)
    EXPECT_LE(glm::distance(nodes[0].box.corner(corner), header.bounds.center), header.bounds.radius);
}

TEST(HlodFormatTest, tablesAreShort) {
  EXPECT_LT(made().header.table_bytes, 20 * made().header.nodes);
}

TEST(HlodFormatTest, picturesLieBeforeCastersInTheOrderOfTheNodes) {
  std::uint64_t end = kHeaderBytes + made().header.table_bytes;
  for (const auto place : {&Node::picture, &Node::caster})
    for (const Node& node : made().nodes) {
      EXPECT_EQ((node.*place).offset, end);
      end += (node.*place).bytes;
    }
  EXPECT_EQ(end, made().file.size());
  EXPECT_EQ(end, made().header.file_bytes);
}

TEST(HlodFormatTest, damagedTablesAreRefused) {
  const base::Bytes table = tableOf(made());
  EXPECT_TRUE(readTable(made().header, table));
  for (std::size_t length = 0; length < table.size(); length += 7)
    EXPECT_FALSE(readTable(made().header, base::ByteView(table).first(length)));
  for (std::size_t at = 0; at < table.size(); at += 3) {
    base::Bytes spoilt = table;
    spoilt[at] ^= 0x11;
    EXPECT_FALSE(readTable(made().header, spoilt)) << "byte " << at;
    if (at >= table.size() - 4) continue;
    // A box may be another now, but the sums are right where the table is taken.
    seal(spoilt);
    if (const auto read = readTable(made().header, spoilt)) {
      std::uint64_t triangles = 0;
      for (const Node& node : *read) triangles += node.isLeaf() ? node.triangles : 0;
      EXPECT_EQ(triangles, made().header.source_triangles);
    }
  }
}

TEST(HlodFormatTest, tablesThatContradictTheHeaderAreRefused) {
  const base::Bytes table = tableOf(made());
  const auto refused = [&](const auto& change) {
    Header header = made().header;
    change(header);
    EXPECT_FALSE(readTable(header, table));
  };
  refused([](Header& h) { --h.source_triangles; });
  refused([](Header& h) { ++h.file_bytes; });
  refused([](Header& h) { --h.nodes; });
  refused([](Header& h) { ++h.nodes; });
}

TEST(HlodFormatTest, aSingleLeafAndALongChainReturn) {
  for (const std::uint32_t depth : {0U, 1U, kMaxDepth}) {
    std::vector<Node> nodes;
    Header header = made().header;
    for (std::uint32_t d = 0; d <= depth; ++d) {
      Node& node = nodes.emplace_back();
      node.box.add(header.lattice.position(glm::ivec3(5)));
      node.triangles = 1;
      node.picture.bytes = 30;
      if (d < depth) node.children = 1, node.first_child = d + 1;
    }
    header.source_triangles = 1;
    const base::Bytes table = tableBytes(nodes, header);
    EXPECT_GE(table.size(), kMinNodeBytes * nodes.size());
    placeBlocks(header, nodes);
    const auto read = readTable(header, table);
    ASSERT_TRUE(read) << read.error().message;
    for (std::uint32_t d = 0; d < depth; ++d) EXPECT_EQ((*read)[d].first_child, d + 1);
    EXPECT_TRUE(read->back().isLeaf());
  }
}

}  // namespace
}  // namespace lod::hlod
