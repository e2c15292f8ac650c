// Implements readTable and tableBytes of format.h.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "base/check.h"
#include "base/crc32c.h"
#include "lod/hlod/format.h"
#include "lod/lattice_box.h"
#include "lod/pmr/chunks.h"
#include "lod/pmr/range_coder.h"

namespace lod::hlod {
namespace {

using pmr::NumberModel;
using pmr::RangeDecoder;
using pmr::RangeEncoder;
using pmr::SignedModel;
using pmr::SymbolModel;

/// A box is coded in steps of which its parent's box has at most 2^kBoxBits − 1.
constexpr unsigned kBoxBits = 7;
/// A cone's axis has so many bits for each octahedral coordinate; its half-angle is a code in steps of 180° / 64.
constexpr unsigned kAxisBits = 6;
constexpr std::int32_t kFullAngle = 64;
/// An error is a code: 0 is 0, and code c is 2^((c − 1) / 72 − 20) steps of the lattice.
constexpr double kErrorSteps = 72.0;
constexpr double kSmallestError = 20.0;
constexpr std::int32_t kMaxErrorCode = 1 + 72 * 48;

float errorOfCode(std::int32_t code, const Lattice& lattice) {
  if (code == 0) return 0.0F;
  return static_cast<float>(lattice.step * std::exp2((code - 1) / kErrorSteps - kSmallestError));
}

/// The code of the least error that is at least `error`.
std::int32_t errorCode(float error, const Lattice& lattice) {
  if (!(error > 0.0F)) return 0;
  const double exact = 1.0 + kErrorSteps * (std::log2(static_cast<double>(error) / lattice.step) + kSmallestError);
  auto code = static_cast<std::int32_t>(std::clamp(std::ceil(exact), 1.0, static_cast<double>(kMaxErrorCode)));
  while (code > 1 && errorOfCode(code - 1, lattice) >= error) --code;
  while (code < kMaxErrorCode && errorOfCode(code, lattice) < error) ++code;
  LUMIGRID_CHECK(errorOfCode(code, lattice) >= error);
  return code;
}

glm::vec3 axisOfCode(const std::array<std::int32_t, 2>& code) {
  constexpr unsigned kShift = 8 - kAxisBits;
  constexpr std::int32_t kHalf = 1 << (kShift - 1);
  return pmr::decodeNormal(glm::u8vec2((code[0] << kShift) + kHalf, (code[1] << kShift) + kHalf));
}

float cosineOfCode(std::int32_t code) {
  return code >= kFullAngle ? -1.0F : static_cast<float>(std::cos(code * 3.14159265358979323846 / kFullAngle));
}

/// The code of the narrowest cone about a coded axis that contains `cone`.
std::int32_t angleCode(const base::NormalCone& cone, const glm::vec3& axis) {
  const glm::dvec3 a(axis), b(cone.axis);
  const double turn = std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b));
  const double angle = std::acos(std::clamp(static_cast<double>(cone.cos_angle), -1.0, 1.0)) + turn;
  const double wanted = turn == 0.0 ? static_cast<double>(cone.cos_angle) : angle < 3.1415 ? std::cos(angle) : -1.0;
  std::int32_t code = 0;
  while (code<kFullAngle&& static_cast<double>(cosineOfCode(code))> wanted) ++code;
  return code;
}

/// A node as the table codes it: all in integers.
struct CodedNode {
  std::uint32_t children = 0;
  std::uint32_t depth = 0;
  glm::ivec3 low{0}, high{kLatticeEnd};  ///< the box, in lattice points
  std::array<std::int32_t, 2> axis{1 << (kAxisBits - 1), 1 << (kAxisBits - 1)};
  std::int32_t angle = kFullAngle;
  /// In this order: error, shape error, caster error.
  std::array<std::int32_t, 3> errors{kMaxErrorCode, kMaxErrorCode, kMaxErrorCode};
  std::uint32_t step_bits = 0;
  std::uint32_t triangles = 0, points = 0, edges = 0, caster_triangles = 0;
  std::uint32_t picture_bytes = 0, caster_bytes = 0;

  bool isLeaf() const { return children == 0; }
};

/// Codes node after node, in both directions (pmr/range_coder.h). Numbers are coded by their differences from those of
/// the last node of the same depth and kind: leaves are one kind, inner nodes the other.
template <class Coder>
class NodeModel {
 public:
  explicit NodeModel(Coder& coder) : coder_(coder) {}

  /// `node.depth` and `parent` are known. False where what was decoded cannot be.
  bool code(CodedNode& node, const CodedNode& parent) {
    node.children = children_[node.depth].code(coder_, node.children);
    if (node.children > 8 || (node.children > 0 && node.depth == kMaxDepth)) return false;
    kind_ = node.isLeaf() ? 0 : 1;
    before_ = &last_[node.depth][kind_];
    if (!codeBox(node, parent)) return false;
    codeAxis(node, parent);
    if (!codeNear(angle_[kind_], before_->angle, kFullAngle, node.angle) || !codeErrors(node, parent)) return false;
    node.step_bits = step_bits_[kind_].code(coder_, node.step_bits);
    if (node.step_bits >= kPositionBits || !codeCounts(node) || !codeLengths(node)) return false;
    last_[node.depth][kind_] = node;
    return true;
  }

 private:
  bool codeBox(CodedNode& node, const CodedNode& parent) {
    for (int axis = 0; axis < 3; ++axis) {
      const auto k = static_cast<std::size_t>(axis);
      const std::int32_t size = parent.high[axis] - parent.low[axis];
      const auto bits = static_cast<unsigned>(std::bit_width(static_cast<std::uint32_t>(size)));
      const unsigned shift = bits > kBoxBits ? bits - kBoxBits : 0;
      const auto low = static_cast<std::uint32_t>(node.low[axis] - parent.low[axis]) >> shift;
      const auto high = static_cast<std::uint32_t>(parent.high[axis] - node.high[axis]) >> shift;
      const std::uint32_t coded_low = low_[kind_][k].code(coder_, low);
      // A box that begins late mostly ends with its parent's.
      const std::size_t half = 4 * (coded_low << shift) > static_cast<std::uint32_t>(size) ? 1 : 0;
      const std::uint32_t coded_high = high_[kind_][k][half].code(coder_, high);
      node.low[axis] = parent.low[axis] + static_cast<std::int32_t>(coded_low << shift);
      node.high[axis] = parent.high[axis] - static_cast<std::int32_t>(coded_high << shift);
      if (node.low[axis] > node.high[axis]) return false;
    }
    return true;
  }

  // Both coordinates as differences, modulo 2^kAxisBits, from the parent's.
  void codeAxis(CodedNode& node, const CodedNode& parent) {
    constexpr std::int32_t kEnd = 1 << kAxisBits;
    for (std::size_t i = 0; i < 2; ++i) {
      const std::int32_t turn = (node.axis[i] - parent.axis[i] + kEnd + kEnd / 2) % kEnd - kEnd / 2;
      const std::uint32_t coded = static_cast<std::uint32_t>(parent.axis[i] + axis_[kind_][i].code(coder_, turn));
      node.axis[i] = static_cast<std::int32_t>(coded % kEnd);
    }
  }

  bool codeErrors(CodedNode& node, const CodedNode& parent) {
    if (node.isLeaf()) {
      node.errors = {};
      return true;
    }
    for (std::size_t i = 0; i < 3; ++i) {
      // The error of a picture's shape is bounded by the picture's own, the others by the parent's.
      const std::int32_t limit = parent.errors[i];
      // Before the first node of a depth its parent, twice as large, tells the most.
      const std::int32_t near = before_->isLeaf()
                                    ? std::max(parent.errors[i] - static_cast<std::int32_t>(kErrorSteps), 0)
                                    : before_->errors[i];
      if (!codeNear(errors_[i], near, limit, node.errors[i])) return false;
    }
    return true;
  }

  bool codeCounts(CodedNode& node) {
    if (!codeCount(triangles_[kind_], before_->triangles, kMaxPrimitives, node.triangles) ||
        !codeCount(points_[kind_], before_->points, kMaxPrimitives, node.points) ||
        !codeCount(edges_[kind_], before_->edges, std::min(kMaxPrimitives, 3 * node.triangles), node.edges))
      return false;
    if (node.isLeaf()) {
      node.caster_triangles = 0;
      return true;
    }
    return codeCount(caster_triangles_, before_->caster_triangles, kMaxPrimitives, node.caster_triangles);
  }

  bool codeLengths(CodedNode& node) {
    const auto pictured = [](const CodedNode& of) { return std::uint64_t{of.triangles} + of.points; };
    return codeBytes(picture_bytes_[kind_], pictured(node), pictured(*before_), before_->picture_bytes,
                     node.picture_bytes) &&
           codeBytes(caster_bytes_, node.caster_triangles, before_->caster_triangles, before_->caster_bytes,
                     node.caster_bytes);
  }

  // The length of a block, which is none where nothing is in it; expected is one like that of the node before.
  bool codeBytes(SignedModel& model, std::uint64_t count, std::uint64_t count_before, std::uint64_t bytes_before,
                 std::uint32_t& bytes) {
    if (count == 0) {
      bytes = 0;
      return true;
    }
    const std::uint64_t expected = count_before > 0 ? bytes_before * count / count_before : 4 * count;
    return codeCount(model, static_cast<std::uint32_t>(std::min<std::uint64_t>(expected, kMaxBlockBytes)),
                     kMaxBlockBytes, bytes) &&
           bytes > 0;
  }

  bool codeCount(SignedModel& model, std::uint32_t near, std::uint32_t limit, std::uint32_t& value) {
    auto coded = static_cast<std::int32_t>(value);
    const bool good = codeNear(model, static_cast<std::int32_t>(near), static_cast<std::int32_t>(limit), coded);
    value = static_cast<std::uint32_t>(coded);
    return good;
  }

  // A number 0 … limit as its difference from one that is near.
  bool codeNear(SignedModel& model, std::int32_t near, std::int32_t limit, std::int32_t& value) {
    const std::int64_t decoded = std::int64_t{near} + model.code(coder_, value - near);
    value = static_cast<std::int32_t>(decoded);
    return decoded >= 0 && decoded <= limit;
  }

  /// A model for each kind of node.
  template <class Model>
  using ByKind = std::array<Model, 2>;

  static CodedNode blank() {
    CodedNode node;
    node.angle = kFullAngle / 4;
    return node;
  }

  Coder& coder_;
  std::size_t kind_ = 0;
  const CodedNode* before_ = nullptr;
  std::array<ByKind<CodedNode>, kMaxDepth + 1> last_ = [] {
    std::array<ByKind<CodedNode>, kMaxDepth + 1> last;
    for (auto& both : last) both = {blank(), blank()};
    return last;
  }();
  std::array<SymbolModel<4>, kMaxDepth + 1> children_;
  ByKind<std::array<SymbolModel<kBoxBits>, 3>> low_;
  ByKind<std::array<std::array<SymbolModel<kBoxBits>, 2>, 3>> high_;
  ByKind<std::array<SignedModel, 2>> axis_;
  ByKind<SignedModel> angle_, triangles_, points_, edges_, picture_bytes_;
  ByKind<SymbolModel<5>> step_bits_;
  std::array<SignedModel, 3> errors_;
  SignedModel caster_triangles_, caster_bytes_;
};

CodedNode codedNode(const Node& node, const Lattice& lattice) {
  LUMIGRID_CHECK(!node.box.empty());
  LUMIGRID_CHECK(!node.isLeaf() || (node.error == 0.0F && node.caster_error == 0.0F && node.caster.bytes == 0));
  CodedNode coded;
  coded.children = node.children;
  for (int axis = 0; axis < 3; ++axis) {
    coded.low[axis] = latticeBelow(static_cast<double>(node.box.min[axis]), lattice, axis, kLatticeEnd + 1);
    coded.high[axis] = latticeAbove(static_cast<double>(node.box.max[axis]), lattice, axis, kLatticeEnd + 1);
  }
  const glm::u8vec2 axis = pmr::encodeNormal(node.cone.axis);
  coded.axis = {axis.x >> (8 - kAxisBits), axis.y >> (8 - kAxisBits)};
  coded.angle = angleCode(node.cone, axisOfCode(coded.axis));
  coded.errors = {errorCode(node.error, lattice), errorCode(node.shape_error, lattice),
                  errorCode(node.caster_error, lattice)};
  coded.step_bits = node.step_bits;
  coded.triangles = node.triangles, coded.points = node.points, coded.edges = node.edges;
  coded.picture_bytes = node.picture.bytes;
  coded.caster_triangles = node.isLeaf() ? 0 : node.caster_triangles;
  coded.caster_bytes = node.caster.bytes;
  return coded;
}

Node decodedNode(const CodedNode& coded, std::uint32_t first_child, const Lattice& lattice) {
  Node node;
  node.box = {lattice.position(coded.low), lattice.position(coded.high)};
  node.cone = {axisOfCode(coded.axis), cosineOfCode(coded.angle)};
  node.error = errorOfCode(coded.errors[0], lattice);
  node.shape_error = errorOfCode(coded.errors[1], lattice);
  node.caster_error = errorOfCode(coded.errors[2], lattice);
  node.children = static_cast<std::uint8_t>(coded.children);
  node.first_child = coded.isLeaf() ? 0 : first_child;
  node.step_bits = static_cast<std::uint8_t>(coded.step_bits);
  node.triangles = coded.triangles, node.points = coded.points, node.edges = coded.edges;
  node.caster_triangles = coded.caster_triangles;
  node.picture.bytes = coded.picture_bytes;
  node.caster.bytes = coded.caster_bytes;
  return node;
}

/// Makes boxes and errors of parents contain those of their children.
void widenParents(std::vector<CodedNode>& coded, const std::vector<Node>& nodes) {
  for (std::size_t i = nodes.size(); i-- > 0;) {
    CodedNode& parent = coded[i];
    for (std::uint32_t c = 0; c < nodes[i].children; ++c) {
      const CodedNode& child = coded[nodes[i].first_child + c];
      parent.low = glm::min(parent.low, child.low);
      parent.high = glm::max(parent.high, child.high);
      for (const std::size_t e : {0, 1, 2}) parent.errors[e] = std::max(parent.errors[e], child.errors[e]);
    }
  }
}

/// Finds the parents of nodes in their order. A root's parent has the header's box, and all else as wide as can be.
class Walk {
 public:
  Walk(const glm::ivec3& low, const glm::ivec3& high) { above_root_.low = low, above_root_.high = high; }

  /// The parent of the next node, whose depth is set; null where there is no next one.
  const CodedNode* next(const std::vector<CodedNode>& nodes, CodedNode& node) {
    if (nodes.empty()) return &above_root_;
    while (parent_ < nodes.size() && children_of_parent_ == nodes[parent_].children) ++parent_, children_of_parent_ = 0;
    if (parent_ == nodes.size()) return nullptr;
    ++children_of_parent_;
    node.depth = nodes[parent_].depth + 1;
    return &nodes[parent_];
  }

 private:
  CodedNode above_root_;
  std::size_t parent_ = 0;
  std::uint32_t children_of_parent_ = 0;
};

}  // namespace

base::Bytes tableBytes(const std::vector<Node>& nodes, Header& header) {
  LUMIGRID_CHECK(!nodes.empty());
  std::vector<CodedNode> coded;
  for (const Node& node : nodes) coded.push_back(codedNode(node, header.lattice));
  widenParents(coded, nodes);
  header.nodes = static_cast<std::uint32_t>(nodes.size());
  header.low = coded.front().low, header.high = coded.front().high;
  header.bounds = boundsOf(header.low, header.high, header.lattice);

  RangeEncoder encoder;
  NodeModel<RangeEncoder> model(encoder);
  Walk walk(header.low, header.high);
  std::vector<CodedNode> done;  // as a reader has them
  done.reserve(coded.size());
  for (CodedNode& node : coded) {
    const CodedNode* parent = walk.next(done, node);
    LUMIGRID_CHECK(parent != nullptr && model.code(node, *parent));
    done.push_back(node);
  }
  base::ByteWriter out;
  out.bytes(encoder.finish());
  while (out.size() + sizeof(std::uint32_t) < kMinNodeBytes * nodes.size()) out.u8(0);
  out.u32(base::crc32c(out.view()));
  header.table_bytes = static_cast<std::uint32_t>(out.size());
  return out.takeBytes();
}

base::Result<std::vector<Node>> readTable(const Header& header, base::ByteView table) {
  if (table.size() != header.table_bytes || table.size() / kMinNodeBytes < header.nodes)
    return damaged("table: cut short");
  const base::ByteView coded_bytes = table.first(table.size() - sizeof(std::uint32_t));
  std::uint32_t crc = 0;
  std::memcpy(&crc, table.data() + coded_bytes.size(), sizeof(crc));
  if (crc != base::crc32c(coded_bytes)) return damaged("table: checksum does not match");

  RangeDecoder decoder(coded_bytes);
  NodeModel<RangeDecoder> model(decoder);
  Walk walk(header.low, header.high);
  // They grow with what is decoded: a file's own word for the number of nodes takes no memory.
  std::vector<CodedNode> coded;
  std::vector<Node> nodes;
  std::uint64_t known = 1, source_triangles = 0;
  for (std::uint32_t i = 0; i < header.nodes; ++i) {
    const std::string place = "table: node " + std::to_string(i) + ": ";
    CodedNode node;
    const CodedNode* parent = walk.next(coded, node);
    if (parent == nullptr) return damaged(place + "it is nobody's child");
    if (!model.code(node, *parent)) return damaged(place + "its numbers cannot be");
    coded.push_back(node);
    nodes.push_back(decodedNode(node, static_cast<std::uint32_t>(known), header.lattice));
    known += node.children;
    if (known > header.nodes) return damaged(place + "it has more children than there are nodes");
    source_triangles += node.isLeaf() ? node.triangles : 0;
  }

  Header placed = header;
  placeBlocks(placed, nodes);
  if (known != header.nodes || source_triangles != header.source_triangles || placed.file_bytes != header.file_bytes)
    return damaged("table: it contradicts the header");
  return nodes;
}

}  // namespace lod::hlod
