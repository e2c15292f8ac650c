#include "lod/texture/dct.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

namespace lod::texture {
namespace {

constexpr float kMiddle = 128.0F;  // samples lie about it in a JPEG
constexpr float kMaxCoefficient = 1023.0F;

using Basis = std::array<std::array<float, 8>, 8>;

// waves()[x][u]: what frequency u adds to sample x.
const Basis& waves() {
  static const Basis basis = [] {
    Basis made{};
    for (int x = 0; x < 8; ++x)
      for (int u = 0; u < 8; ++u)
        made[x][u] =
            static_cast<float>((u == 0 ? std::sqrt(0.125) : 0.5) * std::cos((2 * x + 1) * u * std::numbers::pi / 16.0));
    return made;
  }();
  return basis;
}

std::int16_t quantized(float value, std::uint16_t step) {
  return static_cast<std::int16_t>(
      std::lround(std::clamp(value / static_cast<float>(step), -kMaxCoefficient, kMaxCoefficient)));
}

}  // namespace

BlockSamples samplesOf(const base::JpegBlock& block, const Quantization& quant) {
  const Basis& wave = waves();
  // Columns first: half[y][u] is what the frequencies u add to row y.
  std::array<std::array<float, 8>, 8> half{};
  for (std::size_t v = 0; v < 8; ++v) {
    std::array<float, 8> row{};
    bool empty = true;
    for (std::size_t u = 0; u < 8; ++u) {
      row[u] = static_cast<float>(block[8 * v + u] * int{quant[8 * v + u]});
      empty &= block[8 * v + u] == 0;
    }
    if (empty) continue;
    for (std::size_t y = 0; y < 8; ++y)
      for (std::size_t u = 0; u < 8; ++u) half[y][u] += wave[y][v] * row[u];
  }
  BlockSamples samples;
  for (std::size_t y = 0; y < 8; ++y)
    for (std::size_t x = 0; x < 8; ++x) {
      float sum = kMiddle;
      for (std::size_t u = 0; u < 8; ++u) sum += wave[x][u] * half[y][u];
      samples[8 * y + x] = sum;
    }
  return samples;
}

base::JpegBlock blockOf(const BlockSamples& samples, const Quantization& quant) {
  const Basis& wave = waves();
  std::array<std::array<float, 8>, 8> half{};  // by row and frequency
  for (std::size_t y = 0; y < 8; ++y)
    for (std::size_t x = 0; x < 8; ++x)
      for (std::size_t u = 0; u < 8; ++u) half[y][u] += wave[x][u] * (samples[8 * y + x] - kMiddle);
  base::JpegBlock block{};
  for (std::size_t v = 0; v < 8; ++v)
    for (std::size_t u = 0; u < 8; ++u) {
      float sum = 0.0F;
      for (std::size_t y = 0; y < 8; ++y) sum += wave[y][v] * half[y][u];
      block[8 * v + u] = quantized(sum, quant[8 * v + u]);
    }
  return block;
}

float sampleOf(const base::JpegBlock& block, const Quantization& quant, int x, int y) {
  const std::array<float, 8>& across = waves()[static_cast<std::size_t>(x)];
  const std::array<float, 8>& down = waves()[static_cast<std::size_t>(y)];
  std::array<float, 8> sums{};
  for (std::size_t v = 0; v < 8; ++v) {
    std::array<std::uint64_t, 2> row{};
    std::memcpy(row.data(), &block[8 * v], sizeof(row));
    if ((row[0] | row[1]) == 0) continue;  // as most of them are
    for (std::size_t u = 0; u < 8; ++u)
      sums[u] += down[v] * static_cast<float>(block[8 * v + u] * int{quant[8 * v + u]});
  }
  float sample = kMiddle;
  for (std::size_t u = 0; u < 8; ++u) sample += across[u] * sums[u];
  return sample;
}

std::uint8_t meanOf(int coefficient, const Quantization& quant) {
  const int eighths = 8 * static_cast<int>(kMiddle) + coefficient * int{quant[0]};
  return static_cast<std::uint8_t>(std::clamp((eighths + 4) >> 3, 0, 255));
}

base::JpegBlock flatBlock(std::uint8_t mean, const Quantization& quant) {
  base::JpegBlock block{};
  block[0] = quantized((static_cast<float>(mean) - kMiddle) * 8.0F, quant[0]);
  return block;
}

}  // namespace lod::texture
