#include "repository/faces/face_value.h"

#include <algorithm>
#include <string>
#include <string_view>

#include "base/check.h"
#include "base/crc32c.h"

namespace repository {
namespace {

constexpr std::uint8_t kMagic = 0x46;  // 'F'
constexpr std::uint8_t kVersion = 1;
constexpr std::uint8_t kEmpty = 0;
constexpr std::uint8_t kImage = 1;
constexpr std::uint8_t kAllChildren = 15;
constexpr std::size_t kCrcOffset = 4;
constexpr std::size_t kHeaderBytes = 8;
constexpr std::size_t kWebpMagicBytes = 12;  // "RIFF", four bytes of length, "WEBP"

// The checksum covers all bytes but its own.
std::uint32_t checksum(base::ByteView bytes) {
  return base::crc32c(bytes.subspan(kHeaderBytes), base::crc32c(bytes.first(kCrcOffset)));
}

base::Error badValue(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, "face value: " + problem};
}

}  // namespace

const char* nameOf(ImageCodec codec) {
  return codec == ImageCodec::kWebp ? "webp" : "jpeg";
}

std::optional<ImageCodec> imageCodecOf(std::string_view name) {
  for (const ImageCodec codec : {ImageCodec::kJpeg, ImageCodec::kWebp})
    if (name == nameOf(codec)) return codec;
  return std::nullopt;
}

bool isWebp(base::ByteView picture) {
  const auto holds = [&](std::size_t at, std::string_view text) {
    return std::equal(text.begin(), text.end(), picture.begin() + static_cast<std::ptrdiff_t>(at));
  };
  return picture.size() >= kWebpMagicBytes && holds(0, "RIFF") && holds(8, "WEBP");
}

base::Bytes encodeFaceValue(const FaceValue& value) {
  LUMIGRID_CHECK_LE(value.picture.size(), std::size_t{0xFFFFFFFF});
  LUMIGRID_CHECK_LE(value.coverage.size(), std::size_t{0xFFFFFFFF});
  base::ByteWriter out;
  out.u8(kMagic);
  out.u8(kVersion);
  out.u8(value.empty ? kEmpty : kImage);
  out.u8(value.children);
  out.u32(0);
  if (!value.empty) {
    out.u32(static_cast<std::uint32_t>(value.picture.size()));
    out.u32(static_cast<std::uint32_t>(value.coverage.size()));
    out.bytes(value.picture);
    out.bytes(value.coverage);
  }
  out.patch(kCrcOffset, checksum(out.view()));
  return out.takeBytes();
}

base::Result<FaceValue> decodeFaceValue(base::ByteView bytes) {
  base::ByteReader in(bytes);
  const std::uint8_t magic = in.u8();
  const std::uint8_t version = in.u8();
  const std::uint8_t kind = in.u8();
  const std::uint8_t children = in.u8();
  const std::uint32_t crc = in.u32();
  if (!in.ok()) return badValue("cut short");
  if (magic != kMagic) return badValue("not one (wrong magic)");
  if (version != kVersion)
    return base::Error{base::ErrorCode::kVersion, "face value: version " + std::to_string(version) +
                                                      ", this program reads " + std::to_string(kVersion)};
  if (crc != checksum(bytes)) return badValue("checksum differs");
  if (kind > kImage) return badValue("unknown kind " + std::to_string(kind));
  if (children > (kind == kEmpty ? 0 : kAllChildren)) return badValue("children that no tile has");

  FaceValue value;
  value.empty = kind == kEmpty;
  value.children = children;
  if (!value.empty) {
    const std::uint32_t picture_bytes = in.u32();
    const std::uint32_t coverage_bytes = in.u32();
    value.picture = in.bytes(picture_bytes);
    value.coverage = in.bytes(coverage_bytes);
    if (in.ok() && value.picture.empty()) return badValue("an image of no bytes");
  }
  if (!in.atEnd()) return badValue("lengths do not add up");
  return value;
}

}  // namespace repository
