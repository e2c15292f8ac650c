#pragma once
// Cuts a picture up into the pages of all leaves that show it. Pages copy the blocks of a JPEG where they can, so that
// nothing is decoded, coded or lost; others are cut out of the decoded picture (docs/formats/texture.md).
#include <glm/glm.hpp>

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"
#include "base/jpeg/blocks.h"
#include "lod/texture/page.h"

namespace lod::texture {

class PictureCharts;
class UnitCharts;

/// A page as decodePage() reads it.
struct EncodedPage {
  std::vector<PageTriangle> triangles;
  float scale = 1.0F;  ///< Page::scale
  base::Bytes bytes;
};

class PictureCutter {
 public:
  /// Returns the picture, 3 or 4 channels.
  using Decode = std::function<base::Result<base::Image>()>;

  /// `bytes` are the picture's file, `units` empty or what base::JpegBlocks::readQuarter told of it. Where
  /// they are a JPEG whose blocks can be copied, and take no more than 512 MiB of memory, it is decoded only if some
  /// leaf needs it; else at once. Errors: those of `decode`.
  static base::Result<PictureCutter> open(base::ByteView bytes, base::ByteView units, Decode decode);
  PictureCutter(PictureCutter&&) noexcept;
  ~PictureCutter();

  glm::ivec2 size() const { return size_; }  ///< texels
  /// Notes what a leaf shows of the picture; all leaves come before any is cut. Returns a number for cut(). Safe from
  /// several threads.
  std::uint32_t add(std::span<const PictureTriangle> leaf);
  /// Called once between the last add() and the first cut().
  void finish();
  /// Makes the pages of a leaf, whose triangles are those of add(). They depend on what was added and on nothing else.
  /// Safe from several threads. Errors: those of `decode`.
  base::Result<std::vector<EncodedPage>> cut(std::span<const PictureTriangle> leaf, std::uint32_t number);
  /// The colour of a texel, 0 to 255. 0 <= x < size().x, y likewise. Safe from several threads.
  glm::vec3 colorAt(int x, int y) const;

 private:
  explicit PictureCutter(Decode decode);
  base::Result<std::vector<EncodedPage>> cutBlocks(std::span<const PictureTriangle> leaf, std::uint32_t number) const;
  base::Result<void> needImage();

  glm::ivec2 size_{0};
  std::optional<base::JpegBlocks> blocks_;
  Decode decode_;
  std::unique_ptr<PictureCharts> charts_;
  std::unique_ptr<UnitCharts> units_;  // with blocks
  std::unique_ptr<std::mutex> mutex_;  // of image_, with blocks
  base::Image image_;                  // its gaps are filled by needImage(), or by finish() without blocks
};

}  // namespace lod::texture
