#include "server/cli/streamed/hull.h"

#include <algorithm>
#include <limits>
#include <queue>
#include <utility>
#include <vector>

#include "base/file.h"
#include "lod/hlod/block.h"
#include "lod/patch/hull.h"
#include "lod/pmr/chunks.h"
#include "lod/pmr/leaf_picture.h"
#include "lod/qsplat/splat_file.h"
#include "lod/qsplat/traverse.h"
#include "server/cli/first_view.h"
#include "server/cli/streamed/info.h"

namespace server::cli {
namespace {

using base::Result;
using lod::patch::SurfacePart;
using Parts = std::vector<SurfacePart>;

// The least parts of a cut, where the file has as many. With them a splat, or the error of triangles, is below a
// hundredth of the model.
constexpr std::size_t kLeastParts = 20'000;
// So many times the cut-off is the radius of a splat between neighbours that are far from each other; and the share of
// all splats that may be such by mistake, as lod/patch/hull.cpp has it for areas.
constexpr float kHuge = 8.0F;
constexpr double kStrayShare = 0.002;

Result<base::Bytes> readBlock(const base::PositionedFile& file, std::uint64_t offset, std::uint32_t length) {
  base::Bytes bytes(length);
  LUMIGRID_TRY(file.readAt(offset, bytes));
  return bytes;
}

// ---- Splats ----

/// Spheres that are all about equally large, and hold all that is below them.
Result<Parts> partsOfSplats(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, lod::qsplat::SplatFile::open(path));
  LUMIGRID_ASSIGN_OR_RETURN(const auto blocks, lod::qsplat::openBlocks(file.bytes(), file.header()));
  lod::qsplat::TraverseRequest request;
  request.camera.height = 2;  // in this parallel view a pixel is a scene unit
  request.cull = request.cull_back_faces = false;
  lod::qsplat::Traversal cut;
  // Each cut has about twice the spheres of the one before. The last is finer than any file.
  constexpr float kFiner = 0.7F, kFinest = 1e-7F;
  const float root = 2.0F * file.header().root.radius;
  for (request.cutoff_px = kFiner * root; request.cutoff_px > kFinest * root; request.cutoff_px *= kFiner) {
    lod::qsplat::traverse(*blocks, request, cut);
    if (cut.damaged || blocks->damagedBlock() != 0)
      return base::within(path, lod::qsplat::damaged("its tree is damaged"));
    const auto is_leaf = [](const lod::qsplat::Splat& splat) { return (splat.normal & splat.kLeaf) != 0; };
    if (cut.splats.size() >= kLeastParts || std::all_of(cut.splats.begin(), cut.splats.end(), is_leaf)) break;
  }
  // The leaf of a single stray is as large as its gap, and lies about that gap's middle. A few such are no surface.
  const auto is_huge = [&](const lod::qsplat::Splat& splat) { return splat.radius > kHuge * request.cutoff_px; };
  const auto huge = static_cast<double>(std::count_if(cut.splats.begin(), cut.splats.end(), is_huge));
  const bool leaves_huge_out = huge <= kStrayShare * static_cast<double>(cut.splats.size());
  Parts parts;
  for (const lod::qsplat::Splat& splat : cut.splats) {
    if (leaves_huge_out && is_huge(splat)) continue;
    SurfacePart& part = parts.emplace_back(lod::patch::ballPart(splat.center, splat.radius));
    // A larger one is a leaf. A stray's may be far larger than its points, as its radius is at least a thirteenth of
    // the parent's, which reaches across the gap. Those of a surface reach to their neighbours, however little they
    // count.
    part.area = std::min(part.area, lod::patch::ballPart({}, 0.5F * request.cutoff_px).area);
  }
  return parts;
}

// ---- Points and umbrellas ----

/// The points of the coarsest level with enough of them, and the surface around each as far as its umbrella reaches.
Result<Parts> partsOfUmbrellas(const std::string& path) {
  namespace pmr = lod::pmr;
  LUMIGRID_ASSIGN_OR_RETURN(const auto table, readUmbrellaTable(path));
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, base::PositionedFile::open(path));
  const auto pointsAt = [&](std::uint32_t level) {
    std::uint64_t points = 0;
    for (const pmr::Leaf& leaf : table.rows) points += leaf.pointsAt(level);
    return points;
  };
  std::uint32_t level = pmr::kCoarsest;
  while (level > 0 && pointsAt(level) < kLeastParts) --level;
  double mean = 0.0;
  for (const pmr::Leaf& leaf : table.rows) mean += leaf.levels[level].radius * leaf.pointsAt(level);
  mean /= static_cast<double>(std::max<std::uint64_t>(pointsAt(level), 1));

  Parts parts;
  for (const pmr::Leaf& leaf : table.rows) {
    // A leaf of strays alone has none of its own umbrellas, but the edge of its cell as a radius.
    constexpr float kMostReach = 4.0F;
    const float usual = static_cast<float>(mean), radius = leaf.levels[level].radius;
    SurfacePart part = lod::patch::ballPart({}, std::min(radius, usual));
    // At the finest level there is nothing beyond the points.
    part.reach = level == 0 ? 0.0F : std::min(radius, kMostReach * usual);
    for (std::uint32_t c = level; c < pmr::kLevels; ++c) {
      const pmr::LevelRow& row = leaf.levels[c];
      std::vector<pmr::CodedPoint> points;
      LUMIGRID_ASSIGN_OR_RETURN(const auto chunk, readBlock(file, row.point_offset, row.point_bytes));
      if (const auto done = pmr::decodePoints(chunk, row.points, row.foreign, table.header.colors, points); !done)
        return base::within(path, done.error());
      for (std::uint32_t i = 0; i < row.points; ++i) {
        part.corners.fill(table.header.lattice.position(points[i].place));
        parts.push_back(part);
      }
    }
  }
  return parts;
}

// ---- Octrees of triangles ----

/// Those that tell a node's shape: its caster's, or where it is a leaf, the source's.
std::uint32_t trianglesOf(const lod::hlod::Node& node) {
  return node.isLeaf() ? node.triangles : node.caster_triangles;
}

/// The nodes of a cut with kLeastParts triangles or more: those that are off most are replaced by their children first.
std::vector<std::uint32_t> coarseCut(const std::vector<lod::hlod::Node>& nodes) {
  // A caster of nothing says nothing of where its surface is.
  const auto rank = [&](std::uint32_t i) {
    if (nodes[i].isLeaf()) return std::pair(-1.0F, i);
    return std::pair(trianglesOf(nodes[i]) == 0 ? std::numeric_limits<float>::infinity() : nodes[i].caster_error, i);
  };
  std::priority_queue<std::pair<float, std::uint32_t>> cut;
  cut.push(rank(0));
  std::uint64_t triangles = trianglesOf(nodes[0]);
  while (cut.top().first >= 0.0F && (triangles < kLeastParts || trianglesOf(nodes[cut.top().second]) == 0)) {
    const lod::hlod::Node& node = nodes[cut.top().second];
    cut.pop();
    triangles -= trianglesOf(node);
    for (std::uint32_t c = node.first_child; c < node.first_child + node.children; ++c) {
      cut.push(rank(c));
      triangles += trianglesOf(nodes[c]);
    }
  }
  std::vector<std::uint32_t> chosen;
  for (; !cut.empty(); cut.pop()) chosen.push_back(cut.top().second);
  return chosen;
}

Result<Parts> partsOfHlod(const std::string& path) {
  namespace hlod = lod::hlod;
  LUMIGRID_ASSIGN_OR_RETURN(const auto table, readHlodTable(path));
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, base::PositionedFile::open(path));
  Parts parts;
  for (const std::uint32_t number : coarseCut(table.rows)) {
    const hlod::Node& node = table.rows[number];
    const hlod::BlockPlace& place = node.isLeaf() ? node.picture : node.caster;
    LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, readBlock(file, place.offset, place.bytes));
    const auto geometry = hlod::decodeBlock(bytes, node, {table.header.colors, !node.isLeaf()});
    if (!geometry) return base::within(path, geometry.error());
    for (std::size_t i = 0; i + 2 < geometry->triangles.size(); i += 3) {
      const auto corner = [&](std::size_t k) {
        return table.header.lattice.position(geometry->vertices[geometry->triangles[i + k]].place *
                                             (1 << node.step_bits));
      };
      parts.push_back(lod::patch::trianglePart({corner(0), corner(1), corner(2)}, node.caster_error));
    }
  }
  return parts;
}

}  // namespace

Result<void> setStreamedHull(const std::string& directory, base::Scene& scene) {
  Parts parts;
  if (const auto hlod = base::partFile(scene, "hlod", ".lgh")) {
    LUMIGRID_ASSIGN_OR_RETURN(parts, partsOfHlod(directory + "/" + *hlod));
  } else if (const auto splats = base::partFile(scene, "qsplat", ".lgq")) {
    LUMIGRID_ASSIGN_OR_RETURN(parts, partsOfSplats(directory + "/" + *splats));
  } else if (const auto umbrellas = base::partFile(scene, "pmr", ".lgm")) {
    LUMIGRID_ASSIGN_OR_RETURN(parts, partsOfUmbrellas(directory + "/" + *umbrellas));
  }
  setHull(lod::patch::findHull(parts), scene);
  return {};
}

}  // namespace server::cli
