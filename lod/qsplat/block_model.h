#pragma once
// The symbols of a coded block and the contexts that predict them (docs/formats/qsplat.md, "The coded form"). Writing
// and reading use the same code. It computes in whole numbers only, so that every reader predicts what the writer did.
//
// A Coder has `std::uint32_t code(std::uint32_t context, std::uint32_t symbol)`. A writing coder writes the symbol and
// returns it; a reading one ignores the argument and returns the symbol that it reads.
#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>

#include "lod/qsplat/code_tables.h"
#include "lod/qsplat/format.h"

namespace lod::qsplat {

/// Returns the tangents at the middles of a face's 52 cells, in 1024ths.
const std::array<int, kNormalSide>& cellTangents();

template <class Coder>
class BlockModel {
 public:
  BlockModel(Coder& coder, bool colors) : coder_(coder), colors_(colors) {}

  /// Codes the block's next group: writes it, or sets it to what is read. False when an impossible group is read.
  bool code(GroupNodes& group) {
    const std::uint32_t kind = coder_.code(kGroupKind.first + (last_.count == 0 ? 8 : kindOf(last_)), kindOf(group));
    group.count = kind / 2 + 1;
    group.has_pointer = kind % 2 != 0;
    siblings_.count = 0;
    middles_ = {};
    for (std::uint32_t i = 0; i < group.count; ++i)
      if (!codeNode(group, i)) return false;
    siblings_.has_pointer = group.has_pointer;
    std::swap(siblings_, last_);
    return true;
  }

 private:
  static constexpr int kSide = static_cast<int>(kNormalSide);
  struct NormalCell {
    int face = 0;  ///< 0 … 5; axis face / 2
    int row = 0, column = 0;
  };
  /// The fields of a node as they are coded.
  struct NodeFields {
    std::uint32_t cone = 0;   ///< cone code; for a leaf in a group of leaves, the class of its width
    std::uint32_t width = 0;  ///< cone code of a leaf in a group of leaves, or the nearest to it
    std::uint32_t children_kind = 0;
    NormalCell normal;
    std::array<int, 3> middle{};  ///< sphere's centre s + 2 cell − 13, thirteenths from the parent's
    int s = 0;
    std::array<int, 3> color{};  ///< 5, 6 and 5 bits
  };
  struct Siblings {
    std::uint32_t count = 0;
    bool has_pointer = false;
    std::array<NodeFields, kMaxChildren> fields;
  };

  template <class Group>
  static std::uint32_t kindOf(const Group& group) {
    return group.count == 0 ? 0 : 2 * (group.count - 1) + (group.has_pointer ? 1 : 0);
  }
  /// Returns 0 for a leaf; 1, 2, 3 for two, three, four children; 4, 5, 6 for the same, all of them leaves.
  static std::uint32_t childrenKindOf(const Node& node) {
    return node.isLeaf() ? 0 : node.children() - 1 + (node.childrenAreLeaves() ? 3 : 0);
  }
  /// Maps a value of −count … 2 count − 1 to 0 … count − 1, on a ring.
  static int wrap(int value, int count) { return value < 0 ? value + count : value < count ? value : value - count; }
  /// Returns sum / count, rounded; sum: 0 … 255, count: 1 … 4.
  static int mean(int sum, std::uint32_t count) {
    constexpr std::array<int, 5> kInverse{0, 32768, 16384, 10923, 8192};  // 1 / (2 count) in 65536ths, rounded up
    return ((2 * sum + number(count)) * kInverse[count]) >> 16;
  }
  /// Classifies a difference on a ring of `count` into seven magnitudes.
  static std::uint32_t magnitude(int on_ring, int count) {
    const int size = std::min(on_ring, count - on_ring);
    return size <= 2 ? static_cast<std::uint32_t>(size) : size <= 4 ? 3 : size <= 8 ? 4 : size <= 14 ? 5 : 6;
  }
  static std::uint32_t index(int value) { return static_cast<std::uint32_t>(value); }
  static int number(std::uint32_t value) { return static_cast<int>(value); }

  bool codeNode(GroupNodes& group, std::uint32_t i) {
    Node& node = group.nodes[i];
    NodeFields fields;
    codeChildren(group, i, fields);
    group.has_pointer ? codeCone(node, i, fields) : codeLeafCone(node, i, fields);
    codeNormal(node, i, fields);
    const std::uint32_t sphere = codeSphere(node, i, fields);
    if (sphere >= kSphereCodes) return false;
    if (colors_) codeColor(node, i, fields);
    const auto& [face, row, column] = fields.normal;
    const std::uint32_t normal = index((face * kSide + row) * kSide + column);
    const std::uint32_t children = fields.children_kind == 0 ? 0 : (fields.children_kind - 1) % 3 + 2;
    node.bits = group.has_pointer ? packNode(sphere, normal, fields.cone, children, fields.children_kind > 3)
                                  : packLeaf(sphere, normal, fields.width);
    node.color = static_cast<std::uint16_t>(fields.color[0] << 11 | fields.color[1] << 5 | fields.color[2]);
    siblings_.fields[i] = fields;
    siblings_.count = i + 1;
    for (std::size_t axis = 0; axis < 3; ++axis) middles_[axis] += fields.middle[axis];
    return true;
  }

  /// Returns the node before in the block, or null at the block's beginning.
  const NodeFields* before(std::uint32_t i) const {
    if (i > 0) return &siblings_.fields[i - 1];
    return last_.count > 0 ? &last_.fields[last_.count - 1] : nullptr;
  }
  /// Returns the sibling before; for a first node the first one of the group before, or null.
  const NodeFields* beside(std::uint32_t i) const {
    if (i > 0) return &siblings_.fields[i - 1];
    return last_.count > 0 ? &last_.fields[0] : nullptr;
  }
  /// Returns the nodes whose normals and colours are averaged: the siblings so far, or the group before.
  const Siblings& examples(std::uint32_t i) const { return i > 0 ? siblings_ : last_; }

  void codeChildren(const GroupNodes& group, std::uint32_t i, NodeFields& fields) {
    if (!group.has_pointer) return;
    const NodeFields* last = before(i);
    const std::uint32_t context = ((last ? last->children_kind : 7) * 2 + (i == 0 ? 1 : 0)) * 4 + group.count - 1;
    fields.children_kind = coder_.code(kChildrenKind.first + context, childrenKindOf(group.nodes[i]));
  }

  /// Returns the sibling two before; for a first node the first one of the group before; or null.
  const NodeFields* other(std::uint32_t i) const {
    return i > 1 ? &siblings_.fields[i - 2] : i == 0 ? beside(0) : nullptr;
  }

  void codeCone(const Node& node, std::uint32_t i, NodeFields& fields) {
    const NodeFields* last = before(i);
    const NodeFields* also = other(i);
    const std::uint32_t generation = fields.children_kind == 0 ? 0 : fields.children_kind > 3 ? 1 : 2;
    const std::uint32_t context = ((last ? last->cone : 4) * 3 + generation) * 5 + (also ? also->cone : 4);
    fields.cone = coder_.code(kConeKind.first + context, node.coneCode());
    fields.width = 8 * fields.cone + 7;
  }

  /// Predicts the width from the mean of two nodes before.
  void codeLeafCone(const Node& node, std::uint32_t i, NodeFields& fields) {
    constexpr std::array<std::uint8_t, kLeafConeCodes> kContext{0, 1, 2, 3, 4, 4, 5, 5, 6, 6, 6, 6, 7,  7,  7,  7,
                                                                8, 8, 8, 8, 8, 8, 9, 9, 9, 9, 9, 9, 10, 10, 10, 11};
    const NodeFields* last = before(i);
    const NodeFields* also = other(i);
    const std::uint32_t width = last == nullptr   ? 0
                                : also == nullptr ? last->width
                                                  : (last->width + also->width + 1) / 2;
    fields.width = coder_.code(kLeafConeKind.first + kContext[width], node.coneField());
    // Classes by sines up to 1/16, 4/16, 9/16, the paper's codes.
    fields.cone = fields.width < 2 ? 0 : fields.width < 8 ? 1 : fields.width < 18 ? 2 : 3;
  }

  // ---- normals ----

  /// The axes along which a face's rows and columns count.
  static int rowAxis(int face) { return face / 2 == 0 ? 1 : 0; }
  static int columnAxis(int face) { return face / 2 == 2 ? 1 : 2; }

  /// Returns the cell of `face` that is nearest to a normal, from the cell numbers alone.
  static NormalCell onFace(const NormalCell& normal, int face) {
    if (face == normal.face) return normal;
    std::array<int, 3> cell{};
    cell[index(rowAxis(normal.face))] = normal.row;
    cell[index(columnAxis(normal.face))] = normal.column;
    if (face / 2 != normal.face / 2) cell[index(normal.face / 2)] = normal.face % 2 == 0 ? kSide - 1 : 0;
    return {face, cell[index(rowAxis(face))], cell[index(columnAxis(face))]};
  }
  /// Returns the mean of the examples' normals on that face.
  NormalCell meanNormal(std::uint32_t i, int face) const {
    const Siblings& nodes = examples(i);
    if (nodes.count == 0) return {face, kSide / 2, kSide / 2};
    NormalCell sum{face, 0, 0};
    for (std::uint32_t k = 0; k < nodes.count; ++k) {
      const NormalCell there = onFace(nodes.fields[k].normal, face);
      sum.row += there.row;
      sum.column += there.column;
    }
    return {face, mean(sum.row, nodes.count), mean(sum.column, nodes.count)};
  }

  void codeNormal(const Node& node, std::uint32_t i, NodeFields& fields) {
    const int code = static_cast<int>(node.normalCode());
    const NormalCell truth{code / (kSide * kSide), code / kSide % kSide, code % kSide};
    const Siblings& nodes = examples(i);
    const int likely = nodes.count > 0 ? nodes.fields[nodes.count - 1].normal.face : 0;
    const NormalCell likely_mean = meanNormal(i, likely);
    const int face = codeFace(likely_mean, fields.cone, truth.face);

    const bool same = face == likely;
    const NormalCell near = same ? likely_mean : meanNormal(i, face);
    const std::uint32_t rough = std::min(3U, last_turn_ / 2);
    const std::uint32_t row_context = same ? ((i == 0 ? 4 : 0) + rough) * 4 + fields.cone : 32;
    const int row = number(coder_.code(kRowKind.first + row_context, index(wrap(truth.row - near.row, kSide))));
    const std::uint32_t column_context = same ? magnitude(row, kSide) * 4 + fields.cone : 28;
    const int column =
        number(coder_.code(kColumnKind.first + column_context, index(wrap(truth.column - near.column, kSide))));
    fields.normal = {face, wrap(near.row + row, kSide), wrap(near.column + column, kSide)};
    last_turn_ = magnitude((std::min(row, kSide - row) + std::min(column, kSide - column) + 1) / 2, kSide);
  }

  /// Codes a normal's face: 0 for the face of the mean, 1 for the one across its nearest edge, then the others in
  /// order.
  int codeFace(const NormalCell& mean, std::uint32_t cone, int truth) {
    const int last = kSide - 1;
    const bool by_row = std::min(mean.row, last - mean.row) <= std::min(mean.column, last - mean.column);
    const int at = by_row ? mean.row : mean.column;
    const bool at_least = at <= last - at;
    const int across = 2 * (by_row ? rowAxis(mean.face) : columnAxis(mean.face)) + (at_least ? 1 : 0);
    constexpr std::array<std::uint8_t, kSide / 2> kNear{0, 0, 1, 1, 2, 2, 2, 3, 3, 3, 3, 3, 3,
                                                        4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4};
    const std::uint32_t near = kNear[index(at_least ? at : last - at)];

    const auto among_others = [&](int face) { return face - (face > mean.face ? 1 : 0) - (face > across ? 1 : 0); };
    const int symbol = truth == mean.face ? 0 : truth == across ? 1 : 2 + among_others(truth);
    const int coded = number(coder_.code(kFaceKind.first + near * 4 + cone, index(symbol)));
    if (coded == 0) return mean.face;
    if (coded == 1) return across;
    int face = coded - 2;
    if (face >= std::min(mean.face, across)) ++face;
    if (face >= std::max(mean.face, across)) ++face;
    return face;
  }

  // ---- spheres ----

  /// Returns the sphere's code; kSphereCodes when an impossible sphere is read.
  std::uint32_t codeSphere(const Node& node, std::uint32_t i, NodeFields& fields) {
    const GridSphere truth = codes_.sphere(node.sphereCode());
    const NodeFields* other = beside(i);
    const std::uint32_t size_context =
        ((i == 0 ? 14 : 0) + (other ? index(other->s) : 0)) * 2 + (fields.children_kind == 0 ? 1 : 0);
    const int s = 1 + number(coder_.code(kSizeKind.first + size_context, index(truth.s - 1)));

    // First the two axes along the surface, then the one across it, which the plane through the siblings predicts best.
    const auto across = index(fields.normal.face / 2);
    GridSphere read{s, {}};
    for (const int axis : {rowAxis(fields.normal.face), columnAxis(fields.normal.face)}) {
      int& cell = read.cell[index(axis)];
      cell = number(coder_.code(kSideKind.first + index(s - 1) * 4 + sideOfSiblings(i, index(axis)),
                                index(truth.cell[index(axis)])));
      fields.middle[index(axis)] = s + 2 * cell - kSphereSteps;
    }
    const int expected = cellOnPlane(i, s, fields);
    const int cells = kSphereSteps + 1 - s;
    const std::uint32_t depth_context = ((i == 0 ? 4 : 0) + fields.cone) * kSphereSteps + index(s - 1);
    const int depth =
        number(coder_.code(kDepthKind.first + depth_context, index(wrap(truth.cell[across] - expected, cells))));
    if (depth >= cells) return kSphereCodes;
    read.cell[across] = wrap(expected + depth, cells);
    fields.middle[across] = s + 2 * read.cell[across] - kSphereSteps;
    fields.s = s;
    return codes_.code(read);
  }

  /// Returns 0 without siblings, else where they are on average: 1, 2, 3 for below, near and above the middle.
  std::uint32_t sideOfSiblings(std::uint32_t i, std::size_t axis) const {
    if (i == 0) return 0;
    const int sum = middles_[axis];
    const int near = 2 * number(i);
    return sum < -near ? 1 : sum <= near ? 2 : 3;
  }

  /// Returns the cell across the surface whose sphere lies nearest to the plane across the node's normal through the
  /// mean of its siblings; without siblings, through the parent's centre.
  int cellOnPlane(std::uint32_t i, int s, const NodeFields& fields) const {
    const NormalCell& n = fields.normal;
    const auto along = [&](int axis) {
      const auto a = index(axis);
      return std::max(number(i), 1) * fields.middle[a] - middles_[a];
    };
    const int up = n.face % 2 == 0 ? 1 : -1;
    const int over = up * (up * 1024 * middles_[index(n.face / 2)] - tangents_[index(n.row)] * along(rowAxis(n.face)) -
                           tangents_[index(n.column)] * along(columnAxis(n.face)));
    // The sphere's centre is at over / (1024 i) thirteenths from the parent's; cell = (middle + 13 − s) / 2, rounded.
    const int siblings = std::max(number(i), 1);
    const int doubled = over + (kSphereSteps + 1 - s) * 1024 * siblings;
    constexpr std::array<int, 4> kInverse{0, 65536, 32768, 21846};  // 1 / siblings in 65536ths, rounded up
    const int cell = doubled < 0 ? 0 : (doubled / 2048 * kInverse[index(siblings)]) >> 16;
    return std::min(cell, kSphereSteps - s);
  }

  // ---- colours ----

  static std::array<int, 3> channels(std::uint16_t color) { return {color >> 11, color >> 5 & 63, color & 31}; }

  std::array<int, 3> meanColor(std::uint32_t i) const {
    const Siblings& nodes = examples(i);
    if (nodes.count == 0) return {16, 32, 16};
    std::array<int, 3> color{};
    for (std::size_t c = 0; c < 3; ++c) {
      for (std::uint32_t k = 0; k < nodes.count; ++k) color[c] += nodes.fields[k].color[c];
      color[c] = mean(color[c], nodes.count);
    }
    return color;
  }

  /// Codes green as a difference to the examples' mean, red and blue as differences beyond half of green's.
  void codeColor(const Node& node, std::uint32_t i, NodeFields& fields) {
    const std::array<int, 3> truth = channels(node.color);
    const std::array<int, 3> near = meanColor(i);
    const std::uint32_t green_context = (i == 0 ? 7 : 0) + last_green_;
    const int green = number(coder_.code(kGreenKind.first + green_context, index((truth[1] - near[1]) & 63)));
    fields.color[1] = (near[1] + green) & 63;
    last_green_ = magnitude(green, 64);

    const int half = (fields.color[1] - near[1]) >> 1;
    const int red = number(coder_.code(kRedKind.first + last_green_, index((truth[0] - near[0] - half) & 31)));
    fields.color[0] = (near[0] + half + red) & 31;
    const int signed_red = red < 16 ? red : red - 32;
    const std::uint32_t blue_context = index(std::clamp(signed_red, -3, 3) + 3);
    const int blue = number(coder_.code(kBlueKind.first + blue_context, index((truth[2] - near[2] - half) & 31)));
    fields.color[2] = (near[2] + half + blue) & 31;
  }

  Coder& coder_;
  const bool colors_;
  const SphereCodes& codes_ = sphereCodes();
  const std::array<int, kNormalSide>& tangents_ = cellTangents();
  Siblings siblings_;                             ///< siblings in the group that is being coded, so far
  Siblings last_;                                 ///< the group before
  std::array<int, 3> middles_{};                  ///< sums over siblings_
  std::uint32_t last_turn_ = 3, last_green_ = 3;  ///< magnitudes
};

}  // namespace lod::qsplat
