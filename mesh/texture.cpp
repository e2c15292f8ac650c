#include "mesh/texture.h"

#include <turbojpeg.h>
#include <webp/decode.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "base/file.h"
#include "base/format_text.h"
#include "base/png/png.h"
#include "mesh/uri.h"

namespace mesh {
namespace {

using base::Error;
using base::ErrorCode;
using base::Image;

constexpr int kMaxSide = 16384;           // pixels: 1 GB as RGBA, and the largest side of common GPUs' textures
constexpr double kMinTexelsToWarn = 1.5;  // per vertex; below, next to nothing is lost
// A corner's colour is a mean over its share of the polygon: so many texels lie between two samples, along each side of
// it, and at most so many samples. A sample is itself a mean over half of that, and lies a little nearer to the
// polygon's middle, so that what lies beyond a seam in the picture does not count.
constexpr double kTexelsApart = 3.0;
constexpr int kMostApart = 4;
constexpr double kInward = 0.1;

// CMYK as Adobe's programs write it: inverted, so that 255 is no ink.
void rgbFromCmyk(const std::vector<std::uint8_t>& cmyk, Image& image) {
  for (std::size_t i = 0; i < cmyk.size() / 4; ++i)
    for (std::size_t k = 0; k < 3; ++k)
      image.pixels[3 * i + k] = static_cast<std::uint8_t>(cmyk[4 * i + k] * cmyk[4 * i + 3] / 255);
}

base::Result<Image> decodeJpeg(base::ByteView bytes) {
  struct Close {
    void operator()(void* handle) const { tjDestroy(handle); }
  };
  const std::unique_ptr<void, Close> handle(tjInitDecompress());
  int width = 0, height = 0, samples = 0, space = 0;
  const auto size = static_cast<unsigned long>(bytes.size());
  if (!handle || tjDecompressHeader3(handle.get(), bytes.data(), size, &width, &height, &samples, &space) != 0)
    return Error{ErrorCode::kInvalidInput, "not a JPEG that can be read"};
  if (std::max(width, height) > kMaxSide)
    return Error{ErrorCode::kUnsupported, "a JPEG of " + std::to_string(width) + " x " + std::to_string(height) +
                                              " pixels; at most " + std::to_string(kMaxSide) + " on a side are read"};
  Image image(width, height, 3);
  const bool cmyk = space == TJCS_CMYK || space == TJCS_YCCK;
  std::vector<std::uint8_t> inks(cmyk ? image.pixels.size() / 3 * 4 : 0);
  std::uint8_t* const to = cmyk ? inks.data() : image.pixels.data();
  if (tjDecompress2(handle.get(), bytes.data(), size, to, width, 0, height, cmyk ? TJPF_CMYK : TJPF_RGB, 0) != 0)
    return Error{ErrorCode::kInvalidInput, "a broken JPEG"};
  if (cmyk) rgbFromCmyk(inks, image);
  return image;
}

// A picture without alpha becomes 3 channels.
base::Result<Image> decodeWebp(base::ByteView bytes) {
  WebPBitstreamFeatures features;
  if (WebPGetFeatures(bytes.data(), bytes.size(), &features) != VP8_STATUS_OK || features.has_animation != 0)
    return Error{ErrorCode::kInvalidInput, "not a WebP that can be read"};
  Image image(features.width, features.height, features.has_alpha != 0 ? 4 : 3);
  const auto decode = features.has_alpha != 0 ? WebPDecodeRGBAInto : WebPDecodeRGBInto;
  if (decode(bytes.data(), bytes.size(), image.pixels.data(), image.pixels.size(), image.channels * image.width) ==
      nullptr)
    return Error{ErrorCode::kInvalidInput, "a broken WebP"};
  return image;
}

Image asRgb(Image image) {
  if (image.channels == 3) return image;
  Image rgb(image.width, image.height, 3);
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x)
      for (int k = 0; k < 3; ++k) rgb.at(x, y)[k] = image.at(x, y)[image.channels == 1 ? 0 : k];
  return rgb;
}

Image halved(const Image& image) {
  Image out(std::max(1, image.width / 2), std::max(1, image.height / 2), 3);
  for (int y = 0; y < out.height; ++y)
    for (int x = 0; x < out.width; ++x) {
      const int x1 = std::min(2 * x + 1, image.width - 1), y1 = std::min(2 * y + 1, image.height - 1);
      for (int k = 0; k < 3; ++k) {
        const int sum =
            image.at(2 * x, 2 * y)[k] + image.at(x1, 2 * y)[k] + image.at(2 * x, y1)[k] + image.at(x1, y1)[k];
        out.at(x, y)[k] = static_cast<std::uint8_t>((sum + 2) / 4);
      }
    }
  return out;
}

int wrapped(double i, int size) {
  const double r = i - std::floor(i / size) * size;
  return std::clamp(static_cast<int>(r), 0, size - 1);
}

}  // namespace

base::Result<Image> decodePicture(base::ByteView bytes) {
  const std::string_view begin = base::textOf(bytes).substr(0, 12);
  if (begin.substr(0, 7) == "\xABKTX 20" || begin.substr(0, 7) == "\xABKTX 11")
    return Error{ErrorCode::kUnsupported, "it is KTX, which is not read; write the textures as JPEG, PNG or WebP"};
  const bool png = begin.substr(0, 4) == "\x89PNG";
  const bool webp = begin.substr(0, 4) == "RIFF" && begin.size() == 12 && begin.substr(8) == "WEBP";
  LUMIGRID_ASSIGN_OR_RETURN(auto image, png ? base::decodePng(bytes) : webp ? decodeWebp(bytes) : decodeJpeg(bytes));
  if (image.empty() || std::max(image.width, image.height) > kMaxSide)
    return Error{ErrorCode::kUnsupported, "a picture of more than " + std::to_string(kMaxSide) + " pixels on a side"};
  return image.channels == 4 ? std::move(image) : asRgb(std::move(image));
}

base::Result<Image> readPicture(const SourcePicture& picture) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, base::MappedFile::open(picture.path));
  base::ByteView bytes = file.bytes();
  if (picture.offset > bytes.size() || picture.bytes > bytes.size() - picture.offset)
    return Error{ErrorCode::kInvalidInput, picture.path + ": truncated: a picture reaches past its end"};
  bytes = bytes.subspan(static_cast<std::size_t>(picture.offset));
  if (picture.bytes > 0) bytes = bytes.first(static_cast<std::size_t>(picture.bytes));
  std::optional<base::Bytes> decoded;
  if (picture.base64) {
    decoded = bytesOfBase64(base::textOf(bytes));
    if (!decoded) return Error{ErrorCode::kInvalidInput, picture.path + ": a picture is broken base64"};
    bytes = *decoded;
  }
  auto image = decodePicture(bytes);
  return image ? std::move(image) : base::within(picture.path, image.error());
}

Texture::Texture(Image picture) {
  levels_.push_back(asRgb(std::move(picture)));
  while (std::max(levels_.back().width, levels_.back().height) > 1) levels_.push_back(halved(levels_.back()));
}

base::Result<Texture> Texture::decode(base::ByteView bytes) {
  LUMIGRID_ASSIGN_OR_RETURN(auto image, decodePicture(bytes));
  return Texture(std::move(image));
}

std::size_t Texture::bytes() const {
  std::size_t sum = 0;
  for (const Image& level : levels_) sum += level.pixels.size();
  return sum;
}

glm::u8vec4 Texture::mean(const glm::dvec2& uv, double texels) const {
  const double level = std::round(std::log2(std::max(texels, 1.0)));
  const Image& image =
      levels_[static_cast<std::size_t>(std::clamp(level, 0.0, static_cast<double>(levels_.size() - 1)))];
  if (!std::isfinite(uv.x) || !std::isfinite(uv.y)) return {128, 128, 128, 255};

  // The result is interpolated between the four nearest texels.
  const glm::dvec2 p = uv * glm::dvec2(image.width, image.height) - 0.5;
  const glm::dvec2 low = glm::floor(p);
  const glm::dvec2 share = p - low;
  glm::dvec3 sum(0.0);
  for (int k = 0; k < 4; ++k) {
    const std::uint8_t* c = image.at(wrapped(low.x + (k & 1), image.width), wrapped(low.y + (k >> 1), image.height));
    const double weight = ((k & 1) != 0 ? share.x : 1.0 - share.x) * ((k >> 1) != 0 ? share.y : 1.0 - share.y);
    sum += weight * glm::dvec3(c[0], c[1], c[2]);
  }
  return {glm::u8vec3(glm::clamp(sum + 0.5, 0.0, 255.0)), 255};
}

void TextureBaker::bake(const Texture& texture, std::span<const glm::dvec2> uv, std::span<glm::u8vec4> colors) {
  const glm::dvec2 size(texture.width(), texture.height());
  glm::dvec2 middle(0.0);
  double area = 0.0;
  for (std::size_t i = 0; i < uv.size(); ++i) {
    const glm::dvec2 a = size * uv[i], b = size * uv[(i + 1) % uv.size()];
    middle += uv[i] / static_cast<double>(uv.size());
    area += 0.5 * (a.x * b.y - a.y * b.x);
  }
  area = std::abs(area);
  if (std::isfinite(area)) texels_ += area;

  // A corner's share of the polygon is the quadrilateral between it, the middles of its edges and the polygon's middle.
  const double share = area / static_cast<double>(std::max<std::size_t>(1, uv.size()));
  const int n = std::isfinite(share) ? std::clamp(static_cast<int>(std::sqrt(share) / kTexelsApart), 1, kMostApart) : 1;
  for (std::size_t i = 0; i < uv.size(); ++i) {
    const glm::dvec2 before = 0.5 * (uv[i] + uv[(i + uv.size() - 1) % uv.size()]);
    const glm::dvec2 after = 0.5 * (uv[i] + uv[(i + 1) % uv.size()]);
    glm::dvec3 sum(0.0);
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x) {
        const double s = (x + 0.5) / n, t = (y + 0.5) / n;
        const glm::dvec2 at = glm::mix(glm::mix(uv[i], after, s), glm::mix(before, middle, s), t);
        sum += glm::dvec3(glm::u8vec3(texture.mean(glm::mix(at, middle, kInward), 0.5 * std::sqrt(share) / n)));
      }
    colors[i] = {glm::u8vec3(sum / static_cast<double>(n * n) + 0.5), 255};
  }
}

std::string lostTexels(double texels, std::uint64_t vertices) {
  const double ratio = texels / static_cast<double>(std::max<std::uint64_t>(1, vertices));
  if (!(ratio > kMinTexelsToWarn)) return {};
  return base::formatText(
      "its textures have %.1f texels for every vertex; one colour per vertex is kept, finer ones are lost", ratio);
}

std::string Textures::pathOf(const std::string& name) const {
  std::string path = name;
  std::replace(path.begin(), path.end(), '\\', '/');
  const std::size_t slash = path_.rfind('/');
  return path.empty() || path[0] == '/' || slash == std::string::npos ? path : path_.substr(0, slash + 1) + path;
}

std::uint32_t Textures::find(const SourcePicture& picture, std::vector<std::string>& warnings) {
  if (last_ < known_.size() && known_[last_].picture == picture) return last_;
  if (std::find(unreadable_.begin(), unreadable_.end(), picture) != unreadable_.end()) return kNoPicture;
  auto known = std::find_if(known_.begin(), known_.end(), [&](const Known& k) { return k.picture == picture; });
  if (known == known_.end() || known->decoded == nullptr) {
    auto image = readPicture(picture);
    if (!image) {
      unreadable_.push_back(picture);
      if (unreadable_.size() > kMaxNamed) return kNoPicture;
      warnings.push_back("a texture cannot be read, vertex colours stay: " + image.error().message);
      return kNoPicture;
    }
    if (known == known_.end()) known = known_.insert(known_.end(), Known{picture, nullptr, 0});
    known->decoded = std::make_unique<Texture>(std::move(*image));
    forgetOldest(*known);
  }
  known->used = ++uses_;
  last_ = static_cast<std::uint32_t>(known - known_.begin());
  return last_;
}

void Textures::forgetOldest(const Known& but) {
  std::size_t kept = 0;
  for (const Known& k : known_) kept += k.decoded ? k.decoded->bytes() : 0;
  while (kept > kKeptBytes) {
    Known* oldest = nullptr;
    for (Known& k : known_)
      if (k.decoded && &k != &but && (oldest == nullptr || k.used < oldest->used)) oldest = &k;
    if (oldest == nullptr) return;
    kept -= oldest->decoded->bytes();
    oldest->decoded.reset();
  }
}

std::vector<SourcePicture> Textures::pictures() const {
  std::vector<SourcePicture> all;
  for (const Known& k : known_) all.push_back(k.picture);
  return all;
}

}  // namespace mesh
