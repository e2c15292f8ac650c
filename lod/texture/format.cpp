#include "lod/texture/format.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/crc32c.h"
#include "base/fields.h"
#include "lod/texture/page_bytes.h"

namespace lod::texture {
namespace {

constexpr std::array<char, 8> kMagic{'L', 'G', 'T', 'X', 'P', 'G', 'S', '\n'};
constexpr std::uint32_t kVersion = 1, kHeaderBytes = 68, kRowBytes = 28;
constexpr std::size_t kHeaderCrcOffset = 64;

struct Header {
  std::uint64_t file_bytes = 0;
  TextureSummary summary;
  std::uint32_t pages = 0;
  std::uint32_t table_crc = 0;

  std::uint64_t tableBytes() const { return std::uint64_t{kRowBytes} * pages; }
};

// The fields between the header's length and its checksum.
auto headerFields(auto& h) {
  return std::tie(h.file_bytes, h.summary.texels, h.summary.triangles, h.pages, h.summary.patches, h.summary.pictures,
                  h.summary.reduced_pages, h.summary.typical_error, h.table_crc);
}

auto rowFields(auto& row) {
  return std::tie(row.patch, row.bytes, row.offset, row.texel, row.width, row.height, row.triangles, row.levels,
                  row.alpha);
}

base::Bytes headerBytes(const Header& header) {
  base::ByteWriter out;
  out.write(kMagic);
  out.u32(kVersion);
  out.u32(kHeaderBytes);
  base::writeFields(out, headerFields(header));
  out.u32(base::crc32c(out.view()));
  return out.takeBytes();
}

base::Bytes tableBytes(std::span<const PageRecord> pages) {
  base::ByteWriter out;
  for (const PageRecord& row : pages) base::writeFields(out, rowFields(row));
  return out.takeBytes();
}

std::string placeOf(std::size_t row) {
  return "page " + std::to_string(row);
}

// Checks -------------------------------------------------------------------------------------------

// The part of a row that a caller of the writer decides on.
const char* choiceFault(const PageRecord& row, const TextureSummary& summary) {
  if (row.patch >= summary.patches) return "its patch is not in the scene";
  if (!std::isfinite(row.texel) || row.texel <= 0.0F) return "its texels have no size";
  return nullptr;
}

base::Result<void> checkSummary(const TextureSummary& summary, std::uint64_t pages) {
  if (summary.reduced_pages > pages) return damaged("header: more reduced pages than pages");
  if (!(summary.typical_error >= 0.0F && summary.typical_error <= 1.0F))
    return damaged("header: the typical error is not 0 to 1");
  return {};
}

base::Result<void> checkChoices(std::span<const PageRecord> pages, const TextureSummary& summary) {
  for (std::size_t i = 0; i < pages.size(); ++i) {
    if (const char* fault = choiceFault(pages[i], summary)) return damaged(placeOf(i) + ": " + fault);
    if (i > 0 && pages[i].patch < pages[i - 1].patch) return damaged(placeOf(i) + ": pages are not sorted by patch");
  }
  return {};
}

// Checks that the pages lie one behind the other, from the table to the file's end.
base::Result<void> checkTable(std::span<const PageRecord> pages, const Header& header) {
  LUMIGRID_TRY(checkSummary(header.summary, pages.size()));
  LUMIGRID_TRY(checkChoices(pages, header.summary));
  std::uint64_t offset = kHeaderBytes + header.tableBytes();
  std::uint64_t triangles = 0;
  for (std::size_t i = 0; i < pages.size(); ++i) {
    const PageRecord& row = pages[i];
    if (const char* fault = sizeFault(row.width, row.height, row.levels, row.triangles))
      return damaged(placeOf(i) + ": " + fault);
    if (row.offset != offset) return damaged(placeOf(i) + ": it does not begin where the page before ends");
    offset += row.bytes;
    triangles += row.triangles;
  }
  if (offset != header.file_bytes) return damaged("header: the file is not as long as its pages");
  if (triangles != header.summary.triangles) return damaged("header: the pages have another number of triangles");
  return {};
}

// Reading -----------------------------------------------------------------------------------------

base::Result<Header> readHeader(base::ByteView front) {
  // Magic and version come first, so that a newer file is named as such.
  base::ByteReader in(front);
  if (in.read<std::array<char, 8>>() != kMagic || !in.ok()) return damaged("not a texture.lgt");
  const std::uint32_t version = in.u32();
  if (in.ok() && version != kVersion)
    return base::Error{base::ErrorCode::kVersion, "format version " + std::to_string(version) +
                                                      ", this program reads " + std::to_string(kVersion) +
                                                      "; use a newer program or build the scene again"};
  const std::uint32_t header_bytes = in.u32();
  if (!in.ok() || front.size() < kHeaderBytes) return damaged("header: cut short");
  if (header_bytes != kHeaderBytes)
    return damaged("header: says that it has " + std::to_string(header_bytes) + " bytes instead of " +
                   std::to_string(kHeaderBytes));
  base::ByteReader crc(front.subspan(kHeaderCrcOffset));
  if (crc.u32() != base::crc32c(front.first(kHeaderCrcOffset))) return damaged("header: checksum does not match");
  Header header;
  base::readFields(in, headerFields(header));
  return header;
}

base::Result<std::vector<PageRecord>> readTable(base::ByteView table, const Header& header) {
  if (base::crc32c(table) != header.table_crc) return damaged("table: checksum does not match");
  base::ByteReader in(table);
  std::vector<PageRecord> pages(header.pages);
  for (PageRecord& row : pages) {
    base::readFields(in, rowFields(row));
    if (table[in.offset() - 1] > 1)
      return damaged(placeOf(static_cast<std::size_t>(&row - &pages[0])) + ": unknown flags");
  }
  LUMIGRID_TRY(checkTable(pages, header));
  return pages;
}

bool isThePageOf(const PageRecord& row, const PageHeader& page) {
  return row.width == page.width && row.height == page.height && row.levels == page.levels && row.alpha == page.alpha &&
         row.triangles == page.triangles;
}

}  // namespace

base::Result<TextureFile> TextureFile::open(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(auto file, base::PositionedFile::open(path));
  base::Bytes front(std::min<std::uint64_t>(file.size(), kHeaderBytes));
  LUMIGRID_TRY(file.readAt(0, front));
  const auto header = readHeader(front);
  if (!header) return base::within(path, header.error());
  if (header->file_bytes != file.size())
    return base::within(path, damaged("has " + std::to_string(file.size()) + " bytes, its header says " +
                                      std::to_string(header->file_bytes)));
  // The table is bounded by the bytes that are here.
  if (header->tableBytes() > file.size() - kHeaderBytes)
    return base::within(path, damaged("header: the table would not fit the file"));

  base::Bytes table(header->tableBytes());
  LUMIGRID_TRY(file.readAt(kHeaderBytes, table));
  auto pages = readTable(table, *header);
  if (!pages) return base::within(path, pages.error());
  TextureFile opened(std::move(file));
  opened.summary_ = header->summary;
  opened.pages_ = std::move(*pages);
  return opened;
}

std::span<const PageRecord> TextureFile::pagesOf(std::uint32_t patch) const {
  const auto [first, last] =
      std::equal_range(pages_.begin(), pages_.end(), PageRecord{.patch = patch},
                       [](const PageRecord& a, const PageRecord& b) { return a.patch < b.patch; });
  return {first, last};
}

base::Result<base::Bytes> TextureFile::pageBytes(const PageRecord& record) const {
  if (record.offset > fileBytes() || record.bytes > fileBytes() - record.offset)
    return base::Error{base::ErrorCode::kNotFound, path() + ": no page at byte " + std::to_string(record.offset)};
  base::Bytes bytes(record.bytes);
  LUMIGRID_TRY(file_.readAt(record.offset, bytes));
  return bytes;
}

base::Result<Page> TextureFile::page(const PageRecord& record) const {
  LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, pageBytes(record));
  const std::string place =
      path() + ": patch " + std::to_string(record.patch) + ", at byte " + std::to_string(record.offset);
  auto page = decodePage(bytes);
  if (!page) return base::within(place, page.error());
  if (const auto header = readPageHeader(bytes); !header || !isThePageOf(record, *header))
    return base::within(place, damaged("page: it is not as the table says"));
  return page;
}

std::vector<std::string> TextureFile::verify() const {
  std::vector<std::string> faults;
  std::uint32_t reduced = 0;
  for (const PageRecord& row : pages_) {
    const auto decoded = page(row);
    if (!decoded)
      faults.push_back(decoded.error().message);
    else if (decoded->scale < 1.0F)
      ++reduced;
  }
  if (faults.empty() && reduced != summary_.reduced_pages)
    faults.push_back(path() + ": " + std::to_string(reduced) + " pages are reduced, the header says " +
                     std::to_string(summary_.reduced_pages) + "; build the scene again");
  return faults;
}

// Writing -----------------------------------------------------------------------------------------

base::Result<void> describePage(base::ByteView encoded, PageRecord& record) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto page, readPageHeader(encoded));
  record.bytes = static_cast<std::uint32_t>(encoded.size());
  record.width = page.width;
  record.height = page.height;
  record.levels = page.levels;
  record.alpha = page.alpha;
  record.triangles = page.triangles;
  return {};
}

base::Result<void> writeTextureFile(const std::string& path, const TextureSummary& summary,
                                    std::span<const PageRecord> pages,
                                    const std::function<base::Result<base::Bytes>(std::size_t page)>& bytes,
                                    const std::function<void(base::Bytes)>& on_bytes) {
  Header header;
  header.summary = summary;
  header.summary.triangles = 0;
  if (pages.size() > std::numeric_limits<std::uint32_t>::max())
    return base::within(path, damaged("header: too many pages"));
  header.pages = static_cast<std::uint32_t>(pages.size());
  std::vector<PageRecord> rows(pages.begin(), pages.end());
  header.file_bytes = kHeaderBytes + header.tableBytes();
  for (PageRecord& row : rows) {
    row.offset = header.file_bytes;
    header.file_bytes += row.bytes;
    header.summary.triangles += row.triangles;
  }
  if (auto sound = checkTable(rows, header); !sound) return base::within(path, sound.error());
  const base::Bytes table = tableBytes(rows);
  header.table_crc = base::crc32c(table);

  LUMIGRID_ASSIGN_OR_RETURN(auto file, base::AtomicFile::create(path));
  const auto write = [&](base::Bytes piece) -> base::Result<void> {
    LUMIGRID_TRY(file.write(piece));
    if (on_bytes) on_bytes(std::move(piece));
    return {};
  };
  LUMIGRID_TRY(write(headerBytes(header)));
  LUMIGRID_TRY(write(table));
  for (std::size_t i = 0; i < rows.size(); ++i) {
    LUMIGRID_ASSIGN_OR_RETURN(auto encoded, bytes(i));
    PageRecord said = rows[i];
    if (auto described = describePage(encoded, said); !described)
      return base::within(path + ": " + placeOf(i), described.error());
    if (said != rows[i]) return damaged(path + ": " + placeOf(i) + ": it is not as the table says");
    LUMIGRID_TRY(write(std::move(encoded)));
  }
  return file.commit();
}

}  // namespace lod::texture
