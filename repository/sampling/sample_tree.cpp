#include "repository/sampling/sample_tree.h"

#include <algorithm>
#include <string>
#include <utility>

#include "base/check.h"
#include "base/crc32c.h"

namespace repository {
namespace {

constexpr std::uint8_t kMagic = 'T';
// The lower bits of a point's code are 0: direction and tile.
constexpr unsigned kPointShift = kTileBits + 3;
constexpr std::uint64_t kMaxPoint = (std::uint64_t{1} << 48) - 1;

base::Error damaged(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, "the tree of sampling points " + problem};
}

// Packs values of two bits, the first one into the lowest bits.
class TwoBitWriter {
 public:
  void put(std::uint8_t value) {
    if (used_ % 4 == 0) bytes_.push_back(0);
    bytes_.back() = static_cast<std::uint8_t>(bytes_.back() | value << (2 * (used_ % 4)));
    ++used_;
  }
  const base::Bytes& bytes() const { return bytes_; }

 private:
  base::Bytes bytes_;
  std::size_t used_ = 0;
};

class TwoBitReader {
 public:
  explicit TwoBitReader(base::ByteView bytes) : bytes_(bytes) {}
  /// Returns 3, which is no state, behind the end.
  std::uint8_t get() {
    if (at_ / 4 >= bytes_.size()) return 3;
    const auto value = static_cast<std::uint8_t>(bytes_[at_ / 4] >> (2 * (at_ % 4)) & 3);
    ++at_;
    return value;
  }
  /// Whether everything was read except the last byte's unused bits, which must be 0.
  bool atEnd() const {
    return (at_ + 3) / 4 == bytes_.size() && (at_ % 4 == 0 || bytes_.back() >> (2 * (at_ % 4)) == 0);
  }

 private:
  base::ByteView bytes_;
  std::size_t at_ = 0;
};

}  // namespace

SampleTree::SampleTree(const Grid& grid) : count_(grid.count) {
  const std::uint32_t cells = std::max({count_.x, count_.y, count_.z}) - 1;
  while (root_size_ < cells) root_size_ *= 2;
}

SampleTree::SampleTree(const Grid& grid, std::uint32_t size) : SampleTree(grid) {
  LUMIGRID_CHECK(size > 0 && (size & (size - 1)) == 0);
  divideTo(size, 0, root_size_, glm::uvec3(0));
}

void SampleTree::divideTo(std::uint32_t size, std::uint32_t node, std::uint32_t node_size, const glm::uvec3& corner) {
  if (node_size <= size || outside(corner)) return;
  divide(node);
  for (std::uint32_t child = 0; child < 8; ++child)
    divideTo(size, nodes_[node].children + child, node_size / 2, childCorner(corner, node_size / 2, child));
}

bool SampleTree::outside(const glm::uvec3& corner) const {
  return corner.x + 1 >= count_.x || corner.y + 1 >= count_.y || corner.z + 1 >= count_.z;
}

void SampleTree::divide(std::uint32_t node) {
  const auto children = static_cast<std::uint32_t>(nodes_.size());
  nodes_.resize(nodes_.size() + 8);
  nodes_[node] = {State::kSplit, children};
}

std::uint32_t SampleTree::descend(const glm::uvec3& cell, Cell& at) const {
  std::uint32_t node = 0;
  at = {glm::uvec3(0), root_size_};
  while (nodes_[node].state == State::kSplit) {
    at.size /= 2;
    const glm::uvec3 far = (cell - at.corner) / at.size;
    node = nodes_[node].children + (far.x | far.y << 1 | far.z << 2);
    at.corner += at.size * far;
  }
  return node;
}

SampleTree::Cell SampleTree::leafOf(const glm::uvec3& cell) const {
  LUMIGRID_CHECK(!outside(cell));
  Cell leaf;
  descend(cell, leaf);
  return leaf;
}

SampleTree::Node& SampleTree::find(const Cell& leaf) {
  Cell at;
  Node& node = nodes_[descend(leaf.corner, at)];
  LUMIGRID_CHECK(at == leaf && node.state == State::kOpen);
  return node;
}

std::array<glm::uvec3, 8> SampleTree::cornersOf(const Cell& cell) const {
  std::array<glm::uvec3, 8> corners;
  for (std::uint32_t i = 0; i < 8; ++i) corners[i] = glm::min(childCorner(cell.corner, cell.size, i), count_ - 1U);
  return corners;
}

template <class Visit>
void SampleTree::visit(std::uint32_t node, const Cell& cell, const Visit& leaf) const {
  if (outside(cell.corner)) return;
  if (nodes_[node].state != State::kSplit) return leaf(cell, nodes_[node].state);
  for (std::uint32_t child = 0; child < 8; ++child)
    visit(nodes_[node].children + child, {childCorner(cell.corner, cell.size / 2, child), cell.size / 2}, leaf);
}

std::vector<glm::uvec3> SampleTree::points() const {
  std::vector<std::uint64_t> codes;
  visit(0, {glm::uvec3(0), root_size_}, [&](const Cell& cell, State) {
    for (const glm::uvec3& corner : cornersOf(cell)) codes.push_back(codeOfPoint(corner));
  });
  std::sort(codes.begin(), codes.end());
  codes.erase(std::unique(codes.begin(), codes.end()), codes.end());
  std::vector<glm::uvec3> points;
  points.reserve(codes.size());
  for (const std::uint64_t code : codes) {
    if (left_out_.count(code) != 0) continue;
    const FaceKey key = *FaceKey::fromCode(code);
    points.emplace_back(key.x, key.y, key.z);
  }
  return points;
}

std::vector<SampleTree::Cell> SampleTree::openLeaves() const {
  std::vector<Cell> open;
  visit(0, {glm::uvec3(0), root_size_}, [&](const Cell& cell, State state) {
    if (state == State::kOpen && cell.size > 1) open.push_back(cell);
  });
  return open;
}

void SampleTree::split(const Cell& leaf) {
  LUMIGRID_CHECK(leaf.size > 1);
  divide(static_cast<std::uint32_t>(&find(leaf) - nodes_.data()));
}

void SampleTree::close(const Cell& leaf) {
  find(leaf).state = State::kClosed;
}

void SampleTree::leaveOut(const glm::uvec3& point) {
  LUMIGRID_CHECK(!glm::any(glm::greaterThanEqual(point, count_)));
  left_out_.insert(codeOfPoint(point));
}

base::Bytes SampleTree::encode(Form form) const {
  // Nodes outside of the grid are not encoded.
  TwoBitWriter states;
  std::vector<std::pair<std::uint32_t, Cell>> open{{0, {glm::uvec3(0), root_size_}}};
  while (!open.empty()) {
    const auto [node, cell] = open.back();
    open.pop_back();
    if (outside(cell.corner)) continue;
    states.put(static_cast<std::uint8_t>(nodes_[node].state));
    if (nodes_[node].state != State::kSplit) continue;
    for (std::uint32_t child = 8; child-- > 0;)
      open.push_back({nodes_[node].children + child, {childCorner(cell.corner, cell.size / 2, child), cell.size / 2}});
  }
  std::vector<std::uint64_t> left_out(left_out_.begin(), left_out_.end());
  std::sort(left_out.begin(), left_out.end());

  base::ByteWriter out;
  out.u8(kMagic);
  out.u8(static_cast<std::uint8_t>(form));
  out.u32(static_cast<std::uint32_t>(states.bytes().size()));
  out.u32(static_cast<std::uint32_t>(left_out.size()));
  out.bytes(states.bytes());
  for (std::size_t i = 0; i < left_out.size(); ++i) {
    if (form == Form::kStored)
      out.u64(left_out[i]);
    else
      out.varint((left_out[i] - (i > 0 ? left_out[i - 1] : 0)) >> kPointShift);
  }
  out.u32(base::crc32c(out.view()));
  return base::Bytes(out.view().begin(), out.view().end());
}

base::Result<SampleTree> SampleTree::decode(const Grid& grid, base::ByteView bytes) {
  if (grid.count.x < 2 || grid.count.y < 2 || grid.count.z < 2) return damaged("belongs to a grid without cells");
  base::ByteReader in(bytes);
  if (in.u8() != kMagic) return damaged("does not begin as one");
  const std::uint8_t version = in.u8();
  const bool is_stored = version == static_cast<std::uint8_t>(Form::kStored);
  if (in.ok() && !is_stored && version != static_cast<std::uint8_t>(Form::kPublished))
    return base::Error{base::ErrorCode::kVersion, "the tree of sampling points has version " + std::to_string(version) +
                                                      ", this program reads 1 and 2; update it"};
  const std::uint32_t state_bytes = in.u32();
  const std::uint32_t left_out = in.u32();
  const std::uint64_t least = std::uint64_t{state_bytes} + (is_stored ? 8 : 1) * std::uint64_t{left_out} + 4;
  if (!in.ok() || in.remaining() < least || (is_stored && in.remaining() != least))
    return damaged("is cut short, or longer than it says");
  base::ByteReader end(bytes.last(4));
  if (end.u32() != base::crc32c(bytes.first(bytes.size() - 4))) return damaged("has a wrong checksum");
  TwoBitReader states(in.bytes(state_bytes));

  SampleTree tree(grid);
  std::vector<std::pair<std::uint32_t, Cell>> open{{0, {glm::uvec3(0), tree.root_size_}}};
  while (!open.empty()) {
    const auto [node, cell] = open.back();
    open.pop_back();
    if (tree.outside(cell.corner)) continue;
    const std::uint8_t state = states.get();
    if (state > 2) return damaged("ends within its cells");
    if (state != 2) {
      tree.nodes_[node].state = static_cast<State>(state);
      continue;
    }
    if (cell.size == 1) return damaged("splits a cell of one step");
    tree.divide(node);
    for (std::uint32_t child = 8; child-- > 0;)
      open.push_back(
          {tree.nodes_[node].children + child, {childCorner(cell.corner, cell.size / 2, child), cell.size / 2}});
  }
  if (!states.atEnd()) return damaged("goes on behind its last cell");
  std::uint64_t last = 0;
  for (std::uint32_t i = 0; i < left_out; ++i) {
    const std::uint64_t steps = is_stored ? 0 : in.varint();
    if (steps > kMaxPoint) return damaged("leaves out a point that is not of its grid, or twice");
    const std::uint64_t code = is_stored ? in.u64() : last + (steps << kPointShift);
    const auto key = FaceKey::fromCode(code);
    if (!key || key->d != 0 || !grid.contains(*key) || (i > 0 && code <= last))
      return damaged("leaves out a point that is not of its grid, or twice");
    last = code;
    tree.left_out_.insert(code);
  }
  if (!in.ok() || in.remaining() != 4) return damaged("is cut short, or longer than it says");
  return tree;
}

}  // namespace repository
