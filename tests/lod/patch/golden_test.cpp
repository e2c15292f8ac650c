// tests/golden/patch_v3.lgp must stay readable, as must those of older versions beside it, and the same input must give
// its bytes; the same of its groups' records in records_v1.lgr. A change of a format gets a new version and a new file
// beside it. LUMIGRID_WRITE_GOLDEN=1 writes the files anew.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>

#include "lod/patch/group_records.h"
#include "tests/lod/patch/patch_testing.h"
#include "tests/support/synthetic_hierarchy.h"

namespace lod::patch {
namespace {

const std::string kFolder = std::string(LUMIGRID_SOURCE_DIR) + "/tests/golden/";
const std::string kGolden = kFolder + "patch_v3.lgp";
const std::string kRecords = kFolder + "records_v1.lgr";

// A diamond of three levels: two leaves, one group that merges them, the root.
//
//   group 1 consumes leaves 1 and 2, makes patch 0;  group 0 consumes patch 0
support::SyntheticHierarchy goldenScene() {
  support::SyntheticHierarchy scene;
  const auto square = [](int x, int width, int points) {
    support::synthetic::DraftPatch draft{{x, 0, x + width, 4}, {}, -1, -1};
    for (const auto& p : support::synthetic::everyPoint(draft.region))
      if (p.first % points == 0 && p.second % points == 0) draft.border.insert(p);
    return support::synthetic::fan(draft, true);
  };
  scene.geometry = {square(0, 8, 4), square(0, 4, 1), square(4, 4, 1)};
  Hierarchy& h = scene.hierarchy;
  h.lattice = {glm::dvec3(100.5, -2.0, 0.0), 0.0078125};
  h.has_colors = true;
  for (const PatchGeometry& geometry : scene.geometry)
    h.patches.push_back(support::synthetic::record(geometry, h.lattice));
  h.patches[0].producer = 1;
  h.patches[0].level = 1;
  h.patches[1].consumer = 1;
  h.patches[2].consumer = 1;
  h.source_triangles = 32;
  h.groups.resize(2);
  h.groups[0].error = h.groups[0].typical_error = h.groups[0].visible_error = std::numeric_limits<float>::infinity();
  h.groups[0].level = 2;
  h.groups[0].patch_count = 1;
  h.groups[1].error = 0.25F;
  h.groups[1].typical_error = 0.03125F;
  h.groups[1].typical_color_error = 0.125F;
  h.groups[1].visible_error = 0.0625F;
  h.groups[1].attribute_error = 0.5F;
  h.groups[1].level = 1;
  h.groups[1].first_patch = 1;
  h.groups[1].patch_count = 2;
  support::synthetic::linkParents(h);
  // These are constants, so that no rounding of another compiler can change the bytes.
  const base::Sphere around{glm::vec3(102.5F, -1.0F, 0.125F), 2.5F};
  for (Group& group : h.groups) group.bounds = around;
  for (Patch& patch : h.patches) {
    patch.bounds = around;
    patch.cone = {glm::vec3(0.0F, 0.0F, 1.0F), 0.0F};
  }
  return scene;
}

void expectGoldenScene(const std::string& path) {
  const auto file = PatchFile::open(path);
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_LT(file->fileBytes(), 4096U);
  EXPECT_EQ(file->verify(), std::vector<std::string>{});
  const Hierarchy& h = file->hierarchy();
  EXPECT_EQ(h.lattice.origin, glm::dvec3(100.5, -2.0, 0.0));
  EXPECT_EQ(h.lattice.step, 0.0078125);
  ASSERT_EQ(h.groups.size(), 2U);
  EXPECT_EQ(h.groups[1].error, 0.25F);
  EXPECT_EQ(h.groups[1].typical_error, 0.03125F);
  EXPECT_EQ(h.groups[1].typical_color_error, 0.125F);
  EXPECT_EQ(h.groups[1].visible_error, 0.0625F);
  EXPECT_EQ(h.parents, std::vector<std::uint32_t>{0});
  ASSERT_EQ(h.patches.size(), 3U);
  const auto scene = goldenScene();
  for (std::uint32_t p = 0; p < 3; ++p)
    EXPECT_TRUE(patch_testing::surfaceOf(*file->geometry(p)) == patch_testing::surfaceOf(scene.geometry[p]));
}

TEST(PatchGolden, theStoredFileStillReadsTheSame) {
  if (std::getenv("LUMIGRID_WRITE_GOLDEN") != nullptr) {
    ASSERT_TRUE(support::writeSynthetic(goldenScene(), kGolden));
  }
  expectGoldenScene(kGolden);
}

TEST(PatchGolden, aFileOfVersion2StillReadsTheSame) {
  expectGoldenScene(kFolder + "patch_v2.lgp");
}

TEST(PatchGolden, theSameInputStillGivesTheSameBytes) {
  const std::string path = ::testing::TempDir() + "patch_golden_" + std::to_string(::getpid()) + ".lgp";
  ASSERT_TRUE(support::writeSynthetic(goldenScene(), path));
  EXPECT_EQ(*base::readFile(path), *base::readFile(kGolden));
  std::filesystem::remove(path);
}

TEST(RecordsGolden, theSameHierarchyStillGivesTheSameBytes) {
  const auto file = PatchFile::open(kGolden);
  ASSERT_TRUE(file);
  const base::Bytes bytes = encodeRecords(file->hierarchy(), file->fileBytes());
  if (std::getenv("LUMIGRID_WRITE_GOLDEN") != nullptr) {
    ASSERT_TRUE(base::writeFileAtomically(kRecords, bytes));
  }
  EXPECT_EQ(bytes, *base::readFile(kRecords));
}

TEST(RecordsGolden, theStoredRecordsStillReadTheSame) {
  const auto bytes = base::readFile(kRecords);
  ASSERT_TRUE(bytes);
  const auto read = GroupRecords::open(*bytes);
  ASSERT_TRUE(read) << read.error().message;
  ASSERT_EQ(read->leadingGroups(), 2U);
  Hierarchy h;
  for (const std::uint32_t group : {0U, 1U}) {
    base::ByteReader in(read->record(group));
    ASSERT_TRUE(addGroup(in, h, 2, 3));
  }
  EXPECT_EQ(h.groups[1].error, 0.25F);
  EXPECT_EQ(h.groups[1].attribute_error, 0.5F);
  EXPECT_EQ(h.groups[1].typical_error, 0.03125F);
  EXPECT_EQ(h.groups[1].block_offset, 656U);
  EXPECT_EQ(h.groups[1].block_bytes, 413U);
  EXPECT_EQ(h.groups[1].bounds.center, glm::vec3(102.5F, -1.0F, 0.125F));
  EXPECT_EQ(h.groups[1].bounds.radius, 2.5F);
  EXPECT_EQ(h.patches[0].producer, 1U);
  EXPECT_EQ(h.patches[1].box.min, glm::vec3(100.5F, -2.0F, 0.0F));
  EXPECT_EQ(h.patches[1].box.max.x, 102.5F);
  EXPECT_EQ(h.patches[1].cone.axis, glm::vec3(0.0F, 0.0F, 1.0F));
  EXPECT_EQ(h.patches[2].triangles, 16U);
  EXPECT_EQ(h.patches[2].vertices, 17U);
}

}  // namespace
}  // namespace lod::patch
