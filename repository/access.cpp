#include "repository/access.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <limits>

#include "base/crc32c.h"
#include "base/fields.h"
#include "base/file.h"
#include "base/file_lock.h"

namespace repository {
namespace {

constexpr std::array<char, 4> kAccessMagic{'L', 'G', 'A', 'C'};
constexpr std::uint16_t kAccessVersion = 2;
constexpr std::size_t kHeaderBytes = 136;
constexpr std::size_t kHeaderCrcOffset = 8;
constexpr std::size_t kBodyCrcOffset = 12;
constexpr std::uint64_t kMax = std::numeric_limits<std::uint64_t>::max();

base::Error bad(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput,
          "access counts: " + problem + "; move the file away, servers begin a new one"};
}

std::uint64_t addSaturated(std::uint64_t a, std::uint64_t b) {
  return a > kMax - b ? kMax : a + b;
}

// --- Rows. A row is two varints: how many numbers lie between the row before and this one, then the count.

using Row = std::pair<std::uint64_t, std::uint64_t>;  // code of the key or number of the group; count

class RowWriter {
 public:
  void put(const Row& row) {
    out_.varint(row.first - next_);
    out_.varint(row.second);
    next_ = row.first + 1;
    ++rows_;
  }
  base::ByteView bytes() const { return out_.view(); }
  std::uint64_t rows() const { return rows_; }

 private:
  base::ByteWriter out_;
  std::uint64_t next_ = 0, rows_ = 0;
};

// Hands each row to `accept(row)`, which returns whether the scene has the face or group that the row names.
template <class Accept>
base::Result<void> readRows(base::ByteReader& in, std::uint64_t rows, const char* items, const Accept& accept) {
  std::uint64_t next = 0;
  for (std::uint64_t row = 0; row < rows; ++row) {
    const std::uint64_t gap = in.varint();
    const std::uint64_t count = in.varint();
    if (!in.ok()) return bad(std::string("a row of ") + items + " is no pair of numbers");
    if (gap > kMax - 1 - next || count == 0) return bad(std::string("a row of ") + items + " is out of range");
    if (!accept(Row{next + gap, count}))
      return bad(std::string("a row names ") + items + " that the scene does not have");
    next += gap + 1;
  }
  return {};
}

struct Header {
  AccessIdentity identity;
  std::uint32_t body_crc = 0;
  std::uint64_t body_bytes = 0, faces = 0, groups = 0, uncounted = 0;
  std::int64_t since = 0, until = 0;
};

// Behind the header's own checksum.
auto fieldsOf(auto& header) {
  return std::tie(header.body_crc, header.body_bytes, header.faces, header.groups, header.uncounted, header.since,
                  header.until);
}

std::uint32_t headerCrc(base::ByteView header) {
  return base::crc32c(header.subspan(kBodyCrcOffset), base::crc32c(header.first(kHeaderCrcOffset)));
}

base::Result<Header> readHeader(base::ByteView bytes) {
  if (bytes.size() < kHeaderBytes) return bad("cut short");
  base::ByteReader in(bytes.first(kHeaderBytes));
  if (in.read<std::array<char, 4>>() != kAccessMagic) return bad("these are none (another magic)");
  const std::uint16_t version = in.u16();
  if (version != kAccessVersion)
    return base::Error{base::ErrorCode::kVersion,
                       "access counts: version " + std::to_string(version) +
                           (version < kAccessVersion ? " does not name its scene; move the file away"
                                                     : " is not known; use a newer lumigrid, or move the file away")};
  if (in.u16() != kHeaderBytes) return bad("the header has another length");
  if (in.u32() != headerCrc(bytes.first(kHeaderBytes))) return bad("the header's checksum is wrong");

  Header header;
  base::readFields(in, fieldsOf(header));
  auto grid = Grid::decode(in);
  if (!grid) return base::within("access counts", grid.error());
  header.identity.grid = *grid;
  header.identity.group_count = in.u32();
  header.identity.hierarchy = in.read<base::Sha256Digest>();
  if (header.since > header.until) return bad("they end before they begin");
  if (header.body_bytes != bytes.size() - kHeaderBytes) return bad("another length than the header says");
  // A row takes at least two bytes, so a file's size bounds the memory that it can make us allocate.
  if (header.faces > header.body_bytes / 2 || header.groups > header.body_bytes / 2)
    return bad("fewer rows than the header says");
  return header;
}

// Checks a whole file and hands its rows, in order, to `face` and `group`.
template <class VisitFace, class VisitGroup>
base::Result<Header> walkRows(base::ByteView bytes, const VisitFace& face, const VisitGroup& group) {
  auto header = readHeader(bytes);
  if (!header) return header;
  const base::ByteView body = bytes.subspan(kHeaderBytes);
  if (base::crc32c(body) != header->body_crc) return bad("the checksum is wrong");
  base::ByteReader in(body);
  LUMIGRID_TRY(readRows(in, header->faces, "a face", [&](const Row& row) {
    const auto key = FaceKey::fromCode(row.first);
    if (!key || !header->identity.grid.contains(*key)) return false;
    face(row);
    return true;
  }));
  LUMIGRID_TRY(readRows(in, header->groups, "a group", [&](const Row& row) {
    if (row.first >= header->identity.group_count) return false;
    group(row);
    return true;
  }));
  if (!in.atEnd()) return bad("bytes are left over");
  return header;
}

// --- Sums

Row rowOf(const std::pair<FaceKey, std::uint64_t>& row) {
  return {row.first.code(), row.second};
}
Row rowOf(const std::pair<std::uint32_t, std::uint64_t>& row) {
  return row;
}

// Writes rows that come in ascending order merged with those of `more`: equal rows are added up.
template <class Key>
class RowMerger {
 public:
  explicit RowMerger(const std::vector<std::pair<Key, std::uint64_t>>& more) : at_(more.begin()), end_(more.end()) {}
  void put(Row row) {
    for (; at_ != end_ && rowOf(*at_).first < row.first; ++at_) out_.put(rowOf(*at_));
    if (at_ != end_ && rowOf(*at_).first == row.first) row.second = addSaturated(row.second, at_++->second);
    out_.put(row);
  }
  const RowWriter& finish() {
    for (; at_ != end_; ++at_) out_.put(rowOf(*at_));
    return out_;
  }

 private:
  typename std::vector<std::pair<Key, std::uint64_t>>::const_iterator at_, end_;
  RowWriter out_;
};

template <class Key>
std::vector<std::pair<Key, std::uint64_t>> addRows(const std::vector<std::pair<Key, std::uint64_t>>& a,
                                                   const std::vector<std::pair<Key, std::uint64_t>>& b) {
  std::vector<std::pair<Key, std::uint64_t>> sum;
  sum.reserve(std::max(a.size(), b.size()));
  auto at = a.begin();
  for (const auto& row : b) {
    while (at != a.end() && at->first < row.first) sum.push_back(*at++);
    sum.push_back(row);
    if (at != a.end() && at->first == row.first) sum.back().second = addSaturated(row.second, at++->second);
  }
  sum.insert(sum.end(), at, a.end());
  return sum;
}

template <class Key>
std::uint64_t total(const std::vector<std::pair<Key, std::uint64_t>>& rows) {
  std::uint64_t sum = 0;
  for (const auto& row : rows) sum = addSaturated(sum, row.second);
  return sum;
}

bool isEmpty(const AccessCounts& counts) {
  return counts.faces.empty() && counts.groups.empty() && counts.uncounted == 0;
}

base::Result<AccessFile> readAccess(const std::string& path, const AccessIdentity& identity) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, base::readFile(path));
  auto file = decodeAccess(bytes);
  if (!file) return base::within(path, file.error());
  if (file->identity != identity) return anotherSceneError(path);
  return file;
}

// Sets the header's counts of rows and bytes.
base::Bytes encodeFile(Header header, const RowWriter& faces, const RowWriter& groups) {
  header.body_crc = base::crc32c(groups.bytes(), base::crc32c(faces.bytes()));
  header.body_bytes = faces.bytes().size() + groups.bytes().size();
  header.faces = faces.rows();
  header.groups = groups.rows();
  base::ByteWriter out;
  out.write(kAccessMagic);
  out.u16(kAccessVersion);
  out.u16(kHeaderBytes);
  out.u32(0);  // the header's checksum
  base::writeFields(out, fieldsOf(header));
  header.identity.grid.encode(out);
  out.u32(header.identity.group_count);
  out.write(header.identity.hierarchy);
  LUMIGRID_CHECK_EQ(out.size(), kHeaderBytes);
  out.bytes(faces.bytes());
  out.bytes(groups.bytes());
  out.patch(kHeaderCrcOffset, headerCrc(base::ByteView(out.view()).first(kHeaderBytes)));
  return out.takeBytes();
}

// Encodes the file `bytes`, of the same scene, with `more` added. It goes row by row, since a file may have tens of
// millions of rows while `more` has at most the million that a server keeps.
base::Result<base::Bytes> encodeSum(base::ByteView bytes, const AccessIdentity& identity, const AccessCounts& more) {
  RowMerger faces(more.faces);
  RowMerger groups(more.groups);
  auto header = walkRows(
      bytes, [&](const Row& row) { faces.put(row); }, [&](const Row& row) { groups.put(row); });
  if (!header) return header.error();
  if (header->identity != identity) return bad("of another scene, or of other images of this one");
  header->uncounted = addSaturated(header->uncounted, more.uncounted);
  header->since = std::min(header->since, more.since);
  header->until = std::max(header->until, more.until);
  return encodeFile(*header, faces.finish(), groups.finish());
}

}  // namespace

std::uint64_t AccessCounts::facesSent() const {
  return total(faces);
}
std::uint64_t AccessCounts::groupsSent() const {
  return total(groups);
}

AccessCounts addCounts(const AccessCounts& a, const AccessCounts& b) {
  if (isEmpty(a)) return b;
  if (isEmpty(b)) return a;
  return {addRows(a.faces, b.faces), addRows(a.groups, b.groups), addSaturated(a.uncounted, b.uncounted),
          std::min(a.since, b.since), std::max(a.until, b.until)};
}

base::Bytes encodeAccess(const AccessIdentity& identity, const AccessCounts& counts) {
  const Header header{identity, 0, 0, 0, 0, counts.uncounted, counts.since, counts.until};
  return encodeFile(header, RowMerger(counts.faces).finish(), RowMerger(counts.groups).finish());
}

base::Result<AccessFile> decodeAccess(base::ByteView bytes) {
  AccessFile file;
  AccessCounts& counts = file.counts;
  const auto header = walkRows(
      bytes, [&](const Row& row) { counts.faces.emplace_back(*FaceKey::fromCode(row.first), row.second); },
      [&](const Row& row) { counts.groups.emplace_back(static_cast<std::uint32_t>(row.first), row.second); });
  if (!header) return header.error();
  file.identity = header->identity;
  counts.uncounted = header->uncounted;
  counts.since = header->since;
  counts.until = header->until;
  return file;
}

std::string accessFileOf(const std::string& scene_directory) {
  return scene_directory + "/access.lga";
}

base::Error anotherSceneError(const std::string& path) {
  return base::within(path, bad("of another scene, or of this one before it was built anew"));
}

std::string accessFileBeside(const std::string& path, const base::Sha256Digest& hierarchy) {
  constexpr std::size_t kNameBytes = 8;
  const std::filesystem::path file(path);
  const std::string id = base::hexOf(base::ByteView(hierarchy).first(kNameBytes));
  return (file.parent_path() / (file.stem().string() + "-" + id + file.extension().string())).string();
}

base::Result<std::vector<AccessFile>> loadSceneAccess(const std::string& scene_directory,
                                                      const base::Sha256Digest& hierarchy) {
  const std::string path = accessFileOf(scene_directory);
  std::vector<AccessFile> files;
  bool has_others = false;
  for (const std::string& place : {path, accessFileBeside(path, hierarchy)}) {
    const auto bytes = base::readFile(place);
    if (!bytes && bytes.error().code == base::ErrorCode::kNotFound) continue;
    if (!bytes) return bytes.error();
    auto file = decodeAccess(*bytes);
    if (!file) return base::within(place, file.error());
    if (file->identity.hierarchy == hierarchy)
      files.push_back(std::move(*file));
    else
      has_others = true;
  }
  if (files.empty() && has_others) return anotherSceneError(path);
  return files;
}

base::Result<AccessCounts> loadAccess(const std::vector<std::string>& files, const AccessIdentity& identity) {
  AccessCounts sum;
  for (const std::string& path : files) {
    LUMIGRID_ASSIGN_OR_RETURN(auto file, readAccess(path, identity));
    sum = addCounts(sum, file.counts);
  }
  return sum;
}

base::Result<std::string> addToAccessFile(const std::string& path, const AccessIdentity& identity,
                                          const AccessCounts& more, double patience_seconds) {
  // The lock is a file of its own, because the counts are replaced by a rename.
  const auto lock = base::tryLockFile(path + ".lock", patience_seconds);
  if (!lock) return lock.error();
  std::string place = path;
  auto stored = base::readFile(place);
  if (stored) {
    const auto header = readHeader(*stored);
    if (!header) return base::within(place, header.error());
    if (header->identity != identity) {
      place = accessFileBeside(path, identity.hierarchy);
      stored = base::readFile(place);
    }
  }
  base::removeUnfinished(place);  // only the holder of the lock writes, so this is what a killed writer left

  if (!stored && stored.error().code != base::ErrorCode::kNotFound) return stored.error();
  auto whole = stored ? encodeSum(*stored, identity, more) : encodeAccess(identity, more);
  if (!whole) return base::within(place, whole.error());
  if (!isEmpty(more)) LUMIGRID_TRY(base::writeFileAtomically(place, *whole));
  return place;
}

std::vector<PointUse> rankPoints(const AccessCounts& counts) {
  // Rows ascend by key, so the faces of a point follow each other and the points are in Morton order.
  std::vector<PointUse> points;
  for (const auto& [key, count] : counts.faces) {
    const glm::uvec3 point(key.x, key.y, key.z);
    if (points.empty() || points.back().point != point) points.push_back({point, 0});
    points.back().sent = addSaturated(points.back().sent, count);
  }
  std::stable_sort(points.begin(), points.end(), [](const PointUse& a, const PointUse& b) { return a.sent > b.sent; });
  return points;
}

}  // namespace repository
