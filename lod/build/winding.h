#pragma once
// Triangles of a connected part are wound alike, after the part's majority. Worked out bucket by bucket: inside, edges
// tell; between buckets, only the edges on the border travel. Memory: the parts that reach a border or need turning.
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"

namespace lod::build {

struct Corner;

/// What a bucket's own edges say. Parts that are wound alike and touch no border are not listed.
struct BucketWinding {
  static constexpr std::uint32_t kNoPart = 0xFFFFFFFFU;
  struct OpenEdge {
    std::uint64_t low = 0, high = 0;  ///< codes
    std::uint32_t part = 0;
    bool turned = false;  ///< runs from high to low once its part is wound like its first triangle
  };
  std::vector<std::uint32_t> part;    ///< per triangle
  std::vector<std::uint8_t> turned;   ///< per triangle: wound the other way than its part's first
  std::vector<std::uint64_t> counts;  ///< per part, twice: triangles not turned, turned
  std::vector<OpenEdge> open;         ///< edges of one triangle here, both ends on the border
  std::uint32_t non_orientable = 0;   ///< parts that cannot be wound alike (a Moebius strip); they stay as they are
};
/// `corners`: 3 per triangle. `onBorder(code)`: another bucket may use this vertex.
BucketWinding measureWinding(std::span<const Corner> corners, const std::function<bool(std::uint64_t)>& onBorder);

/// All buckets together.
class Winding {
 public:
  /// Buckets must be added in their order.
  void add(const BucketWinding& bucket);
  void finish();
  /// Which triangles to turn over; empty when none.
  std::vector<std::uint8_t> flips(std::size_t bucket, const BucketWinding& measured) const;
  bool mayFlip(std::size_t bucket) const;
  std::uint64_t flipped() const { return flipped_; }
  std::uint64_t nonOrientable() const { return non_orientable_; }
  void write(base::ByteWriter& out) const;
  bool read(base::ByteReader& in);

 private:
  struct Edge {
    std::uint64_t low = 0, high = 0;
    std::uint32_t part = 0;
    bool turned = false;
  };
  std::vector<std::uint32_t> first_{0};  // part number of each bucket's first
  std::vector<std::uint8_t> flip_;       // per part
  std::vector<std::uint64_t> counts_;    // until finish()
  std::vector<Edge> open_;               // until finish()
  std::uint64_t flipped_ = 0;
  std::uint64_t non_orientable_ = 0;
};

}  // namespace lod::build
