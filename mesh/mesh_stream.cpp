#include "mesh/mesh_stream.h"

#include <sys/mman.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace mesh {

void MeshStream::addTextured(std::span<const std::uint64_t> polygon, std::span<const glm::vec3> its_normals,
                             std::span<const glm::dvec2> uv, std::uint32_t picture) {
  baked_.resize(uv.size());
  const glm::ivec2 size(textures[picture].width(), textures[picture].height());
  baker.bake(textures.fine(picture, TextureBaker::levelFor(size, uv)), uv, baked_);
  const std::size_t before = corners.size();
  addPolygon(polygon, its_normals, baked_);
  if (corners.size() == before) return;
  corner_uv.resize(before, glm::vec2(0.0F));
  pictures.resize(before / 3, kNoPicture);
  for (std::size_t i = 2; i < uv.size(); ++i) {
    corner_uv.insert(corner_uv.end(), {glm::vec2(uv[0]), glm::vec2(uv[i - 1]), glm::vec2(uv[i])});
    pictures.push_back(picture);
  }
}

void MeshStream::clearBlocks() {
  positions.clear(), normals.clear(), colors.clear();
  corners.clear(), corner_normals.clear(), corner_colors.clear(), corner_uv.clear(), pictures.clear();
}

void MeshStream::leaveOutUnplaced() {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const glm::dvec3& p = positions[i];
    if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) continue;
    positions[kept] = p;
    if (!normals.empty()) normals[kept] = normals[i];
    if (!colors.empty()) colors[kept] = colors[i];
    ++kept;
  }
  unplaced += positions.size() - kept;
  positions.resize(kept);
  if (!normals.empty()) normals.resize(kept);
  if (!colors.empty()) colors.resize(kept);
}

base::Result<void> MeshStream::handOver() {
  if (leaves_out_unplaced) leaveOutUnplaced();
  if (origin != glm::dvec3(0.0))
    for (glm::dvec3& position : positions) position += origin;
  if (!corner_normals.empty()) corner_normals.resize(corners.size(), glm::vec3(0.0F));
  if (!corner_colors.empty()) corner_colors.resize(corners.size(), glm::u8vec4(0));
  if (!pictures.empty())
    corner_uv.resize(corners.size(), glm::vec2(0.0F)), pictures.resize(corners.size() / 3, kNoPicture);
  summary.has_normals |= !normals.empty() || !corner_normals.empty();
  summary.has_colors |= !colors.empty() || !corner_colors.empty();
  if (!positions.empty()) {
    VertexBlock block;
    block.positions = positions, block.normals = normals, block.colors = colors;
    LUMIGRID_TRY(sink_.vertices(block));
  }
  if (!corners.empty()) {
    TriangleBlock block;
    block.corners = corners, block.normals = corner_normals, block.colors = corner_colors;
    block.uv = corner_uv, block.pictures = pictures;
    LUMIGRID_TRY(sink_.triangles(block));
  }
  summary.vertices += positions.size();
  summary.triangles += corners.size() / 3;
  clearBlocks();
  return {};
}

base::Result<void> MeshStream::report(double share) {
  constexpr double kStep = 0.001;  // a choice: a line of progress shows no less
  if (!progress_ || share < reported_ + kStep) return {};
  reported_ = share;
  if (!progress_(share)) return base::Error{base::ErrorCode::kCancelled, "reading the mesh was cancelled"};
  return {};
}

base::Result<void> MeshStream::flush(const void* at) {
  LUMIGRID_TRY(handOver());
  // Pages that have been read are clean: the system loads them again from the file if anybody needs them.
  constexpr std::size_t kPage = 4096;
  const auto offset = static_cast<std::size_t>(static_cast<const std::uint8_t*>(at) - file_.data());
  const std::size_t end = std::min(offset, file_.size()) / kPage * kPage;
  constexpr std::size_t kStep = std::size_t{8} << 20;  // a choice: a system call and a report of progress each
  if (end >= dropped_ + kStep) {
    ::madvise(const_cast<std::uint8_t*>(file_.data()) + dropped_, end - dropped_, MADV_DONTNEED);
    dropped_ = end;
    return report(static_cast<double>(end) / static_cast<double>(file_.size()));
  }
  return {};
}

base::Result<void> MeshStream::restart() {
  clearBlocks();
  summary = {};
  unplaced = 0;
  dropped_ = 0;
  reported_ = 0.0;
  baker = {};
  return sink_.restart();
}

glm::u8vec4 TextColors::color(const glm::dvec3& given) {
  if (!bytes_) {
    if (std::max({given.r, given.g, given.b}) > 1.0) {
      bytes_ = true;
      wrong_ = seen_;
    }
    seen_ = true;
  }
  const glm::dvec3 unit = bytes_ ? given / 255.0 : given;
  return {byteFromUnit(unit.r), byteFromUnit(unit.g), byteFromUnit(unit.b), 255};
}

bool TextColors::mustRestart() {
  return std::exchange(wrong_, false);
}

std::string inQuotes(std::string_view word) {
  constexpr std::size_t kMaxLength = 40;
  std::string text = "\"";
  for (const char c : word.substr(0, kMaxLength)) text += c >= ' ' && c <= '~' ? c : '?';
  return text + (word.size() > kMaxLength ? "...\"" : "\"");
}

}  // namespace mesh
