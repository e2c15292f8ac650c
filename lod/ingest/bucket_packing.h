#pragma once
// How triangles lie in the file of buckets. Private to lod/ingest.
//
// A triangle begins with two bytes that hold the length of each code (four bits each) and whether the triangle starts a
// run. The differing low bytes of the codes follow: the first corner's differ from the first corner of the triangle
// before it in the run, the others' from the triangle's own first corner. Colours and normals come last. Neighbours
// differ in few low bytes, so that codes take half the bytes that whole codes would.
#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>
#include <span>

#include "lod/ingest/border_vertices.h"

namespace lod::ingest {

struct BucketPacking {
  bool has_colors = false;
  bool has_normals = false;
  bool has_sources = false;  ///< each triangle is followed by its number in the source

  static constexpr std::size_t kHeadBytes = 2;
  static constexpr std::size_t kMaxTriangleBytes = kHeadBytes + 3 * sizeof(Corner) + sizeof(std::uint64_t);
  static constexpr std::size_t kSlack = 8;  ///< bytes that may be read or written behind the last triangle

  std::size_t cornerBytes() const { return 8 + (has_colors ? 4U : 0U) + (has_normals ? 4U : 0U); }
  std::size_t borderTriangleBytes() const { return 16 + 3 * cornerBytes(); }

  /// Packs a whole corner and returns the end of its bytes.
  std::uint8_t* pack(const Corner& corner, std::uint8_t* to) const {
    std::memcpy(to, &corner.code, 8), to += 8;
    return packAttributes(corner, to);
  }
  const std::uint8_t* unpack(const std::uint8_t* from, Corner& corner) const {
    std::memcpy(&corner.code, from, 8), from += 8;
    return unpackAttributes(from, corner);
  }

  /// Bytes of a triangle at most.
  std::size_t triangleBytes() const {
    return kHeadBytes + 3 * cornerBytes() + (has_sources ? sizeof(std::uint64_t) : 0U);
  }

  /// `before` is the first corner's code of the triangle before in the run, and then of this one.
  std::uint8_t* packTriangle(std::span<const Corner, 3> corner, bool starts_run, std::uint64_t& before,
                             std::uint64_t source, std::uint8_t* to) const {
    if (starts_run) before = 0;
    std::uint8_t* const head = to;
    to += kHeadBytes;
    std::uint32_t lengths = starts_run ? kStartsRun : 0;
    for (std::uint32_t k = 0; k < 3; ++k) {
      const std::uint64_t differs = corner[k].code ^ (k == 0 ? before : corner[0].code);
      const std::uint32_t bytes = (static_cast<std::uint32_t>(std::bit_width(differs)) + 7) / 8;
      lengths |= bytes << (4 * k);
      std::memcpy(to, &differs, sizeof(differs)), to += bytes;
    }
    before = corner[0].code;
    const auto stored = static_cast<std::uint16_t>(lengths);
    std::memcpy(head, &stored, sizeof(stored));
    for (const Corner& c : corner) to = packAttributes(c, to);
    if (has_sources) std::memcpy(to, &source, sizeof(source)), to += sizeof(source);
    return to;
  }
  /// Advances by at most kMaxTriangleBytes, whatever the bytes are.
  const std::uint8_t* unpackTriangle(const std::uint8_t* from, std::span<Corner, 3> corner, std::uint64_t& before,
                                     std::uint64_t& source) const {
    std::uint16_t head = 0;
    std::memcpy(&head, from, sizeof(head)), from += sizeof(head);
    if ((head & kStartsRun) != 0) before = 0;
    for (std::uint32_t k = 0; k < 3; ++k) {
      const std::uint32_t bytes = std::min(head >> (4 * k) & 15U, 8U);
      corner[k].code = lowBytes(from, bytes) ^ (k == 0 ? before : corner[0].code);
      from += bytes;
    }
    before = corner[0].code;
    for (Corner& c : corner) from = unpackAttributes(from, c);
    if (has_sources) std::memcpy(&source, from, sizeof(source)), from += sizeof(source);
    return from;
  }

 private:
  static constexpr std::uint32_t kStartsRun = 1U << 12;

  static std::uint64_t lowBytes(const std::uint8_t* from, std::uint32_t bytes) {
    std::uint64_t x = 0;
    std::memcpy(&x, from, sizeof(x));
    return bytes == 0 ? 0 : x & ~std::uint64_t{0} >> (64 - 8 * bytes);
  }
  std::uint8_t* packAttributes(const Corner& corner, std::uint8_t* to) const {
    if (has_colors) std::memcpy(to, &corner.color, 4), to += 4;
    if (has_normals) std::memcpy(to, &corner.normal, 4), to += 4;
    return to;
  }
  const std::uint8_t* unpackAttributes(const std::uint8_t* from, Corner& corner) const {
    if (has_colors) std::memcpy(&corner.color, from, 4), from += 4;
    if (has_normals) std::memcpy(&corner.normal, from, 4), from += 4;
    return from;
  }
};

}  // namespace lod::ingest
