#pragma once
// The header of a LAS file and the records beside its points (ASPRS, "LAS Specification 1.4 - R15", 2019).
#include <cstdint>
#include <glm/glm.hpp>
#include <string>

#include "base/bytes.h"
#include "base/error.h"
#include "mesh/crs_text.h"

namespace mesh {

/// Tells where a point record keeps what is read of it. Coordinates lie at byte 0, three int32, and the intensity at
/// 12, in all formats.
struct LasPointFormat {
  std::size_t color = 0;  ///< three u16, red first; 0: it has none
  std::size_t flags = 0;
  std::uint8_t withheld = 0;  ///< the bit of `flags` that tells a deleted point
  std::size_t classification = 0;
  std::uint8_t class_mask = 0;
};

struct LasHeader {
  LasPointFormat format;
  std::uint64_t points = 0;     ///< above 0; the file holds them all
  std::size_t first_point = 0;  ///< offset in the file
  std::size_t record = 0;       ///< bytes from one point to the next
  glm::dvec3 scale{1.0};        ///< coordinate = scale · number + offset
  glm::dvec3 offset{0.0};
  CrsDescription crs;
  std::string warning;  ///< about records that could not be read; else empty
};

/// Reads and checks the header, so that each of the points lies inside `bytes`. Errors say which field is wrong; LAZ is
/// kUnsupported.
base::Result<LasHeader> readLasHeader(base::ByteView bytes);

}  // namespace mesh
