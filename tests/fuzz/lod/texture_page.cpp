// Decodes any bytes as a page, and opens any bytes as a texture.lgt: as they are, and with right checksums (and the
// file's length). A page that is read keeps what lod/texture/page.h promises, and can be written again.
#include <unistd.h>

#include <cstdlib>
#include <string>

#include "base/check.h"
#include "base/file.h"
#include "lod/texture/format.h"
#include "tests/fuzz/fuzz.h"

namespace {

using namespace lod::texture;

constexpr std::size_t kHeader = 68, kRow = 28;  // docs/formats/texture.md

// Removed as soon as it is open: nothing is left behind when a target dies.
const std::string& scratchPath() {
  static const std::string path = [] {
    const char* folder = std::getenv("TMPDIR");
    return std::string(folder != nullptr ? folder : "/tmp") + "/fuzz_texture_page_" + std::to_string(::getpid());
  }();
  return path;
}

void decodeAndCheck(base::ByteView bytes) {
  const auto page = decodePage(bytes);
  if (!page) return;
  const base::Image& image = page->image;
  LUMIGRID_CHECK(image.channels == 3 || image.channels == 4);
  LUMIGRID_CHECK(image.width % 4 == 0 && image.height % 4 == 0 && image.width <= kMaxPageSide);
  LUMIGRID_CHECK(!page->triangles.empty() && page->levels >= 1 && page->levels <= 14);
  for (const PageTriangle& triangle : page->triangles)
    for (const glm::u16vec2& corner : triangle.corners)
      LUMIGRID_CHECK(corner.x <= image.width * kCornerSteps && corner.y <= image.height * kCornerSteps);
  const auto again = encodePage(*page);
  LUMIGRID_CHECK(again && decodePage(*again)->triangles == page->triangles);
}

void openAndUse(base::ByteView bytes) {
  std::FILE* out = std::fopen(scratchPath().c_str(), "wb");
  LUMIGRID_CHECK(out != nullptr);
  LUMIGRID_CHECK_EQ(std::fwrite(bytes.data(), 1, bytes.size(), out), bytes.size());
  std::fclose(out);
  const auto file = TextureFile::open(scratchPath());
  std::remove(scratchPath().c_str());
  if (!file) return;
  static_cast<void>(file->verify());
  std::size_t found = 0;
  for (std::uint32_t patch = 0; patch < std::min(file->summary().patches, 16U); ++patch)
    found += file->pagesOf(patch).size();
  LUMIGRID_CHECK(found <= file->pages().size());
}

base::Bytes sealedFile(base::ByteView bytes) {
  base::Bytes out(bytes.begin(), bytes.end());
  const std::uint64_t length = out.size();
  std::memcpy(out.data() + 16, &length, sizeof(length));
  std::uint32_t pages = 0;
  std::memcpy(&pages, out.data() + 40, sizeof(pages));
  if (kRow * pages <= out.size() - kHeader) {
    const std::uint32_t table = base::crc32c(base::ByteView(out).subspan(kHeader, kRow * pages));
    std::memcpy(out.data() + 60, &table, sizeof(table));
  }
  const std::uint32_t header = base::crc32c(base::ByteView(out).first(64));
  std::memcpy(out.data() + 64, &header, sizeof(header));
  return out;
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  base::Bytes golden = *base::readFile(std::string(LUMIGRID_SOURCE_DIR) + "/tests/golden/texture_v1.lgt");
  const auto file = TextureFile::open(std::string(LUMIGRID_SOURCE_DIR) + "/tests/golden/texture_v1.lgt");
  std::vector<base::Bytes> all{std::move(golden)};
  for (const PageRecord& row : file->pages()) all.push_back(*file->pageBytes(row));
  return all;
}

void fuzzOne(base::ByteView bytes) {
  decodeAndCheck(bytes);
  if (bytes.size() >= 4) decodeAndCheck(withChecksum(bytes));
  openAndUse(bytes);
  if (bytes.size() >= kHeader) openAndUse(sealedFile(bytes));
}

}  // namespace fuzz
