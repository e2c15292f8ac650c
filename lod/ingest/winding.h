#pragma once
// Makes the triangles of each connected part wound alike, after the part's majority. Inside a bucket all edges are
// compared, between buckets only those on the border. Memory holds the parts that reach a border or need flipping.
#include <compare>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "lod/ingest/border_vertices.h"
#include "lod/ingest/stitching.h"

namespace lod::ingest {

/// An edge of one triangle in its bucket, which another bucket may share.
struct OpenEdge {
  std::uint64_t low = 0, high = 0;  ///< codes of its ends
  std::uint32_t part = 0;           ///< in BucketWinding; 0 where parts are not told apart
  bool turned = false;              ///< runs from high to low
  auto operator<=>(const OpenEdge&) const = default;
};

/// A bucket's vertices, numbered.
struct NumberedCorners {
  std::vector<std::uint64_t>
      codes;  ///< by vertex number; vertices are numbered in the order in which corners name them
  std::vector<std::uint32_t> number;  ///< by corner: its vertex

  NumberedCorners() = default;
  explicit NumberedCorners(std::span<const Corner> corners);
};

/// The parts of a bucket. Triangles belong to one part where they are connected by edges along which two triangles run
/// in opposite directions, as triangles wound alike do. Parts that neither reach the border nor have an opposing
/// neighbour are not listed.
struct BucketWinding {
  static constexpr std::uint32_t kNoPart = 0xFFFFFFFFU;
  struct Part {
    std::uint64_t triangles = 0;
    std::uint64_t perimeter = 0;  ///< edges that join it to no triangle wound alike
    std::uint64_t against = 0;    ///< how many of these a triangle of another part runs along in the same direction
  };
  std::vector<std::uint32_t> part;  ///< per triangle
  std::vector<Part> parts;
  std::vector<OpenEdge> open;    ///< edges of one triangle here, both ends on the border
  std::uint64_t inner_open = 0;  ///< other edges of one triangle
  std::vector<std::pair<std::uint32_t, std::uint32_t>> opposing;  ///< pairs of parts at the edges counted by `against`
};

/// A check that is all that clean meshes need.
struct WindingCheck {
  bool consistent = true;        ///< no two triangles run along an edge in the same direction
  std::vector<OpenEdge> open;    ///< edges of one triangle here, which another bucket may share
  std::uint64_t inner_open = 0;  ///< other edges of one triangle
};
/// `border_place` is per vertex, kNotOnBorder or not.
WindingCheck checkWinding(const NumberedCorners& mesh, std::span<const std::uint32_t> border_place);
/// The edges of one triangle of a bucket. `corners`: those that were numbered.
std::vector<BorderEdge> borderEdges(const NumberedCorners& mesh, std::span<const Corner> corners);
struct SharedEdges {
  bool run_oppositely = true;  ///< all that two buckets share
  std::uint64_t open = 0;      ///< edges that only one has
};
/// Compares the edges of all buckets. Reorders `edges`.
SharedEdges compareEdges(std::vector<OpenEdge>& edges);
BucketWinding measureWinding(const NumberedCorners& mesh, std::span<const std::uint32_t> border_place);

/// The parts of all buckets together. A part is flipped when at least half of its perimeter runs against its neighbours
/// and more triangles are wound like those. Where tiles of a scan overlap, a few edges coincide by chance, and they
/// must not flip a whole tile.
class Winding {
 public:
  /// Declares all `buckets` consistent, so that no triangle is flipped.
  void setConsistent(std::size_t buckets, std::uint64_t open_edges) {
    first_.assign(buckets + 1, 0);
    open_edges_ = open_edges;
  }
  /// Adds the next bucket, in their order.
  void add(const BucketWinding& bucket);
  /// Decides after the last bucket which parts are flipped.
  void finish();
  bool mayFlip(std::size_t bucket) const { return first_[bucket] != first_[bucket + 1] && flipped_ > 0; }
  /// Whether a part of a bucket is to be flipped.
  bool flips(std::size_t bucket, std::uint32_t part) const { return flip_[first_[bucket] + part] != 0; }
  /// How many triangles are flipped.
  std::uint64_t flipped() const { return flipped_; }
  /// How many parts run against themselves, as a Möbius strip does; they stay as they are.
  std::uint64_t nonOrientable() const { return non_orientable_; }
  /// How many edges have only one triangle.
  std::uint64_t openEdges() const { return open_edges_; }
  void write(base::ByteWriter& out) const;
  bool read(base::ByteReader& in);

 private:
  std::vector<std::uint32_t> first_{0};  // part number of each bucket's first
  std::vector<std::uint8_t> flip_;       // per part
  // Until finish():
  std::vector<BucketWinding::Part> parts_;
  std::vector<OpenEdge> open_;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> opposing_;
  std::uint64_t flipped_ = 0;
  std::uint64_t non_orientable_ = 0;
  std::uint64_t open_edges_ = 0;
};

}  // namespace lod::ingest
