#include <algorithm>
#include <array>
#include <cstring>

#include "mesh/readers.h"

namespace mesh {
namespace {

constexpr std::size_t kHeaderBytes = 84;    // 80 free bytes and the number of triangles
constexpr std::size_t kTriangleBytes = 50;  // normal, three corners, two attribute bytes

std::uint32_t triangleCountOf(base::ByteView bytes) {
  std::uint32_t count = 0;
  std::memcpy(&count, bytes.data() + 80, sizeof(count));
  return count;
}

// Binary files may begin with "solid" too. Their size tells them apart, or a zero byte, which no text has.
bool isText(base::ByteView bytes) {
  std::string_view head = textOf(bytes);
  if (nextWord(head) != "solid") return false;
  if (isBinaryStlBySize(bytes)) return false;
  const base::ByteView start = bytes.first(std::min<std::size_t>(bytes.size(), 1024));
  return std::none_of(start.begin(), start.end(), [](std::uint8_t b) { return b == 0; });
}

base::Result<void> readBinary(base::ByteView bytes, MeshStream& out) {
  if (bytes.size() < kHeaderBytes) return truncatedIn("the header");
  const std::size_t count = triangleCountOf(bytes);
  const std::size_t there = (bytes.size() - kHeaderBytes) / kTriangleBytes;
  if (count > there) return truncatedIn("triangle " + std::to_string(there) + " of " + std::to_string(count));

  for (std::size_t t = 0; t < count; ++t) {
    std::array<glm::vec3, 3> corners;
    const std::uint8_t* row = bytes.data() + kHeaderBytes + t * kTriangleBytes;
    std::memcpy(corners.data(), row + sizeof(glm::vec3), sizeof(corners));
    for (const glm::vec3& corner : corners) {
      out.corners.push_back(out.vertexCount());
      out.positions.emplace_back(corner);
    }
    LUMIGRID_TRY(out.flushFullBlocks(row));
  }
  return {};
}

base::Result<void> readText(std::string_view text, MeshStream& out) {
  std::uint64_t line_number = 0;
  std::vector<std::uint64_t> corners;
  bool in_loop = false;
  bool ended = false;
  while (!text.empty()) {
    ++line_number;
    std::string_view line = nextLine(text);
    const std::string_view keyword = nextWord(line);
    if (keyword == "vertex") {
      glm::dvec3 p;
      for (int k = 0; k < 3; ++k) {
        const std::string_view word = nextWord(line);
        if (!parseNumber(word, p[k]))
          return invalidInput("line " + std::to_string(line_number) + ": " + inQuotes(word) + " is not a number");
      }
      corners.push_back(out.vertexCount());
      out.positions.push_back(p);
    } else if (keyword == "facet") {
      corners.clear();
      in_loop = true;
    } else if (keyword == "endfacet") {
      out.addPolygon(corners);
      corners.clear();
      in_loop = false;
      LUMIGRID_TRY(out.flushFullBlocks(text.data()));
    }
    ended = keyword == "endsolid" || (ended && keyword.empty());
  }
  if (in_loop || !ended) return truncatedIn("line " + std::to_string(line_number));
  return {};
}

}  // namespace

bool isBinaryStlBySize(base::ByteView bytes) {
  return bytes.size() >= kHeaderBytes + kTriangleBytes &&
         bytes.size() == kHeaderBytes + kTriangleBytes * std::size_t{triangleCountOf(bytes)};
}

base::Result<void> readStl(base::ByteView bytes, MeshStream& out) {
  LUMIGRID_TRY(isText(bytes) ? readText(textOf(bytes), out) : readBinary(bytes, out));
  if (out.triangleCount() == 0 && out.summary.short_faces == 0) return invalidInput("the file has no triangles");
  return out.flush(bytes.data() + bytes.size());
}

}  // namespace mesh
