#pragma once
// From steps of the cut-border machine (connectivity.h) back to triangles, on any machine or with AVX2.
#include <cstddef>
#include <cstdint>

#include "base/bytes.h"
#include "lod/patch/codec/header.h"

namespace lod::patch::codec {

/// Steps that are decoded between two looks at the counts, hence the room that arrays need behind their ends.
inline constexpr std::size_t kStepsAtOnce = 32;
inline constexpr std::size_t kSlack = 4 + kStepsAtOnce;
/// Blocks of steps that are planned before they are followed, and the places that the front so needs behind its ring.
inline constexpr std::size_t kBlocks = 4;
inline constexpr std::size_t kBehindRing = kBlocks * kStepsAtOnce;

struct ConnectivityInput {
  base::ByteView steps;
  base::ByteView escapes;  ///< known vertices behind them
};

/// Where the decoder writes.
struct ConnectivityOutput {
  std::uint64_t* front = nullptr;    ///< zeros: the ring's 2^front_bits places and kBehindRing
  std::uint16_t* indices = nullptr;  ///< 3 for each triangle and kSlack more triangles
  std::uint64_t* gates = nullptr;    ///< packEdge() for each vertex and kSlack more; the upper 16 bits mean nothing
};

/// False when the header's counts are not met or the escapes run out. If true, all numbers in indices and gates are
/// below the count of vertices.
using ConnectivityReader = bool (*)(const PatchHeader& header, const ConnectivityInput& in,
                                    const ConnectivityOutput& out);

bool readConnectivity(const PatchHeader& header, const ConnectivityInput& in, const ConnectivityOutput& out);
#if defined(__x86_64__)
/// The same for machines with AVX2.
bool readConnectivityByAvx2(const PatchHeader& header, const ConnectivityInput& in, const ConnectivityOutput& out);
#endif

}  // namespace lod::patch::codec
