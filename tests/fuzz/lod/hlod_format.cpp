// Reads header and table from any bytes, as they are and with checksums and lengths made right, checks the whole file,
// and streams a view of it, from the file itself and over a link.
#include "base/check.h"
#include "lod/hlod/check_file.h"
#include "lod/hlod/stream.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/made_hlod.h"

namespace {

using namespace lod::hlod;

constexpr std::size_t kFileBytesAt = 16, kTableBytesAt = 36;

void checkNodes(const Header& header, const std::vector<Node>& nodes) {
  LUMIGRID_CHECK_EQ(nodes.size(), header.nodes);
  std::uint64_t triangles = 0, next = 1;
  for (std::uint32_t i = 0; i < nodes.size(); ++i) {
    const Node& node = nodes[i];
    LUMIGRID_CHECK(!node.box.empty() && node.shape_error <= node.error && node.children <= 8);
    LUMIGRID_CHECK(std::max({node.triangles, node.points, node.edges, node.caster_triangles}) <= kMaxPrimitives);
    for (const BlockPlace& place : {node.picture, node.caster}) {
      LUMIGRID_CHECK_LE(place.bytes, kMaxBlockBytes);
      LUMIGRID_CHECK_LE(place.offset + place.bytes, header.file_bytes);
    }
    triangles += node.isLeaf() ? node.triangles : 0;
    if (node.isLeaf()) continue;
    LUMIGRID_CHECK(node.first_child == next && node.first_child > i);
    next += node.children;
    LUMIGRID_CHECK_LE(next, nodes.size());
    for (std::uint32_t c = node.first_child; c < next; ++c) {
      LUMIGRID_CHECK(node.box.contains(nodes[c].box.min) && node.box.contains(nodes[c].box.max));
      LUMIGRID_CHECK(node.error >= nodes[c].error && node.caster_error >= nodes[c].caster_error);
    }
  }
  LUMIGRID_CHECK_EQ(triangles, header.source_triangles);
  LUMIGRID_CHECK_EQ(next, nodes.size());
}

/// Streams a view of all of the file until nothing more comes.
void streamView(Stream& stream, base::ByteView file) {
  TraverseRequest request;
  request.cull = false;
  std::vector<DrawnNode> drawn;
  for (int turn = 0; turn < 1000; ++turn) {
    stream.update(request, drawn);
    const std::vector<ByteRange> ranges = stream.nextRequests(turn);
    if (ranges.empty() && !stream.decoding()) break;
    for (const ByteRange& range : ranges) {
      const bool is_there = range.offset <= file.size() && range.length <= file.size() - range.offset;
      LUMIGRID_CHECK(is_there);
      stream.acceptAnswer(range.id, file.subspan(range.offset, range.length), turn);
    }
  }
  LUMIGRID_CHECK(!stream.problem().empty() || stream.complete());
}

void readAll(base::ByteView file) {
  const auto header = readHeader(file);
  if (header && file.size() >= std::size_t{kHeaderBytes} + header->table_bytes)
    if (const auto nodes = readTable(*header, file.subspan(kHeaderBytes, header->table_bytes)))
      checkNodes(*header, *nodes);
  const lod::MemoryBytes bytes(file);
  for (const std::string& fault : checkFile(bytes)) LUMIGRID_CHECK(fault.find('\n') == std::string::npos);
  Stream local(std::make_shared<lod::MemoryBytes>(file), {});
  streamView(local, file);
  Stream remote(file.size(), {});
  streamView(remote, file);
}

base::Bytes sealed(base::ByteView bytes) {
  base::Bytes out(bytes.begin(), bytes.end());
  const std::uint64_t length = out.size();
  std::memcpy(out.data() + kFileBytesAt, &length, sizeof(length));
  const auto seal = [&](std::size_t begin, std::size_t end) {
    const std::uint32_t crc = base::crc32c(base::ByteView(out).subspan(begin, end - begin - sizeof(std::uint32_t)));
    std::memcpy(out.data() + end - sizeof(crc), &crc, sizeof(crc));
  };
  seal(0, kHeaderBytes);
  std::uint32_t table_bytes = 0;
  std::memcpy(&table_bytes, out.data() + kTableBytesAt, sizeof(table_bytes));
  if (table_bytes >= sizeof(std::uint32_t) && table_bytes <= out.size() - kHeaderBytes)
    seal(kHeaderBytes, kHeaderBytes + table_bytes);
  return out;
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  std::vector<base::Bytes> all;
  all.push_back(support::madeHlod(1, 4).file);
  const support::MadeHlod many = support::madeHlod(3, 1, false);
  all.push_back(many.file);
  // The front alone: mutations meet the table more often.
  all.emplace_back(many.file.begin(), many.file.begin() + kHeaderBytes + many.header.table_bytes);
  return all;
}

void fuzzOne(base::ByteView bytes) {
  readAll(bytes);
  if (bytes.size() >= kHeaderBytes) readAll(sealed(bytes));
}

}  // namespace fuzz
