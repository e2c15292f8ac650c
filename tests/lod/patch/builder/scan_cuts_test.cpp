// Cuts of real scans, which lie in the folder LUMIGRID_MESHES; without it these tests are skipped. Each scan is seen
// from 50 random views: cuts of closed meshes have no open edge, those of open ones none beside the source's border.
#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <random>
#include <set>

#include "mesh/stream_mesh.h"
#include "tests/lod/patch/builder/built_cut.h"
#include "tests/lod/patch/builder/built_file.h"

namespace {

using namespace lod::patch::builder;
using namespace mesh;
using support::BuiltHierarchy;
using support::LatticeEdge;

struct Scan {
  std::string name;
  bool closed = false;

  friend void PrintTo(const Scan& scan, std::ostream* out) { *out << scan.name; }
};

// Draws a place inside the bounding box or within its size around it, any direction, any opening, and a tolerance of
// 0.5 to 5000 pixels.
lod::patch::CutRequest randomRequest(const lod::patch::Hierarchy& h, const base::Aabb& box, std::mt19937& random) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  const glm::dvec3 size(box.size());
  base::ViewCamera view;
  view.position = glm::dvec3(box.min) + size * glm::dvec3(unit(random), unit(random), unit(random));
  if (unit(random) < 0.5)
    view.position += glm::max(std::max(size.x, size.y), size.z) *
                     glm::dvec3(2.0 * unit(random) - 1.0, 2.0 * unit(random) - 1.0, 2.0 * unit(random) - 1.0);
  view.direction = glm::normalize(glm::dvec3(normal(random), normal(random), normal(random)));
  view.up = std::abs(view.direction.z) < 0.9 ? glm::dvec3(0, 0, 1) : glm::dvec3(1, 0, 0);
  view.fov_y = 0.3 + 1.2 * unit(random);
  const float radius = h.groups[0].bounds.radius;
  lod::patch::CutRequest request;
  request.near_plane = 1e-3F * radius;
  request.camera = base::cameraFromView(view, glm::dvec3(0.0), request.near_plane, 10.0F * radius);
  request.tolerance_px = static_cast<float>(std::pow(10.0, 4.0 * unit(random) - 0.3));
  request.cull = false;  // culled patches would leave open edges
  return request;
}

using Triple = std::array<std::array<int, 3>, 3>;

Triple tripleOf(const glm::ivec3& a, const glm::ivec3& b, const glm::ivec3& c) {
  return {std::array{a.x, a.y, a.z}, std::array{b.x, b.y, b.z}, std::array{c.x, c.y, c.z}};
}
Triple sorted(Triple t) {
  std::sort(t.begin(), t.end());
  return t;
}

// Collects a file's triangles, unchanged.
class RawMesh : public MeshSink {
 public:
  base::Result<void> vertices(const VertexBlock& block) override {
    positions.insert(positions.end(), block.positions.begin(), block.positions.end());
    return {};
  }
  base::Result<void> triangles(const TriangleBlock& block) override {
    corners.insert(corners.end(), block.corners.begin(), block.corners.end());
    return {};
  }
  base::Result<void> restart() override {
    positions.clear(), corners.clear();
    return {};
  }

  // On the hierarchy's lattice, in their winding, less those that have lost a corner there.
  std::vector<Triple> onLattice(const BuiltHierarchy& built) const {
    const lod::Lattice& lattice = built.hierarchy.lattice;
    const glm::dvec3 corner = built.summary.origin + lattice.origin;
    std::vector<Triple> out;
    auto point = [&](std::size_t i) { return glm::ivec3(glm::round((positions[corners[i]] - corner) / lattice.step)); };
    for (std::size_t i = 0; i < corners.size(); i += 3) {
      const Triple t = tripleOf(point(i), point(i + 1), point(i + 2));
      if (t[0] != t[1] && t[1] != t[2] && t[2] != t[0]) out.push_back(t);
    }
    return out;
  }

  std::vector<glm::dvec3> positions;
  std::vector<std::uint64_t> corners;
};

// The leaves have every triangle of the source, no others, and none twice in one winding.
void expectLeavesAreTheSource(const BuiltHierarchy& built, const std::vector<Triple>& source) {
  std::vector<Triple> wanted, found, wound;
  for (const Triple& t : source) wanted.push_back(sorted(t));
  for (const std::uint32_t p : support::levelCut(built.hierarchy, 0)) {
    const lod::patch::PatchGeometry& g = built.geometry[p];
    for (std::size_t i = 0; i < g.indices.size(); i += 3) {
      Triple t = tripleOf(g.positions[g.indices[i]], g.positions[g.indices[i + 1]], g.positions[g.indices[i + 2]]);
      found.push_back(sorted(t));
      std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
      wound.push_back(t);
    }
  }
  std::sort(wound.begin(), wound.end());
  EXPECT_EQ(std::adjacent_find(wound.begin(), wound.end()), wound.end());
  for (std::vector<Triple>* list : {&wanted, &found}) {
    std::sort(list->begin(), list->end());
    list->erase(std::unique(list->begin(), list->end()), list->end());
  }
  EXPECT_TRUE(wanted == found) << wanted.size() << " triangles in the source, " << found.size() << " in the leaves";
}

// The edges as triangles without area, to measure distances from.
support::Surface linesOf(const std::vector<LatticeEdge>& edges, const lod::Lattice& lattice) {
  support::Surface out;
  for (const LatticeEdge& e : edges) {
    const auto first = static_cast<std::uint32_t>(out.positions.size());
    out.positions.push_back(lattice.position(e.from));
    out.positions.push_back(lattice.position(e.to));
    out.indices.insert(out.indices.end(), {first, first + 1, first + 1});
  }
  return out;
}

// How many of the edges lie further from the source's border than `error` of their patch allows, and how far the
// furthest lies.
struct Strays {
  std::size_t count = 0;
  double furthest = 0.0;
};

// A built scan, its own border, and the borders of its patches: of any cut, only those need matching.
class BorderedScan {
 public:
  explicit BorderedScan(const BuiltHierarchy& built) : built_(built) {
    for (std::uint32_t p = 0; p < built.geometry.size(); ++p)
      patch_borders_.push_back(support::openEdgesOf(built, {p}));
    border_ = open(support::levelCut(built.hierarchy, 0));
    lines_ = linesOf(border_, built.hierarchy.lattice);
    to_border_.emplace(lines_);
  }

  const std::vector<LatticeEdge>& border() const { return border_; }

  std::vector<LatticeEdge> open(const std::vector<std::uint32_t>& patches) const {
    std::vector<LatticeEdge> edges;
    for (const std::uint32_t p : patches) edges.insert(edges.end(), patch_borders_[p].begin(), patch_borders_[p].end());
    return support::unopposed(std::move(edges));
  }

  // Distances may reach the stated error and a lattice step.
  double error(std::uint32_t patch) const {
    const std::uint32_t producer = built_.hierarchy.patches[patch].producer;
    return built_.hierarchy.lattice.step +
           (producer == lod::patch::kNoGroup ? 0.0 : static_cast<double>(built_.hierarchy.groups[producer].error));
  }

  Strays strays(const std::vector<LatticeEdge>& edges) const {
    Strays out;
    for (const LatticeEdge& e : edges) {
      double distance = 0.0;
      for (const float along : {0.0F, 0.25F, 0.5F, 0.75F, 1.0F}) {
        const lod::Lattice& lattice = built_.hierarchy.lattice;
        const glm::vec3 p = glm::mix(lattice.position(e.from), lattice.position(e.to), along);
        distance = std::max(distance, to_border_->distance(p));
      }
      if (distance <= error(e.patch)) continue;
      ++out.count;
      out.furthest = std::max(out.furthest, distance);
    }
    return out;
  }

 private:
  const BuiltHierarchy& built_;
  std::vector<std::vector<LatticeEdge>> patch_borders_;
  std::vector<LatticeEdge> border_;
  support::Surface lines_;
  std::optional<support::NearestSurface> to_border_;
};

class ScanCuts : public testing::TestWithParam<Scan> {
 protected:
  // Loads the scan; returns false when the test was skipped or has failed.
  bool load() {
    const char* folder = std::getenv("LUMIGRID_MESHES");
    if (folder == nullptr) return skip("LUMIGRID_MESHES names no folder of scans");
    const std::string path = std::string(folder) + "/" + GetParam().name;
    if (!std::filesystem::exists(path)) return skip(path + " is not there");
    const std::string output = (std::filesystem::temp_directory_path() /
                                ("scan_cuts_" + GetParam().name + std::to_string(::getpid()) + ".lgp"))
                                   .string();
    HierarchyOptions options;
    options.stitch.on = false;  // so that the source is what the leaves are compared with
    const auto summary = buildHierarchyFromFiles({path}, options, output);
    EXPECT_TRUE(summary) << summary.error().message;
    if (!summary) return false;
    built_ = support::readBuilt(output, *summary);
    std::filesystem::remove(output);
    const auto read = streamMesh(path, raw_, {});
    EXPECT_TRUE(read) << read.error().message;
    return !HasFailure();
  }
  static bool skip(const std::string& why) {
    [&] { GTEST_SKIP() << why; }();
    return false;
  }

  base::Aabb box() const {
    base::Aabb box;
    for (const glm::dvec3& corner : {built_.summary.box_min, built_.summary.box_max})
      box.add(glm::vec3(corner - built_.summary.origin));
    return box;
  }

  BuiltHierarchy built_;
  RawMesh raw_;
};

TEST_P(ScanCuts, anyViewHasNoOpenEdgeButTheSources) {
  if (!load()) return;
  expectLeavesAreTheSource(built_, raw_.onLattice(built_));
  const BorderedScan scan(built_);
  if (GetParam().closed) {
    ASSERT_EQ(scan.border().size(), 0U);
  } else {
    ASSERT_GT(scan.border().size(), 100U);
  }

  for (std::uint32_t level = 1; level < built_.summary.levels.size(); ++level) {
    const auto open = scan.open(support::levelCut(built_.hierarchy, level));
    EXPECT_LE(open.size(), scan.border().size()) << "level " << level;
    EXPECT_EQ(scan.strays(open).count, 0U) << "level " << level;
  }

  std::mt19937 random(6);
  int mixed = 0;
  for (int view = 0; view < 50; ++view) {
    const auto request = randomRequest(built_.hierarchy, box(), random);
    const auto cut = lod::patch::selectCut(built_.hierarchy, request).patches;
    ASSERT_FALSE(cut.empty());
    std::set<std::uint32_t> levels;
    double largest = 0.0;
    for (const std::uint32_t p : cut) {
      levels.insert(built_.hierarchy.patches[p].level);
      largest = std::max(largest, scan.error(p));
    }
    mixed += levels.size() > 1 ? 1 : 0;
    const std::vector<LatticeEdge> open = scan.open(cut);
    const std::string where = "view " + std::to_string(view) + ", " + std::to_string(request.tolerance_px) + " px, " +
                              std::to_string(levels.size()) + " levels";
    EXPECT_LE(open.size(), scan.border().size()) << where;
    // A lone triangle on the border that a coarse patch has given up leaves an edge of its fine neighbour open, as far
    // away as the coarse patch's error allows. Few are so.
    const Strays strays = scan.strays(open);
    EXPECT_LE(strays.count, open.size() / 1000) << where;
    EXPECT_LE(strays.furthest, largest) << where;
  }
  EXPECT_GE(mixed, 15) << "too few views mix levels to say much";
}

INSTANTIATE_TEST_SUITE_P(Scans, ScanCuts,
                         testing::Values(Scan{"skull.obj", true}, Scan{"scorpion.obj", true},
                                         Scan{"lucy_100k.ply", true}, Scan{"cedar_creek.ply"}, Scan{"bun_zipper.ply"},
                                         Scan{"mountain.obj"}),
                         [](const auto& scan) {
                           std::string name = scan.param.name;
                           std::replace(name.begin(), name.end(), '.', '_');
                           return name;
                         });

}  // namespace
