#pragma once
// Triangles of a connected part are wound alike, after the part's majority. Worked out bucket by bucket: inside, edges
// tell; between buckets, only the edges on the border travel. Memory: the parts that reach a border or need turning.
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"

namespace lod::ingest {

struct Corner;

/// A bucket's vertices by number.
struct NumberedCorners {
  std::vector<std::uint64_t> codes;   ///< of the vertices, in the order in which corners name them
  std::vector<std::uint32_t> number;  ///< of each corner's vertex

  NumberedCorners() = default;
  explicit NumberedCorners(std::span<const Corner> corners);
};

/// Place of a vertex among those on bucket borders: no other bucket uses it.
inline constexpr std::uint32_t kNotOnBorder = 0xFFFFFFFFU;

/// What a bucket's own edges say. A part is what hangs together by edges along which two triangles run in opposite
/// directions, as triangles wound alike do. Parts without an edge that says otherwise, and without one on the border,
/// are not listed.
struct BucketWinding {
  static constexpr std::uint32_t kNoPart = 0xFFFFFFFFU;
  struct Part {
    std::uint64_t triangles = 0;
    std::uint64_t perimeter = 0;  ///< edges that tie it to nothing wound alike
    std::uint64_t against = 0;    ///< of these: edges along which a triangle of another part runs in the same direction
  };
  struct OpenEdge {
    std::uint64_t low = 0, high = 0;  ///< codes
    std::uint32_t part = 0;
    bool turned = false;  ///< runs from high to low
  };
  std::vector<std::uint32_t> part;  ///< per triangle
  std::vector<Part> parts;
  std::vector<OpenEdge> open;  ///< edges of one triangle here, both ends on the border
  std::vector<std::pair<std::uint32_t, std::uint32_t>> opposing;  ///< pairs of parts at the edges counted by `against`
};
/// The quick look that clean meshes need no more than: whether the bucket's triangles are wound alike as they are, and
/// the edges that another bucket may share, as they run.
struct QuickWinding {
  struct Edge {
    std::uint64_t low = 0, high = 0;
    bool turned = false;  ///< runs from high to low
  };
  bool alike = true;
  std::vector<Edge> open;
};
/// `border_place`: per vertex, kNotOnBorder or not.
QuickWinding lookAtWinding(const NumberedCorners& mesh, std::span<const std::uint32_t> border_place);
/// Whether edges that two buckets share run in opposite directions. Reorders `edges`.
bool windAlike(std::vector<QuickWinding::Edge>& edges);

BucketWinding measureWinding(const NumberedCorners& mesh, std::span<const std::uint32_t> border_place);

/// All buckets together. A part is turned when most of its perimeter runs against its neighbours and more triangles are
/// wound like those: where tiles of a scan overlap a few edges coincide by chance, and they must not turn a whole tile.
class Winding {
 public:
  /// Nothing is to be turned in any of so many buckets.
  void setAlike(std::size_t buckets) { first_.assign(buckets + 1, 0); }
  /// Buckets must be added in their order.
  void add(const BucketWinding& bucket);
  void finish();
  bool mayFlip(std::size_t bucket) const { return first_[bucket] != first_[bucket + 1] && flipped_ > 0; }
  /// Whether a part of a bucket is to be turned over.
  bool flips(std::size_t bucket, std::uint32_t part) const { return flip_[first_[bucket] + part] != 0; }
  std::uint64_t flipped() const { return flipped_; }
  /// Parts that run against themselves, as a Moebius strip does; they stay as they are.
  std::uint64_t nonOrientable() const { return non_orientable_; }
  void write(base::ByteWriter& out) const;
  bool read(base::ByteReader& in);

 private:
  std::vector<std::uint32_t> first_{0};  // part number of each bucket's first
  std::vector<std::uint8_t> flip_;       // per part
  // Until finish():
  std::vector<BucketWinding::Part> parts_;
  std::vector<BucketWinding::OpenEdge> open_;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> opposing_;
  std::uint64_t flipped_ = 0;
  std::uint64_t non_orientable_ = 0;
};

}  // namespace lod::ingest
