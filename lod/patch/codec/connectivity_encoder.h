#pragma once
// From triangles to steps of the cut-border machine (connectivity.h).
#include <cstdint>
#include <vector>

#include "base/bytes.h"
#include "lod/patch/codec/connectivity.h"
#include "lod/patch/hierarchy.h"

namespace lod::patch::codec {

struct EncodedConnectivity {
  std::vector<std::uint32_t> vertices;   ///< per new vertex: its number in the input
  std::vector<std::uint32_t> triangles;  ///< per new triangle: its number in the input
  std::vector<std::uint16_t> indices;    ///< 3 new vertices per new triangle
  std::vector<FrontEdge> gates;          ///< per new vertex: the gate, in new numbers, that it is predicted from
  std::uint32_t steps = 0;
  base::Bytes step_bytes;
  base::Bytes escapes;  ///< known vertices behind them
  std::uint8_t front_bits = 0;
};

/// Triangles and vertices are numbered anew in the order of the steps; vertices that no triangle uses are left out.
EncodedConnectivity encodeConnectivity(const PatchGeometry& geometry);

}  // namespace lod::patch::codec
