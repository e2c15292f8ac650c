#pragma once
// texture.lgt: a header, a table of pages, then the pages of a scene's leaf patches. docs/formats/texture.md
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "base/file.h"
#include "lod/texture/page.h"

namespace lod::texture {

struct TextureSummary {
  std::uint32_t patches = 0;        ///< of patch.lgp, with those that have no page
  std::uint32_t pictures = 0;       ///< source pictures
  std::uint64_t texels = 0;         ///< of the source pictures that triangles cover, at their own resolution
  std::uint64_t triangles = 0;      ///< leaf triangles with a texture: the sum over the pages
  std::uint32_t reduced_pages = 0;  ///< pages whose scale is below 1
  float typical_error = 0.0F;       ///< 0 … 1: root mean square difference of texels from the colours at vertices
};

/// A row of the table of pages.
struct PageRecord {
  std::uint32_t patch = 0;   ///< a leaf of patch.lgp
  std::uint64_t offset = 0;  ///< of its bytes in the file
  std::uint32_t bytes = 0;
  std::uint16_t width = 0, height = 0;  ///< texels
  std::uint8_t levels = 0;              ///< Page::levels
  bool alpha = false;
  std::uint16_t triangles = 0;
  float texel = 0.0F;  ///< mean edge of a texel on the surface, scene units; finite, above 0

  bool operator==(const PageRecord&) const = default;
};

/// Fills in all of a record that an encoded page says itself: all but patch, texel and offset. Errors: kInvalidInput.
base::Result<void> describePage(base::ByteView encoded, PageRecord& record);

/// Writes texture.lgt; it appears whole or not at all. `pages` are sorted by patch, and complete but for their offsets;
/// the writer adds up the summary's triangles. `bytes(i)` yields what encodePage() made of page i; called once per
/// page, ascending. `on_bytes`, if any, gets all bytes of the file in their order, as soon as they are written. Errors:
/// what the table would be refused for, a page that is not as its record says, what `bytes` returns, kNoSpace, kIo.
base::Result<void> writeTextureFile(const std::string& path, const TextureSummary& summary,
                                    std::span<const PageRecord> pages,
                                    const std::function<base::Result<base::Bytes>(std::size_t page)>& bytes,
                                    const std::function<void(base::Bytes)>& on_bytes = {});

/// A texture.lgt on disk. Opening checks header and table; pages are checked as they are read. It is read by position
/// and not mapped: a file that is cut while it is open gives an error. Safe to use from several threads.
class TextureFile {
 public:
  /// Errors name the file and the place. kNotFound, kIo; kVersion for a newer format; kInvalidInput for a damaged or
  /// cut file.
  static base::Result<TextureFile> open(const std::string& path);
  const TextureSummary& summary() const { return summary_; }
  /// All pages, by patch.
  std::span<const PageRecord> pages() const { return pages_; }
  /// The pages of one patch; empty where it has none.
  std::span<const PageRecord> pagesOf(std::uint32_t patch) const;
  /// Reads and decodes a page. `record` is one of pages().
  base::Result<Page> page(const PageRecord& record) const;
  /// The page as it is stored, for a server to hand on; its checksum is not looked at.
  base::Result<base::Bytes> pageBytes(const PageRecord& record) const;
  /// Reads and decodes every page, and compares it with its record. Returns a line for each fault.
  std::vector<std::string> verify() const;
  std::uint64_t fileBytes() const { return file_.size(); }
  const std::string& path() const { return file_.path(); }

 private:
  explicit TextureFile(base::PositionedFile file) : file_(std::move(file)) {}

  base::PositionedFile file_;
  TextureSummary summary_;
  std::vector<PageRecord> pages_;
};

}  // namespace lod::texture
