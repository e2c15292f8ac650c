#pragma once
// Keeps the blocks and pictures of nodes up to a number of bytes.
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "lod/hlod/stream.h"

namespace lod::hlod {

/// State of a node.
struct NodeState {
  base::Bytes block;  ///< waits to be decoded
  std::shared_ptr<const NodePicture> picture;
  std::uint32_t known_cost = 0;  ///< memory of the picture since it was decoded once; 0 before
  std::uint32_t used = 0;        ///< the last frame whose plan has the node
  float error_px = 0.0F;         ///< in that frame
  std::uint8_t damages = 0;      ///< how often the block came damaged
  bool is_requested = false;
  bool is_given_up = false;
  bool is_refined = false;  ///< in the frame `used`: those of its children that may be seen are planned, too
  bool is_covered = false;  ///< in that frame: what is here shows all of the node
};

class NodeCache {
 public:
  /// `is_local`: all blocks can be read at any time, and none is kept.
  NodeCache(std::span<const Node> nodes, std::uint64_t limit, bool is_local);

  NodeState& operator[](std::uint32_t node) { return states_[node]; }
  const NodeState& operator[](std::uint32_t node) const { return states_[node]; }
  std::span<const NodeState> states() const { return states_; }
  std::uint64_t bytes() const { return bytes_; }
  std::uint64_t pictures() const { return pictures_; }
  std::uint64_t limit() const { return limit_; }

  /// Whether the picture is here or can be decoded now.
  bool has(std::uint32_t node) const;
  /// Memory of the node: of its picture, which takes the block's place.
  std::uint64_t costOf(std::uint32_t node) const;

  void keepBlock(std::uint32_t node, base::ByteView bytes);
  /// The block is dropped.
  void keepPicture(std::shared_ptr<const NodePicture> picture);
  /// Forgets a damaged node for good.
  void giveUp(std::uint32_t node);

  /// Drops what was not used for the longest time until the limit is kept: first nodes that frame `frame` has not
  /// planned, then those of its plan from the last one on, refined ones first.
  void evict(std::uint32_t frame, std::span<const std::uint32_t> plan);

 private:
  void drop(std::uint32_t node);
  void evictUnused(std::uint32_t frame, std::uint64_t target);

  std::span<const Node> nodes_;
  const std::uint64_t limit_;
  const bool is_local_;
  std::vector<NodeState> states_;
  std::uint64_t bytes_ = 0;
  std::uint64_t pictures_ = 0;
};

}  // namespace lod::hlod
