// The points of a chunk, and what chunks share; triangles are in triangle_chunk.cpp.
#include "lod/pmr/chunks.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <tuple>

#include "lod/morton.h"
#include "lod/pmr/chunk_checksum.h"
#include "lod/pmr/range_coder.h"

namespace lod::pmr {
namespace {

/// A point's normal, position and colour are predicted from the nearest of so many points before it. Among more, the
/// nearest one lies on another part of the surface more often than it is a better neighbour.
constexpr std::size_t kWindow = 8;
constexpr std::int32_t kLatticeEnd = 1 << kPositionBits;

float sign(float x) {
  return x < 0.0F ? -1.0F : 1.0F;
}

/// The direction of an octahedral code in whole numbers, of L1 length 255.
glm::ivec3 wholeNormal(const glm::u8vec2& code) {
  glm::ivec3 n(2 * int{code.x} - 255, 2 * int{code.y} - 255, 0);
  n.z = 255 - std::abs(n.x) - std::abs(n.y);
  if (n.z < 0) {
    const glm::ivec2 folded(255 - std::abs(n.y), 255 - std::abs(n.x));
    n.x = n.x < 0 ? -folded.x : folded.x;
    n.y = n.y < 0 ? -folded.y : folded.y;
  }
  return n;
}

int largestAxis(const glm::ivec3& n) {
  const glm::ivec3 a = glm::abs(n);
  return a.x >= a.y && a.x >= a.z ? 0 : a.y >= a.z ? 1 : 2;
}

std::uint32_t lengthOf(std::int32_t value) {
  return static_cast<std::uint32_t>(std::bit_width(static_cast<std::uint32_t>(std::abs(value))));
}

/// Codes point after point, in both directions (range_coder.h). Two coordinates of a point are coded by what they share
/// with the point before in Morton order. Then comes the normal; the third coordinate, on the axis along which the last
/// normal is longest, is coded as its distance from the plane through the nearest known point.
template <class Coder>
class PointModel {
 public:
  PointModel(Coder& coder, bool colors) : coder_(coder), colors_(colors) {}

  /// False where what was decoded lies outside the lattice.
  bool code(CodedPoint& point) {
    const int k = largestAxis(last_whole_);
    const int i = k == 2 ? 0 : k + 1, j = i == 2 ? 0 : i + 1;
    if (!codeTwo(point.place, i, j, k)) return false;
    const Known& near = nearest(point.place, i, j);
    const std::int32_t distance = std::abs(point.place[i] - near.place[i]) + std::abs(point.place[j] - near.place[j]);
    codeNormal(near, point.normal);
    const glm::ivec3 whole = wholeNormal(point.normal);
    if (!codeThird(near, whole, std::min(lengthOf(distance), 15U), i, j, k, point.place)) return false;
    if (colors_) codeColor(near, point.color);

    last_ = point.place;
    last_whole_ = whole;
    known_[count_++ % kWindow] = {point.place, whole, point.normal, point.color};
    return true;
  }

 private:
  struct Known {
    glm::ivec3 place{0};
    glm::ivec3 whole{0, 0, 255};
    glm::u8vec2 normal{128};
    glm::u8vec3 color{128};
  };

  // The coordinates share all bits with those before, down to a first one that differs; the ones below it are free.
  bool codeTwo(glm::ivec3& place, int i, int j, int k) {
    const std::uint32_t differing =
        static_cast<std::uint32_t>(place[i] ^ last_[i]) | static_cast<std::uint32_t>(place[j] ^ last_[j]);
    const std::uint32_t length =
        lengths_[length_before_ / 2].code(coder_, static_cast<std::uint32_t>(std::bit_width(differing)));
    if (length > kPositionBits) return false;
    length_before_ = length;
    if (length == 0) {
      place[i] = last_[i], place[j] = last_[j];
      return true;
    }
    const std::uint32_t low = length - 1;
    const auto bitOf = [low](std::int32_t value) { return static_cast<std::uint32_t>(value) >> low & 1; };
    const std::uint32_t quadrant =
        quadrants_[static_cast<std::uint32_t>(k) * 4 + bitOf(last_[i]) * 2 + bitOf(last_[j])].code(
            coder_, bitOf(place[i]) * 2 + bitOf(place[j]));
    place[i] = codeLow(last_[i], quadrant >> 1, low, place[i]);
    place[j] = codeLow(last_[j], quadrant & 1, low, place[j]);
    return true;
  }

  std::int32_t codeLow(std::int32_t before, std::uint32_t top, std::uint32_t low, std::int32_t value) {
    const std::uint32_t mask = (1U << low) - 1;
    const std::uint32_t high = static_cast<std::uint32_t>(before) >> low >> 1 << 1 | top;
    const auto free = static_cast<std::uint32_t>(codeRaw(coder_, low, static_cast<std::uint32_t>(value) & mask));
    return static_cast<std::int32_t>(high << low | free);
  }

  const Known& nearest(const glm::ivec3& place, int i, int j) const {
    const std::size_t known = std::min(count_, kWindow);
    if (known == 0) return first_;
    std::size_t best = 0;
    std::int32_t least = 2 * kLatticeEnd;
    for (std::size_t w = 0; w < known; ++w) {
      const glm::ivec3& other = known_[w].place;
      const std::int32_t distance = std::abs(place[i] - other[i]) + std::abs(place[j] - other[j]);
      if (distance < least) least = distance, best = w;
    }
    return known_[best];
  }

  void codeNormal(const Known& near, glm::u8vec2& normal) {
    const std::int32_t x = codeByte(normals_x_[turn_before_], near.normal.x, normal.x);
    const std::uint32_t length = std::min(lengthOf(x), 7U);
    const std::int32_t y = codeByte(normals_y_[length], near.normal.y, normal.y);
    turn_before_ = std::min(std::max(lengthOf(x), lengthOf(y)) / 2, 3U);
  }

  bool codeThird(const Known& near, const glm::ivec3& whole, std::uint32_t reach, int i, int j, int k,
                 glm::ivec3& place) {
    // The chord of a round surface is at right angles to the mean of both normals.
    const bool opposite = near.whole.x * whole.x + near.whole.y * whole.y + near.whole.z * whole.z < 0;
    const glm::ivec3 mean = opposite ? near.whole - whole : near.whole + whole;
    std::int64_t expected = near.place[k];
    if (mean[k] != 0) {
      const std::int64_t rise =
          std::int64_t{mean[i]} * (place[i] - near.place[i]) + std::int64_t{mean[j]} * (place[j] - near.place[j]);
      expected -= rise / mean[k];
    }
    const auto plane = static_cast<std::int32_t>(std::clamp<std::int64_t>(expected, 0, kLatticeEnd - 1));
    const std::int32_t off = thirds_[reach].code(coder_, place[k] - plane);
    const std::int64_t decoded = std::int64_t{plane} + off;
    place[k] = static_cast<std::int32_t>(decoded);
    return decoded >= 0 && decoded < kLatticeEnd;
  }

  void codeColor(const Known& near, glm::u8vec3& color) {
    const std::int32_t g = codeByte(greens_[std::min(green_before_, 7U)], near.color.y, color.y);
    green_before_ = lengthOf(g);
    const auto follow = [g](std::uint8_t value) { return static_cast<std::uint8_t>(value + g); };
    const std::int32_t r = codeByte(reds_[std::min(green_before_, 7U)], follow(near.color.x), color.x);
    codeByte(blues_[std::min(lengthOf(r), 7U)], follow(near.color.z), color.z);
  }

  // A byte as its difference, modulo 256, from the expected one.
  std::int32_t codeByte(SignedModel& model, std::uint8_t expected, std::uint8_t& value) {
    const auto difference = static_cast<std::int8_t>(value - expected);
    const std::int32_t coded = model.code(coder_, difference);
    value = static_cast<std::uint8_t>(expected + static_cast<std::uint32_t>(coded));
    return static_cast<std::int8_t>(coded);
  }

  Coder& coder_;
  const bool colors_;
  const Known first_;
  std::array<Known, kWindow> known_;
  std::size_t count_ = 0;
  glm::ivec3 last_{0};
  glm::ivec3 last_whole_{0, 0, 255};
  std::uint32_t length_before_ = 0, turn_before_ = 0, green_before_ = 0;
  std::array<SymbolModel<5>, kPositionBits / 2 + 1> lengths_;
  std::array<SymbolModel<2>, 12> quadrants_;
  std::array<SignedModel, 4> normals_x_;
  std::array<SignedModel, 8> normals_y_;
  std::array<SignedModel, 16> thirds_;
  std::array<SignedModel, 8> greens_, reds_, blues_;
};

auto chunkOrder(const CodedPoint& p) {
  return std::tuple(p.normal.x, p.normal.y, p.color.x, p.color.y, p.color.z);
}

}  // namespace

glm::u8vec2 encodeNormal(const glm::vec3& normal) {
  const float length = std::abs(normal.x) + std::abs(normal.y) + std::abs(normal.z);
  if (!(length > 0.0F)) return glm::u8vec2(128);
  glm::vec2 at(normal.x / length, normal.y / length);
  if (normal.z < 0.0F) at = {(1.0F - std::abs(at.y)) * sign(normal.x), (1.0F - std::abs(at.x)) * sign(normal.y)};
  const auto code = [](float x) {
    return static_cast<std::uint8_t>(std::clamp(std::lround(127.5F + 127.5F * x), 0L, 255L));
  };
  return {code(at.x), code(at.y)};
}

glm::vec3 decodeNormal(const glm::u8vec2& code) {
  return glm::normalize(glm::vec3(wholeNormal(code)));
}

void sortForChunk(std::vector<CodedPoint>& points) {
  std::vector<std::pair<std::uint64_t, CodedPoint>> keyed;
  keyed.reserve(points.size());
  for (const CodedPoint& point : points) keyed.emplace_back(mortonCode(point.place), point);
  std::sort(keyed.begin(), keyed.end(), [](const auto& a, const auto& b) {
    return a.first != b.first ? a.first < b.first : chunkOrder(a.second) < chunkOrder(b.second);
  });
  std::transform(keyed.begin(), keyed.end(), points.begin(), [](const auto& one) { return one.second; });
}

base::Bytes encodePoints(std::span<const CodedPoint> own, std::span<const CodedPoint> foreign, bool colors) {
  if (own.empty() && foreign.empty()) return {};
  RangeEncoder encoder;
  PointModel<RangeEncoder> model(encoder, colors);
  for (const auto& points : {own, foreign})
    for (CodedPoint point : points) model.code(point);
  return sealedChunk(encoder.finish(), static_cast<std::uint32_t>(own.size()),
                     static_cast<std::uint32_t>(foreign.size()));
}

base::Result<void> decodePoints(base::ByteView chunk, std::uint32_t own, std::uint32_t foreign, bool colors,
                                std::vector<CodedPoint>& out) {
  const std::size_t count = std::size_t{own} + foreign;
  if (count > kMaxVertices) return damaged("points: more than a leaf can have");
  const auto coded = intactChunk(chunk, own, foreign);
  if (!coded) return damaged("points: checksum does not match");
  const std::size_t before = out.size();
  out.resize(before + count);
  RangeDecoder decoder(*coded);
  PointModel<RangeDecoder> model(decoder, colors);
  for (std::size_t i = before; i < out.size(); ++i) {
    if (model.code(out[i])) continue;
    out.resize(before);
    return damaged("points: one lies outside the lattice");
  }
  return {};
}

}  // namespace lod::pmr
