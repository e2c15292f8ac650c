#include "mesh/texture.h"

#include <turbojpeg.h>
#include <webp/decode.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <optional>

#include "base/file.h"
#include "base/format_text.h"
#include "base/jpeg/blocks.h"
#include "base/parallel.h"
#include "base/png/png.h"
#include "mesh/uri.h"

namespace mesh {
namespace {

using base::Error;
using base::ErrorCode;
using base::Image;

constexpr int kMaxSide = 16384;  // pixels: 1 GB as RGBA, and the largest side of common GPUs' textures
// JPEGs whose coded bytes and units take more memory are read by libjpeg, which needs next to none. A choice: it is
// enough for 25 megabytes of JPEG.
constexpr std::size_t kMaxUnitBytes = std::size_t{32} << 20;
constexpr double kMinTexelsToWarn = 1.5;  // per vertex; below, next to nothing is lost
// A corner's colour is a mean over its share of the polygon: so many texels lie between two samples, along each side of
// it, and at most so many samples. A sample is itself a mean over half of that, and lies a little nearer to the
// polygon's middle, so that what lies beyond a seam in the picture does not count.
constexpr double kTexelsApart = 3.0;
constexpr int kMostApart = 4;
constexpr double kInward = 0.1;
// A quarter of the picture's size is enough for shares of so many texels (triangles of 384). In photographs colours are
// as near to the exact means then as those from the whole picture; beside a seam against black they are off by 2 %, and
// by 10 % with shares of a third of that.
constexpr double kQuarterShare = 128.0;

bool exists(const std::string& path) {
  std::error_code ignored;
  return std::filesystem::exists(path, ignored);
}

// The file of this name in a folder, in whatever case its letters are; empty where there is none.
std::string inAnyCase(const std::string& folder, const std::string& name) {
  const auto lower = [](std::string text) {
    std::transform(text.begin(), text.end(), text.begin(), [](char c) { return c >= 'A' && c <= 'Z' ? c + 32 : c; });
    return text;
  };
  std::string found;
  std::error_code failed;
  for (std::filesystem::directory_iterator entry(folder.empty() ? "." : folder, failed), end; !failed && entry != end;
       entry.increment(failed)) {
    const std::string other = entry->path().filename().string();
    if (lower(other) == lower(name) && (found.empty() || other < found)) found = other;
  }
  return found.empty() ? found : folder + found;
}

// Where the file lies that the mesh file `mesh` names; where it would lie, if nowhere.
std::string fileNamed(std::string name, const std::string& mesh) {
  std::replace(name.begin(), name.end(), '\\', '/');
  const std::string folder = mesh.substr(0, mesh.rfind('/') + 1);
  const bool is_whole = !name.empty() && (name[0] == '/' || name.substr(1, 2) == ":/");
  std::string path = is_whole ? name : folder + name;
  if (name.empty() || exists(path)) return path;
  const std::size_t slash = path.rfind('/') + 1;
  if (std::string found = inAnyCase(path.substr(0, slash), path.substr(slash)); !found.empty()) return found;
  if (std::string found = inAnyCase(folder, name.substr(name.rfind('/') + 1)); !found.empty()) return found;
  return path;
}

// CMYK as Adobe's programs write it: inverted, so that 255 is no ink.
void rgbFromCmyk(const std::vector<std::uint8_t>& cmyk, Image& image) {
  for (std::size_t i = 0; i < cmyk.size() / 4; ++i)
    for (std::size_t k = 0; k < 3; ++k)
      image.pixels[3 * i + k] = static_cast<std::uint8_t>(cmyk[4 * i + k] * cmyk[4 * i + 3] / 255);
}

// TurboJPEG's decoder with a JPEG's header.
struct CloseDecoder {
  void operator()(void* handle) const { tjDestroy(handle); }
};
struct JpegHeader {
  std::unique_ptr<void, CloseDecoder> decoder{tjInitDecompress()};
  glm::ivec2 size{0};
  int space = 0;  // TJCS
};
base::Result<JpegHeader> readJpegHeader(base::ByteView bytes) {
  JpegHeader header;
  int samples = 0;
  const auto size = static_cast<unsigned long>(bytes.size());
  if (!header.decoder || bytes.empty() ||
      tjDecompressHeader3(header.decoder.get(), bytes.data(), size, &header.size.x, &header.size.y, &samples,
                          &header.space) != 0)
    return Error{ErrorCode::kInvalidInput, "not a JPEG that can be read"};
  return header;
}

// At 1, 1/2 or 1/4 of its size, rounded up.
base::Result<Image> decodeJpeg(base::ByteView bytes, int level = 0) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto header, readJpegHeader(bytes));
  auto [width, height] = std::pair(header.size.x, header.size.y);
  const auto size = static_cast<unsigned long>(bytes.size());
  if (std::max(width, height) > kMaxSide)
    return Error{ErrorCode::kUnsupported, "a JPEG of " + std::to_string(width) + " x " + std::to_string(height) +
                                              " pixels; at most " + std::to_string(kMaxSide) + " on a side are read"};
  const int step = 1 << level;
  width = (width + step - 1) / step, height = (height + step - 1) / step;
  Image image(width, height, 3);
  const bool cmyk = header.space == TJCS_CMYK || header.space == TJCS_YCCK;
  std::vector<std::uint8_t> inks(cmyk ? image.pixels.size() / 3 * 4 : 0);
  std::uint8_t* const to = cmyk ? inks.data() : image.pixels.data();
  if (tjDecompress2(header.decoder.get(), bytes.data(), size, to, width, 0, height, cmyk ? TJPF_CMYK : TJPF_RGB, 0) !=
      0)
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

Image cropped(Image image, int width, int height) {
  if (image.width == width && image.height == height) return image;
  Image out(width, height, image.channels);
  const auto row = static_cast<std::size_t>(width) * static_cast<std::size_t>(image.channels);
  for (int y = 0; y < height; ++y) std::copy_n(image.at(0, y), row, out.at(0, y));
  return out;
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

// Gives pixels whose alpha is 0 the colour of the nearest that is seen, or nearly so (Danielsson 1980). Pictures of
// leaves have any colour there, which would darken leaves that are far, and draw a line around those that are near.
// Means of several would mix in gaps between charts, which are often black and seen.
void fillUnseen(Image& image) {
  constexpr glm::ivec2 kNone(-1);
  const int width = image.width, height = image.height;
  std::vector<glm::i16vec2> nearest(image.pixels.size() / 4, glm::i16vec2(kNone));
  const auto at = [&](int x, int y) -> glm::i16vec2& {
    return nearest[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)];
  };
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      if (image.at(x, y)[3] != 0) at(x, y) = glm::i16vec2(x, y);
  const auto distance2 = [](const glm::ivec2& to, int x, int y) {
    return (to.x - x) * (to.x - x) + (to.y - y) * (to.y - y);
  };
  const auto tryNeighbour = [&](int x, int y, int u, int v) {
    if (u < 0 || v < 0 || u >= width || v >= height) return;
    const glm::ivec2 known(at(x, y)), found(at(u, v));
    if (found == kNone || (known != kNone && distance2(known, x, y) <= distance2(found, x, y))) return;
    at(x, y) = glm::i16vec2(found);
  };
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x)
      for (int side = -1; side <= 1; ++side) tryNeighbour(x, y, x + side, y - 1);
    for (int x = 1; x < width; ++x) tryNeighbour(x, y, x - 1, y);
    for (int x = width - 1; x-- > 0;) tryNeighbour(x, y, x + 1, y);
  }
  for (int y = height - 1; y >= 0; --y) {
    for (int x = 0; x < width; ++x)
      for (int side = -1; side <= 1; ++side) tryNeighbour(x, y, x + side, y + 1);
    for (int x = 1; x < width; ++x) tryNeighbour(x, y, x - 1, y);
    for (int x = width - 1; x-- > 0;) tryNeighbour(x, y, x + 1, y);
  }
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      if (const glm::ivec2 from(at(x, y)); from != kNone) std::copy_n(image.at(from.x, from.y), 3, image.at(x, y));
}

int wrapped(double i, int size) {
  if (i >= 0.0 && i < size) return static_cast<int>(i);  // as most are, without a division
  const double r = i - std::floor(i / size) * size;
  return std::clamp(static_cast<int>(r), 0, size - 1);
}

}  // namespace

base::Result<Image> decodePicture(base::ByteView bytes, bool opaque) {
  const std::string_view begin = base::textOf(bytes).substr(0, 12);
  if (begin.substr(0, 7) == "\xABKTX 20" || begin.substr(0, 7) == "\xABKTX 11")
    return Error{ErrorCode::kUnsupported, "it is KTX, which is not read; write the textures as JPEG, PNG or WebP"};
  const bool png = begin.substr(0, 4) == "\x89PNG";
  const bool webp = begin.substr(0, 4) == "RIFF" && begin.size() == 12 && begin.substr(8) == "WEBP";
  LUMIGRID_ASSIGN_OR_RETURN(auto image, png ? base::decodePng(bytes) : webp ? decodeWebp(bytes) : decodeJpeg(bytes));
  if (image.empty() || std::max(image.width, image.height) > kMaxSide)
    return Error{ErrorCode::kUnsupported, "a picture of more than " + std::to_string(kMaxSide) + " pixels on a side"};
  if (image.channels != 4 || opaque) return asRgb(std::move(image));
  fillUnseen(image);
  return image;
}

base::Result<glm::ivec2> pictureSize(base::ByteView bytes) {
  const std::string_view begin = base::textOf(bytes).substr(0, 12);
  if (begin.substr(0, 4) == "\x89PNG" && bytes.size() >= 24) {
    // The first chunk, after 8 bytes of magic, its length and its name.
    const auto number = [&](std::size_t at) {
      return (bytes[at] << 24) | (bytes[at + 1] << 16) | (bytes[at + 2] << 8) | bytes[at + 3];
    };
    const glm::ivec2 size(number(16), number(20));
    if (std::min(size.x, size.y) < 1 || std::max(size.x, size.y) > kMaxSide)
      return Error{ErrorCode::kUnsupported, "a PNG whose sides are not 1 to " + std::to_string(kMaxSide) + " pixels"};
    return size;
  }
  if (begin.substr(0, 4) == "RIFF") {
    WebPBitstreamFeatures features;
    if (WebPGetFeatures(bytes.data(), bytes.size(), &features) != VP8_STATUS_OK)
      return Error{ErrorCode::kInvalidInput, "not a WebP that can be read"};
    return glm::ivec2(features.width, features.height);
  }
  LUMIGRID_ASSIGN_OR_RETURN(const auto header, readJpegHeader(bytes));
  return header.size;
}

base::Result<PictureBytes> PictureBytes::open(const SourcePicture& picture) {
  LUMIGRID_ASSIGN_OR_RETURN(auto file, base::MappedFile::open(picture.path));
  PictureBytes opened(std::move(file));
  base::ByteView bytes = opened.file_.bytes();
  if (picture.offset > bytes.size() || picture.bytes > bytes.size() - picture.offset)
    return Error{ErrorCode::kInvalidInput, picture.path + ": truncated: a picture reaches past its end"};
  bytes = bytes.subspan(static_cast<std::size_t>(picture.offset));
  if (picture.bytes > 0) bytes = bytes.first(static_cast<std::size_t>(picture.bytes));
  opened.view_ = bytes;
  if (picture.base64) {
    opened.decoded_ = bytesOfBase64(base::textOf(bytes));
    if (!opened.decoded_) return Error{ErrorCode::kInvalidInput, picture.path + ": a picture is broken base64"};
  }
  return opened;
}

base::Result<Image> readPicture(const SourcePicture& picture) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, PictureBytes::open(picture));
  auto image = decodePicture(bytes.view(), picture.opaque);
  return image ? std::move(image) : base::within(picture.path, image.error());
}

Texture::Texture(Image picture) {
  size_ = {picture.width, picture.height};
  levels_.push_back(asRgb(std::move(picture)));
  halve();
}

void Texture::halve() {
  while (std::max(levels_.back().width, levels_.back().height) > 1) levels_.push_back(halved(levels_.back()));
}

base::Result<Texture> Texture::decode(base::ByteView bytes, int first_level, base::Bytes* units, bool opaque) {
  if (const auto header = readJpegHeader(bytes); header && first_level > 0) {
    if (first_level == 2)
      if (auto quarter = base::JpegBlocks::readQuarter(bytes, kMaxUnitBytes)) {
        if (units != nullptr) *units = std::move(quarter->units);
        Texture texture(std::move(quarter->picture));
        texture.size_ = header->size;
        texture.first_level_ = first_level;
        return texture;
      }
    // A decoder's smaller pictures are means of its blocks, whose last column and row may be of a part of a block only.
    LUMIGRID_ASSIGN_OR_RETURN(auto image, decodeJpeg(bytes, first_level));
    const glm::ivec2 size = glm::max(header->size >> first_level, 1);
    Texture texture(cropped(std::move(image), size.x, size.y));
    texture.size_ = header->size;
    texture.first_level_ = first_level;
    return texture;
  }
  LUMIGRID_ASSIGN_OR_RETURN(auto image, decodePicture(bytes, opaque));
  return Texture(std::move(image));
}

std::size_t Texture::bytes() const {
  std::size_t sum = 0;
  for (const Image& level : levels_) sum += level.pixels.size();
  return sum;
}

int Texture::levelFor(double texels) {
  constexpr double kMost = 14.0;  // of the largest picture
  const double level = std::round(std::log2(std::max(texels, 1.0)));
  return level <= kMost ? static_cast<int>(level) : static_cast<int>(kMost);  // for NaN, too
}

glm::u8vec4 Texture::mean(const glm::dvec2& uv, double texels) const {
  return mean(Quad{uv, uv, uv, uv}, 1, texels);
}

glm::u8vec4 Texture::mean(const Quad& quad, int n, double texels) const {
  const int last = static_cast<int>(levels_.size()) - 1;
  const Image& image = levels_[static_cast<std::size_t>(std::clamp(levelFor(texels) - first_level_, 0, last))];
  Quad at;  // in pixels from the middle of the first
  for (std::size_t k = 0; k < quad.size(); ++k) {
    at[k] = quad[k] * glm::dvec2(image.width, image.height) - 0.5;
    if (!std::isfinite(at[k].x) || !std::isfinite(at[k].y)) return {128, 128, 128, 255};
  }
  // Samples lie between the corners but for rounding, so most need not be looked at for whether they wrap around.
  constexpr double kSafe = 1.0;
  const glm::dvec2 low = glm::min(glm::min(at[0], at[1]), glm::min(at[2], at[3]));
  const glm::dvec2 high = glm::max(glm::max(at[0], at[1]), glm::max(at[2], at[3]));
  const glm::dvec2 end(image.width, image.height);
  const bool inside = std::min(low.x, low.y) >= kSafe && high.x < end.x - 1.0 - kSafe && high.y < end.y - 1.0 - kSafe;

  // Each sample is interpolated between the four nearest pixels, with weights in 1/kSteps of a pixel.
  constexpr int kSteps = 256;
  std::array<std::uint32_t, 3> sum{};
  const glm::dvec2 along = at[1] - at[0], down = at[2] - at[0], both = at[3] - at[1] - down;
  const double apart = 1.0 / n;
  for (int j = 0; j < n; ++j) {
    const double t = (j + 0.5) * apart;
    const glm::dvec2 begin = at[0] + t * down, step = along + t * both;
    for (int i = 0; i < n; ++i) {
      const glm::dvec2 p = begin + (i + 0.5) * apart * step;
      std::array<int, 2> xs{}, ys{};
      glm::dvec2 whole;
      if (inside) {
        xs[0] = static_cast<int>(p.x), ys[0] = static_cast<int>(p.y);
        xs[1] = xs[0] + 1, ys[1] = ys[0] + 1;
        whole = {xs[0], ys[0]};
      } else {
        whole = glm::floor(p);
        xs = {wrapped(whole.x, image.width), wrapped(whole.x + 1, image.width)};
        ys = {wrapped(whole.y, image.height), wrapped(whole.y + 1, image.height)};
      }
      const auto right = static_cast<std::uint32_t>((p.x - whole.x) * kSteps + 0.5);
      const auto below = static_cast<std::uint32_t>((p.y - whole.y) * kSteps + 0.5);
      const std::uint8_t *a = image.at(xs[0], ys[0]), *b = image.at(xs[1], ys[0]);
      const std::uint8_t *c = image.at(xs[0], ys[1]), *d = image.at(xs[1], ys[1]);
      for (std::size_t k = 0; k < 3; ++k)
        sum[k] += (kSteps - below) * ((kSteps - right) * a[k] + right * b[k]) +
                  below * ((kSteps - right) * c[k] + right * d[k]);
    }
  }
  const auto all = static_cast<std::uint32_t>(n * n * kSteps * kSteps);
  glm::u8vec4 color(255);
  for (int k = 0; k < 3; ++k) color[k] = static_cast<std::uint8_t>((sum[static_cast<std::size_t>(k)] + all / 2) / all);
  return color;
}

namespace {

// A polygon's area, texels.
double texelsOf(const glm::dvec2& size, std::span<const glm::dvec2> uv) {
  double area = 0.0;
  for (std::size_t i = 0; i < uv.size(); ++i) {
    const glm::dvec2 a = size * uv[i], b = size * uv[(i + 1) % uv.size()];
    area += 0.5 * (a.x * b.y - a.y * b.x);
  }
  return std::abs(area);
}
// A corner's share of a polygon: its area in texels, how many samples of it are taken along each side of it, and over
// how many texels a side each of them is a mean.
struct Share {
  double area;
  int samples;
  double mean_texels;
};
Share shareOf(double polygon, std::size_t corners) {
  const double area = polygon / static_cast<double>(std::max<std::size_t>(1, corners));
  const int n = std::isfinite(area) ? std::clamp(static_cast<int>(std::sqrt(area) / kTexelsApart), 1, kMostApart) : 1;
  return {area, n, 0.5 * std::sqrt(area) / n};
}

}  // namespace

int TextureBaker::levelFor(const glm::ivec2& size, std::span<const glm::dvec2> uv) {
  const Share share = shareOf(texelsOf(glm::dvec2(size), uv), uv.size());
  return share.area >= kQuarterShare ? kCoarsest : std::min(kCoarsest, Texture::levelFor(share.mean_texels));
}

void TextureBaker::bake(const Texture& texture, std::span<const glm::dvec2> uv, std::span<glm::u8vec4> colors) {
  glm::dvec2 middle(0.0);
  for (const glm::dvec2& p : uv) middle += p / static_cast<double>(uv.size());
  const double area = texelsOf({texture.width(), texture.height()}, uv);
  if (std::isfinite(area)) texels_ += area;

  // A corner's share of the polygon is the quadrilateral between it, the middles of its edges and the polygon's middle.
  const Share share = shareOf(area, uv.size());
  for (std::size_t i = 0; i < uv.size(); ++i) {
    const glm::dvec2 before = 0.5 * (uv[i] + uv[(i + uv.size() - 1) % uv.size()]);
    const glm::dvec2 after = 0.5 * (uv[i] + uv[(i + 1) % uv.size()]);
    Texture::Quad quad{uv[i], after, before, middle};
    for (glm::dvec2& corner : quad) corner = glm::mix(corner, middle, kInward);
    colors[i] = texture.mean(quad, share.samples, share.mean_texels);
  }
}

std::string lostTexels(double texels, std::uint64_t vertices) {
  const double ratio = texels / static_cast<double>(std::max<std::uint64_t>(1, vertices));
  if (!(ratio > kMinTexelsToWarn)) return {};
  return base::formatText(
      "its textures have %.1f texels for every vertex; one colour per vertex is kept, finer ones are lost", ratio);
}

const std::string& Textures::pathOf(const std::string& name) {
  const auto [known, is_new] = paths_.try_emplace(name);
  if (is_new) known->second = fileNamed(name, path_);
  return known->second;
}

namespace {

base::Result<glm::ivec2> sizeOf(const base::Result<PictureBytes>& bytes) {
  return bytes ? pictureSize(bytes->view()) : base::Result<glm::ivec2>(bytes.error());
}

// The level that a polygon needs of a picture; the coarsest where that cannot be told.
int levelNeeded(const SourcePicture& picture, std::span<const glm::dvec2> uv) {
  const auto size = sizeOf(PictureBytes::open(picture));
  return size && !uv.empty() ? TextureBaker::levelFor(*size, uv) : TextureBaker::kCoarsest;
}

}  // namespace

std::uint32_t Textures::find(const SourcePicture& picture, std::span<const glm::dvec2> uv,
                             std::vector<std::string>& warnings) {
  if (last_ < known_.size() && known_[last_].picture == picture) return last_;
  if (std::find(unreadable_.begin(), unreadable_.end(), picture) != unreadable_.end()) return kNoPicture;
  auto known = std::find_if(known_.begin(), known_.end(), [&](const Known& k) { return k.picture == picture; });
  if (known == known_.end() || known->decoded == nullptr) {
    const int before = known == known_.end() ? TextureBaker::kCoarsest : needed_[known->order];
    auto texture = decoded(picture, std::min(before, levelNeeded(picture, uv)));
    if (!texture) {
      unreadable_.push_back(picture);
      if (unreadable_.size() > kMaxNamed) return kNoPicture;
      warnings.push_back("a texture cannot be read, vertex colours stay: " + texture.error().message);
      return kNoPicture;
    }
    if (known == known_.end()) known = known_.insert(known_.end(), Known{picture, nullptr, 0, 0});
    known->decoded = std::make_unique<Texture>(std::move(*texture));
    known->order = needed_.size() - 1;
    forgetOldest(*known);
  }
  known->used = ++uses_;
  last_ = static_cast<std::uint32_t>(known - known_.begin());
  return last_;
}

namespace {

// The memory that decoding a picture takes; 0 where its size cannot be told.
std::size_t decodingBytes(const SourcePicture& picture, int first_level) {
  const auto bytes = PictureBytes::open(picture);
  const auto size = sizeOf(bytes);
  if (!size) return 0;
  const std::size_t decoded = static_cast<std::size_t>(size->x) * static_cast<std::size_t>(size->y) * 4;
  const std::size_t coded = first_level == 2 ? std::min(bytes->view().size() / 8 * 9, kMaxUnitBytes) : 0;
  return (decoded >> (2 * first_level)) + coded;
}

}  // namespace

base::Result<Texture> Textures::decodeFile(const SourcePicture& picture, int first_level) const {
  LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, PictureBytes::open(picture));
  base::Bytes units;
  auto texture = Texture::decode(bytes.view(), first_level, &units, picture.opaque);
  if (!texture) return base::within(picture.path, texture.error());
  if (keep_units_ && !units.empty()) keep_units_(picture, units);
  return texture;
}

const Texture& Textures::fine(std::uint32_t number, int level) {
  Known& known = known_[number];
  int& needed = needed_[known.order];
  needed = std::min(needed, level);
  if (needed < known.decoded->firstLevel())
    if (auto finer = decodeFile(known.picture, needed)) {
      *known.decoded = std::move(*finer);
      forgetOldest(known);
    }
  return *known.decoded;
}

// The level at which pictures are decoded of which nothing is known.
int Textures::usualLevel() const {
  int level = TextureBaker::kCoarsest;
  for (std::size_t i = needed_.size() - std::min(needed_.size(), kUsual); i < needed_.size(); ++i)
    level = std::min(level, needed_[i]);
  return level;
}

// The next picture to decode. Its level depends on what came before in the file, and not on the level at which it was
// begun ahead, so that colours do not depend on how many are. Pictures ahead are begun in their order, so those before
// this one are not needed soon.
base::Result<Texture> Textures::decoded(const SourcePicture& picture, int needed) {
  const int first_level = std::min(needed, usualLevel());
  needed_.push_back(needed);
  const auto found =
      std::find_if(ahead_.begin(), ahead_.end(), [&](const Ahead& ahead) { return ahead.picture == picture; });
  std::future<base::Result<Texture>> waiting;
  if (found != ahead_.end()) {
    if (found->first_level == first_level) waiting = std::move(found->texture);
    ahead_.erase(ahead_.begin(), found + 1);
  }
  decodeAhead(picture);
  return waiting.valid() ? waiting.get() : decodeFile(picture, first_level);
}

void Textures::decodeAhead(const SourcePicture& last) {
  const auto at = std::find(expected_.begin(), expected_.end(), last);
  if (at == expected_.end()) return;
  const std::size_t most = base::coreCount();
  const auto isAhead = [&](const SourcePicture& p) {
    return std::any_of(ahead_.begin(), ahead_.end(), [&](const Ahead& ahead) { return ahead.picture == p; });
  };
  const auto isKnown = [&](const SourcePicture& p) {
    return std::any_of(known_.begin(), known_.end(), [&](const Known& known) { return known.picture == p; });
  };
  std::size_t bytes = 0;
  for (const Ahead& ahead : ahead_) bytes += ahead.bytes;
  for (auto next = at + 1; next != expected_.end() && ahead_.size() < most; ++next) {
    if (isAhead(*next) || isKnown(*next)) continue;
    const int first_level = usualLevel();
    const std::size_t needed = decodingBytes(*next, first_level);
    if (needed == 0 || bytes + needed > kAheadBytes) return;
    bytes += needed;
    ahead_.push_back(
        {*next, needed, first_level, std::async(std::launch::async, &Textures::decodeFile, this, *next, first_level)});
  }
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
