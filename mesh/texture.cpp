#include "mesh/texture.h"

#include <turbojpeg.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "base/file.h"
#include "base/format_text.h"
#include "base/png/png.h"

namespace mesh {
namespace {

using base::Error;
using base::ErrorCode;
using base::Image;

constexpr int kMaxSide = 16384;           // pixels: 1 GB as RGBA, and the largest side of common GPUs' textures
constexpr double kMinTexelsToWarn = 1.5;  // per vertex; below, next to nothing is lost
constexpr double kInward = 0.2;           // samples lie this share of the way from the corner to the polygon's middle

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
  if (tjDecompress2(handle.get(), bytes.data(), size, image.pixels.data(), width, 0, height, TJPF_RGB, 0) != 0)
    return Error{ErrorCode::kInvalidInput, "a broken JPEG"};
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

base::Result<Texture> Texture::decode(base::ByteView bytes) {
  constexpr std::array<std::uint8_t, 4> kPng{0x89, 'P', 'N', 'G'};
  const bool png = bytes.size() > 4 && std::equal(kPng.begin(), kPng.end(), bytes.begin());
  LUMIGRID_ASSIGN_OR_RETURN(auto image, png ? base::decodePng(bytes) : decodeJpeg(bytes));
  if (image.empty() || std::max(image.width, image.height) > kMaxSide)
    return Error{ErrorCode::kUnsupported, "a picture of more than " + std::to_string(kMaxSide) + " pixels on a side"};
  Texture out;
  out.levels_.push_back(asRgb(std::move(image)));
  while (std::max(out.levels_.back().width, out.levels_.back().height) > 1)
    out.levels_.push_back(halved(out.levels_.back()));
  return out;
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
  if (std::isfinite(area)) texels_ += std::abs(area);
  for (std::size_t i = 0; i < uv.size(); ++i) {
    const glm::dvec2& before = uv[(i + uv.size() - 1) % uv.size()];
    const glm::dvec2& after = uv[(i + 1) % uv.size()];
    const double reach = 0.25 * (glm::length(size * (before - uv[i])) + glm::length(size * (after - uv[i])));
    colors[i] = texture.mean(glm::mix(uv[i], middle, kInward), reach);
  }
}

std::string TextureBaker::warning(std::uint64_t vertices) const {
  const double ratio = texels_ / static_cast<double>(std::max<std::uint64_t>(1, vertices));
  if (!(ratio > kMinTexelsToWarn)) return {};
  return base::formatText(
      "its textures have %.1f texels for every vertex; one colour per vertex is kept, what is finer is lost", ratio);
}

base::Result<base::Bytes> TextureFiles::read(const std::string& name) const {
  // Windows programs write backslashes.
  std::string path = name;
  std::replace(path.begin(), path.end(), '\\', '/');
  return base::readFile(path.empty() || path[0] == '/' || directory_.empty() ? path : directory_ + "/" + path);
}

const Texture* TextureFiles::find(const std::string& name, std::vector<std::string>& warnings) {
  const auto at = textures_.find(name);
  if (at != textures_.end()) return at->second.get();
  std::unique_ptr<Texture>& texture = textures_[name];
  const auto bytes = read(name);
  if (!bytes) {
    warnings.push_back("its texture cannot be read, vertex colours stay: " + bytes.error().message);
    return nullptr;
  }
  auto decoded = Texture::decode(*bytes);
  if (!decoded) {
    warnings.push_back("its texture " + name + " cannot be read, vertex colours stay: " + decoded.error().message);
    return nullptr;
  }
  texture = std::make_unique<Texture>(std::move(*decoded));
  return texture.get();
}

}  // namespace mesh
