#pragma once
// Connectivity of a patch as steps of a cut-border machine (Gumhold and Strasser 1998, "Real Time Compression of
// Triangle Mesh Connectivity").
//
// The *front* is a ring of directed edges that a further triangle may use; one more edge is the *gate*. A step either
// attaches a triangle to the gate or gives the gate up. Steps take two bits each; whatever the front does not foresee
// is an escape, so any list of triangles can be written, manifold or not. docs/formats/patch.md has the table of steps.
#include <cstdint>

namespace lod::patch::codec {

/// A directed edge that a further triangle may have, and the third corner of the triangle on its other side. A vertex
/// that is new at this edge is predicted as a + b − opposite.
struct FrontEdge {
  std::uint16_t a = 0;
  std::uint16_t b = 0;
  std::uint16_t opposite = 0;
};

/// Packs an edge into one register, a in the lowest 16 bits.
constexpr std::uint64_t packEdge(std::uint64_t a, std::uint64_t b, std::uint64_t opposite) {
  return a | b << 16 | opposite << 32;
}

/// Steps, two bits each.
inline constexpr std::uint32_t kNewVertex = 0;  ///< the gate's triangle has the next new vertex
inline constexpr std::uint32_t kNext = 1;       ///< the gate's triangle ends where the front's first edge does
inline constexpr std::uint32_t kGiveUp = 2;     ///< no triangle: the front's first edge becomes the gate
inline constexpr std::uint32_t kEscape = 3;     ///< a byte of the escapes tells

/// An escape below kFirstKind attaches the vertex that many before the newest one. From kFirstKind on it is one of
/// these kinds. Known vertices are u16, read from the escapes' end backwards.
inline constexpr std::uint32_t kFirstKind = 247;
inline constexpr std::uint32_t kPrevious = 0;    ///< the third corner is where the front's last edge starts
inline constexpr std::uint32_t kCloseLast = 1;   ///< no triangle: drop the front's last edge too, then as kGiveUp
inline constexpr std::uint32_t kCloseFirst = 2;  ///< no triangle: drop the front's first edge too, then as kGiveUp
inline constexpr std::uint32_t kFold = 3;        ///< a triangle on the front's first two edges, not on the gate
inline constexpr std::uint32_t kKnown = 4;       ///< the third corner is any known vertex
inline constexpr std::uint32_t kStart = 5;  ///< a first edge of a component; + 1, + 2: its first, second end is known

}  // namespace lod::patch::codec
