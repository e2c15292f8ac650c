#pragma once
// Turns the blocks of a JPEG into samples and back (ITU-T T.81, A.3.3 and A.3.4). Private to lod/texture.
#include <array>
#include <cstdint>

#include "base/jpeg/blocks.h"

namespace lod::texture {

using Quantization = std::array<std::uint16_t, 64>;
/// 8 x 8, row by row; black to white is 0 to 255. Values beyond are not cut off.
using BlockSamples = std::array<float, 64>;

BlockSamples samplesOf(const base::JpegBlock& block, const Quantization& quant);
/// The nearest block.
base::JpegBlock blockOf(const BlockSamples& samples, const Quantization& quant);
/// One sample of a block; x and y are 0 to 7.
float sampleOf(const base::JpegBlock& block, const Quantization& quant, int x, int y);
/// The mean of a block's samples, 0 to 255, by its first coefficient.
std::uint8_t meanOf(int coefficient, const Quantization& quant);
/// The nearest block whose samples are all alike.
base::JpegBlock flatBlock(std::uint8_t mean, const Quantization& quant);

}  // namespace lod::texture
