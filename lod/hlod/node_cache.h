#pragma once
// Keeps the blocks, pictures and casters of nodes up to a number of bytes.
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "lod/hlod/stream.h"

namespace lod::hlod {

/// State of a node's picture, or of its caster.
struct NodeState {
  base::Bytes block;  ///< waits to be decoded; none for the caster of a leaf, which is made of the picture's
  std::shared_ptr<const NodePicture> picture;
  std::shared_ptr<const CasterPicture> caster;
  std::uint32_t known_cost = 0;   ///< memory of the picture or caster since it was decoded once; 0 before
  std::uint32_t used = 0;         ///< the last frame whose plan has it
  std::uint32_t needed = 0;       ///< the last frame in which a caster was to be decoded from the block
  std::uint32_t kept = 0;         ///< the last frame in which the block came
  std::uint32_t last_wanted = 0;  ///< the number of the last view that wanted it
  float error_px = 0.0F;          ///< in the frame `used`
  std::uint8_t damages = 0;       ///< how often the block came damaged
  bool is_requested = false;
  bool is_given_up = false;
  bool is_refined = false;  ///< in the frame `used`: those of its children that may be seen are planned, too
  bool is_covered = false;  ///< in that frame: what is here shows all of the node
};

/// Parts are numbered as their blocks lie in the file: part i is the picture of node i, and part nodes + i its caster.
class NodeCache {
 public:
  /// `is_local`: all blocks can be read at any time, and none is kept.
  NodeCache(std::span<const Node> nodes, std::uint64_t limit, bool is_local);

  NodeState& operator[](std::uint32_t part) { return states_[part]; }
  const NodeState& operator[](std::uint32_t part) const { return states_[part]; }
  std::span<const NodeState> states() const { return states_; }
  std::uint32_t parts() const { return static_cast<std::uint32_t>(states_.size()); }
  std::uint32_t casterOf(std::uint32_t node) const { return static_cast<std::uint32_t>(nodes_.size()) + node; }
  bool isCaster(std::uint32_t part) const { return part >= nodes_.size(); }
  std::uint32_t nodeOf(std::uint32_t part) const { return isCaster(part) ? part - casterOf(0) : part; }
  /// The part whose block a node's caster is decoded from: a leaf's is its picture.
  std::uint32_t sourceOfCaster(std::uint32_t node) const { return nodes_[node].isLeaf() ? node : casterOf(node); }
  const BlockPlace& placeOf(std::uint32_t part) const {
    const Node& node = nodes_[nodeOf(part)];
    return isCaster(part) ? node.caster : node.picture;
  }
  std::uint64_t bytes() const { return bytes_; }
  std::uint64_t pictures() const { return pictures_; }
  std::uint64_t limit() const { return limit_; }
  /// The next evict() keeps it.
  void setLimit(std::uint64_t limit) { limit_ = limit; }

  /// Whether the part is here or its block can be decoded now.
  bool has(std::uint32_t part) const;
  /// Memory of the part when it is decoded, which takes the block's place.
  std::uint64_t costOf(std::uint32_t part) const;

  void keepBlock(std::uint32_t part, base::ByteView bytes, std::uint32_t frame);
  /// The part's own block is dropped.
  void keepPicture(std::shared_ptr<const NodePicture> picture);
  void keepCaster(std::shared_ptr<const CasterPicture> caster);
  /// Forgets a damaged part for good.
  void giveUp(std::uint32_t part);

  /// Drops what was not used for the longest time until the limit is kept: first parts that frame `frame` has not
  /// planned, then those of its plan: refined pictures from the last one on, casters, and the other pictures.
  void evict(std::uint32_t frame, std::span<const std::uint32_t> pictures, std::span<const std::uint32_t> casters);

 private:
  void drop(std::uint32_t part);
  void keep(std::uint32_t part, std::uint64_t bytes);
  void evictUnused(std::uint32_t frame, std::uint64_t target);

  std::span<const Node> nodes_;
  std::uint64_t limit_;
  const bool is_local_;
  std::vector<NodeState> states_;
  std::uint64_t bytes_ = 0;
  std::uint64_t pictures_ = 0;
};

}  // namespace lod::hlod
