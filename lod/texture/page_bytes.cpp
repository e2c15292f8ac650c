// docs/formats/texture.md, "One page as bytes"
#include "lod/texture/page_bytes.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <optional>
#include <unordered_map>

#include "base/check.h"
#include "base/crc32c.h"
#include "base/fields.h"
#include "base/jpeg/jpeg.h"
#include "lod/texture/page.h"

namespace lod::texture {
namespace {

constexpr std::uint8_t kVersion = 1, kHasAlpha = 1;
constexpr std::size_t kHeaderBytes = 24, kChecksumBytes = 4;
constexpr std::uint32_t kMaxLevels = 14;  // of 8192 texels a side

// A block of 8 × 8 samples takes at least 2 bits of a baseline JPEG: a symbol for its first and one for its other
// coefficients. A grey JPEG has one block for 64 texels, others more. And deflate shrinks at most 1032 to 1 (zlib's
// documented limit).
constexpr std::uint64_t kMaxTexelsPerJpegByte = 256, kMaxTexelsPerAlphaByte = 1032;
// One triangle takes at most so many bytes before deflate: its number, three corners, and three places.
constexpr std::size_t kMaxTriangleBytes = 3 + 3 * 3 + 3 * 6;

// The first four bytes of a page: version, flags, levels, and a zero.
using Front = std::array<std::uint8_t, 4>;
auto headerFields(auto& h, auto& front) {
  return std::tie(front, h.factor, h.width, h.height, h.triangles, h.corner_bytes, h.alpha_bytes, h.jpeg_bytes);
}

base::Error invalid(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, "page: " + problem};
}

// Deflate -----------------------------------------------------------------------------------------

base::Result<base::Bytes> deflated(base::ByteView bytes) {
  uLongf length = compressBound(static_cast<uLong>(bytes.size()));
  base::Bytes out(length);
  if (compress2(out.data(), &length, bytes.data(), static_cast<uLong>(bytes.size()), Z_DEFAULT_COMPRESSION) != Z_OK)
    return base::Error{base::ErrorCode::kNoSpace, "page: no memory to compress it"};
  out.resize(length);
  return out;
}

// Returns the bytes, at most `limit`, that a whole zlib stream holds; nothing where it is broken or something follows.
std::optional<base::Bytes> inflated(base::ByteView bytes, std::size_t limit) {
  base::Bytes out(limit);
  uLongf length = static_cast<uLongf>(limit);
  uLong used = static_cast<uLong>(bytes.size());
  if (uncompress2(out.data(), &length, bytes.data(), &used) != Z_OK || used != bytes.size()) return std::nullopt;
  out.resize(length);
  return out;
}

// Corners -----------------------------------------------------------------------------------------

std::uint64_t zigzag(int value) {
  return value < 0 ? static_cast<std::uint64_t>(-2 * value - 1) : static_cast<std::uint64_t>(2 * value);
}
int fromZigzag(std::uint64_t value) {
  const int half = static_cast<int>(value >> 1);
  return (value & 1) != 0 ? -half - 1 : half;
}

// Four rows of numbers: gaps between triangles; for each corner 0 if it is new, or how many new ones ago it was; x and
// y of new ones, each less those of the corner before.
base::Bytes cornerBytes(const std::vector<PageTriangle>& triangles) {
  base::ByteWriter gaps, ages, xs, ys;
  std::unordered_map<std::uint32_t, std::uint32_t> known;  // place → number
  std::uint32_t next_triangle = 0;
  glm::ivec2 before(0);
  for (const PageTriangle& triangle : triangles) {
    gaps.varint(triangle.triangle - next_triangle);
    next_triangle = triangle.triangle + 1U;
    for (const glm::u16vec2& corner : triangle.corners) {
      const auto count = static_cast<std::uint32_t>(known.size());
      const auto [found, is_new] = known.try_emplace(std::uint32_t{corner.x} << 16 | corner.y, count);
      ages.varint(is_new ? 0 : count - found->second);
      if (is_new) {
        xs.varint(zigzag(corner.x - before.x));
        ys.varint(zigzag(corner.y - before.y));
      }
      before = corner;
    }
  }
  for (const base::ByteWriter* row : {&ages, &xs, &ys}) gaps.bytes(row->view());
  return gaps.takeBytes();
}

// Reads numbers below `end`, or fails.
bool readNumbers(base::ByteReader& in, std::vector<std::uint32_t>& numbers, std::uint64_t end) {
  for (std::uint32_t& number : numbers) {
    const std::uint64_t value = in.varint();
    if (!in.ok() || value >= end) return false;
    number = static_cast<std::uint32_t>(value);
  }
  return true;
}

base::Result<std::vector<PageTriangle>> readTriangles(base::ByteView bytes, const PageHeader& header) {
  const base::Error broken = damaged("page: its triangles cannot be read");
  const auto plain = inflated(bytes, kMaxTriangleBytes * header.triangles);
  if (!plain) return broken;
  base::ByteReader in(*plain);
  std::vector<std::uint32_t> gaps(header.triangles), ages(std::size_t{3} * header.triangles);
  if (!readNumbers(in, gaps, 65536) || !readNumbers(in, ages, ages.size())) return broken;
  std::size_t new_corners = 0;
  for (const std::uint32_t age : ages) new_corners += age == 0 ? 1 : 0;
  std::vector<std::uint32_t> xs(new_corners), ys(new_corners);
  if (!readNumbers(in, xs, 131072) || !readNumbers(in, ys, 131072) || !in.atEnd()) return broken;

  const glm::ivec2 end(header.width * kCornerSteps, header.height * kCornerSteps);
  std::vector<PageTriangle> triangles(header.triangles);
  std::vector<glm::ivec2> known;
  known.reserve(new_corners);
  std::uint32_t next_triangle = 0;
  glm::ivec2 corner(0);
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    const std::uint32_t number = next_triangle + gaps[t];
    if (number > 65535) return damaged("page: a triangle's number is too large");
    triangles[t].triangle = static_cast<std::uint16_t>(number);
    next_triangle = number + 1;
    for (int i = 0; i < 3; ++i) {
      const std::uint32_t age = ages[3 * t + static_cast<std::size_t>(i)];
      if (age > known.size()) return damaged("page: a corner is taken that was not there yet");
      if (age == 0) known.push_back(corner + glm::ivec2(fromZigzag(xs[known.size()]), fromZigzag(ys[known.size()])));
      corner = age == 0 ? known.back() : known[known.size() - age];
      if (glm::any(glm::lessThan(corner, glm::ivec2(0))) || glm::any(glm::greaterThan(corner, end)))
        return damaged("page: a corner lies outside");
      triangles[t].corners[i] = glm::u16vec2(corner);
    }
  }
  return triangles;
}

// Texels ------------------------------------------------------------------------------------------

std::size_t texelsOf(const PageHeader& header) {
  return std::size_t{header.width} * header.height;
}

base::Result<base::Image> readImage(const PageHeader& header, base::ByteView alpha_bytes, base::ByteView jpeg) {
  if (texelsOf(header) > kMaxTexelsPerJpegByte * jpeg.size())
    return damaged("page: its JPEG is too short for its size");
  LUMIGRID_ASSIGN_OR_RETURN(const auto size, base::readJpegSize(jpeg));
  if (size.width != header.width || size.height != header.height)
    return damaged("page: its JPEG has another size than its header says");
  std::optional<base::Bytes> alpha;
  if (header.alpha) {
    if (texelsOf(header) > kMaxTexelsPerAlphaByte * alpha_bytes.size())
      return damaged("page: its alpha is too short for its size");
    alpha = inflated(alpha_bytes, texelsOf(header));
    if (!alpha || alpha->size() != texelsOf(header)) return damaged("page: its alpha cannot be read");
  }
  LUMIGRID_ASSIGN_OR_RETURN(auto rgb, base::decodeJpeg(jpeg, kMaxPageSide));
  if (!alpha) return rgb;
  base::Image rgba(rgb.width, rgb.height, 4);
  for (std::size_t i = 0; i < alpha->size(); ++i) {
    std::memcpy(&rgba.pixels[4 * i], &rgb.pixels[3 * i], 3);
    rgba.pixels[4 * i + 3] = (*alpha)[i];
  }
  return rgba;
}

// Splits the image into colours, as a JPEG, and alpha.
base::Result<base::Bytes> colorBytes(const base::Image& image, int quality) {
  if (image.channels == 3) return base::encodeJpeg(image, quality, base::Subsampling::k444);
  base::Image rgb(image.width, image.height, 3);
  for (std::size_t i = 0; 4 * i < image.pixels.size(); ++i) std::memcpy(&rgb.pixels[3 * i], &image.pixels[4 * i], 3);
  return base::encodeJpeg(rgb, quality, base::Subsampling::k444);
}
base::Result<base::Bytes> alphaBytes(const base::Image& image) {
  if (image.channels == 3) return base::Bytes();
  base::Bytes alpha(image.pixels.size() / 4);
  for (std::size_t i = 0; i < alpha.size(); ++i) alpha[i] = image.pixels[4 * i + 3];
  return deflated(alpha);
}

// Returns the header of a page, without lengths, if decodePage() would take it.
base::Result<PageHeader> headerOf(const PageLayout& page) {
  PageHeader header;
  if (std::max(page.size.x, page.size.y) > kMaxPageSide) return invalid("more than 8192 texels a side");
  if (page.levels > kMaxLevels || page.triangles.size() > 65535) return invalid("too many levels or triangles");
  header.levels = static_cast<std::uint8_t>(page.levels);
  header.width = static_cast<std::uint16_t>(page.size.x);
  header.height = static_cast<std::uint16_t>(page.size.y);
  header.triangles = static_cast<std::uint16_t>(page.triangles.size());
  if (const char* fault = sizeFault(header.width, header.height, header.levels, header.triangles))
    return invalid(fault);
  if (page.factor < 1 || page.factor > 65535) return invalid("its scale is not 1 by a whole number");
  header.factor = static_cast<std::uint16_t>(page.factor);
  for (std::size_t t = 0; t < page.triangles.size(); ++t) {
    if (t > 0 && page.triangles[t].triangle <= page.triangles[t - 1].triangle)
      return invalid("its triangles are not in the order of their numbers");
    for (const glm::u16vec2& corner : page.triangles[t].corners)
      if (corner.x > page.size.x * kCornerSteps || corner.y > page.size.y * kCornerSteps)
        return invalid("a corner lies outside");
  }
  return header;
}

}  // namespace

base::Error damaged(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, problem + "; copy or build the file again"};
}

const char* sizeFault(std::uint16_t width, std::uint16_t height, std::uint8_t levels, std::uint16_t triangles) {
  for (const std::uint16_t side : {width, height})
    if (side == 0 || side > kMaxPageSide || side % 4 != 0) return "its sides are not multiples of 4 from 4 to 8192";
  if (levels == 0 || levels > kMaxLevels) return "its levels are not 1 to 14";
  if (triangles == 0) return "it has no triangles";
  return nullptr;
}

base::Result<PageHeader> readPageHeader(base::ByteView bytes) {
  base::ByteReader in(bytes);
  PageHeader header;
  Front front{};
  base::readFields(in, headerFields(header, front));
  const auto [version, flags, levels, zero] = front;
  if (!in.ok() || bytes.size() < kHeaderBytes + kChecksumBytes) return damaged("page: cut short");
  if (version != kVersion)
    return base::Error{base::ErrorCode::kVersion, "page: format version " + std::to_string(version) +
                                                      ", this program reads 1; use a newer program or build the scene "
                                                      "again"};
  header.alpha = (flags & kHasAlpha) != 0;
  header.levels = levels;
  if ((flags & ~kHasAlpha) != 0 || zero != 0) return damaged("page: unknown flags");
  if (const char* fault = sizeFault(header.width, header.height, header.levels, header.triangles))
    return damaged(std::string("page: ") + fault);
  if (header.factor == 0) return damaged("page: its scale is not a number");
  if (header.alpha != (header.alpha_bytes > 0)) return damaged("page: its alpha is missing, or not announced");
  if (kHeaderBytes + std::uint64_t{header.corner_bytes} + header.alpha_bytes + header.jpeg_bytes + kChecksumBytes !=
      bytes.size())
    return damaged("page: its parts don't add up to its length");
  return header;
}

base::Result<base::Bytes> encodePage(const Page& page, int quality) {
  LUMIGRID_CHECK(quality >= 1 && quality <= 100);
  const base::Image& image = page.image;
  if (image.channels != 3 && image.channels != 4) return invalid("no image of 3 or 4 channels");
  const float factor = std::round(1.0F / page.scale);
  if (!(factor >= 1.0F && factor <= 65535.0F && page.scale == 1.0F / factor))
    return invalid("its scale is not 1 by a whole number");
  const PageLayout layout{{image.width, image.height}, page.levels, static_cast<int>(factor), page.triangles};
  if (const auto header = headerOf(layout); !header) return header.error();
  LUMIGRID_ASSIGN_OR_RETURN(const auto alpha, alphaBytes(image));
  LUMIGRID_ASSIGN_OR_RETURN(const auto jpeg, colorBytes(image, quality));
  return encodePage(layout, jpeg, alpha);
}

base::Result<base::Bytes> encodePage(const PageLayout& layout, base::ByteView jpeg, base::ByteView alpha) {
  LUMIGRID_ASSIGN_OR_RETURN(auto header, headerOf(layout));
  LUMIGRID_ASSIGN_OR_RETURN(const auto corners, deflated(cornerBytes(layout.triangles)));
  header.alpha = !alpha.empty();
  header.corner_bytes = static_cast<std::uint32_t>(corners.size());
  header.alpha_bytes = static_cast<std::uint32_t>(alpha.size());
  header.jpeg_bytes = static_cast<std::uint32_t>(jpeg.size());

  const Front front{kVersion, header.alpha ? kHasAlpha : std::uint8_t{0}, header.levels, 0};
  base::ByteWriter head, tail;
  base::writeFields(head, headerFields(header, front));
  base::Bytes out;
  out.reserve(head.view().size() + corners.size() + alpha.size() + jpeg.size() + kChecksumBytes);
  for (const base::ByteView part : {base::ByteView(head.view()), base::ByteView(corners), alpha, jpeg})
    out.insert(out.end(), part.begin(), part.end());
  tail.u32(base::crc32c(out));
  out.insert(out.end(), tail.view().begin(), tail.view().end());
  return out;
}

base::Result<Page> decodePage(base::ByteView bytes) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto header, readPageHeader(bytes));
  const base::ByteView checked = bytes.first(bytes.size() - kChecksumBytes);
  std::uint32_t crc = 0;
  std::memcpy(&crc, checked.data() + checked.size(), sizeof(crc));
  if (crc != base::crc32c(checked)) return damaged("page: checksum does not match");

  const base::ByteView parts = checked.subspan(kHeaderBytes);
  const base::ByteView corners = parts.first(header.corner_bytes);
  const base::ByteView alpha = parts.subspan(header.corner_bytes, header.alpha_bytes);
  Page page;
  page.levels = header.levels;
  page.scale = 1.0F / static_cast<float>(header.factor);
  LUMIGRID_ASSIGN_OR_RETURN(page.triangles, readTriangles(corners, header));
  LUMIGRID_ASSIGN_OR_RETURN(page.image, readImage(header, alpha, parts.last(header.jpeg_bytes)));
  return page;
}

}  // namespace lod::texture
