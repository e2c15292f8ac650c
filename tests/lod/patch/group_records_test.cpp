// Tests the records of groups against the hierarchy that they were made of, and what damage does.
#include "lod/patch/group_records.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numbers>
#include <numeric>
#include <random>

#include "base/crc32c.h"
#include "base/file.h"
#include "lod/patch/format.h"
#include "tests/support/synthetic_hierarchy.h"

namespace lod::patch {
namespace {

/// A hierarchy as a file has it, and its records.
struct Made {
  Made() {
    const std::string path =
        (std::filesystem::temp_directory_path() / ("records_test_" + std::to_string(::getpid()) + ".lgp")).string();
    EXPECT_TRUE(support::writeSynthetic(support::syntheticHierarchy(24, true), path));
    const auto file = PatchFile::open(path);
    hierarchy = file->hierarchy();
    patch_bytes = file->fileBytes();
    std::filesystem::remove(path);
    // The file has cones of any direction only, and textures nowhere.
    std::mt19937 random(7);
    std::uniform_real_distribution<float> within(-1.0F, 1.0F);
    for (Patch& patch : hierarchy.patches) {
      const glm::vec3 axis(within(random), within(random), within(random) + 1e-3F);
      patch.cone = {glm::normalize(axis), within(random)};
      if (patch.producer == kNoGroup) patch.color_detail = static_cast<std::uint16_t>(random() % 3000);
    }
    for (Group& group : hierarchy.groups) group.typical_color_error = std::abs(within(random));
    bytes = encodeRecords(hierarchy, patch_bytes);
  }
  Hierarchy hierarchy;
  std::uint64_t patch_bytes = 0;
  base::Bytes bytes;
};

const Made& made() {
  static const Made once;
  return once;
}

Hierarchy grownFrom(const GroupRecords& records) {
  Hierarchy growing;
  const RecordCounts& counts = records.counts();
  for (std::uint32_t group = 0; group < counts.groups; ++group) {
    base::ByteReader in(records.record(group));
    const auto added = addGroup(in, growing, counts.groups, counts.patches);
    EXPECT_TRUE(added) << added.error().message;
    EXPECT_TRUE(in.atEnd());
  }
  return growing;
}

/// At least as much, and at most a 64th more.
void expectRoundedUp(float stored, float error) {
  EXPECT_GE(stored, error);
  EXPECT_LE(stored, error * (1.0F + 1.0F / 64));
}

/// The stored sphere contains the other, and is larger by at most some units. Half of a chunk's patches have radii of
/// 128 of them or more.
void expectAround(const base::Sphere& stored, const base::Sphere& sphere, double unit) {
  const double moved = glm::length(glm::dvec3(stored.center) - glm::dvec3(sphere.center));
  EXPECT_GE(double{stored.radius}, moved + sphere.radius);
  EXPECT_LE(double{stored.radius}, sphere.radius + 4 * unit);
}

/// The stored cone contains the other, and is wider by at most two degrees and a half: the axis is off by one, and an
/// angle is rounded up by 0.7.
void expectAround(const base::NormalCone& stored, const base::NormalCone& cone) {
  const double between = std::acos(std::clamp(glm::dot(glm::dvec3(stored.axis), glm::dvec3(cone.axis)), -1.0, 1.0));
  const double angle = std::acos(double{stored.cos_angle});
  const double needed = std::acos(double{cone.cos_angle});
  if (stored.cos_angle == -1.0F)
    EXPECT_GE(needed, std::numbers::pi * (1 - 2.5 / 180));
  else
    EXPECT_GE(angle, needed + between - 1e-5) << "but for the rounding of floats";
  EXPECT_LE(angle, needed + 2.5 * std::numbers::pi / 180);
}

TEST(GroupRecords, countsAreTheHierarchys) {
  const auto read = GroupRecords::open(made().bytes);
  ASSERT_TRUE(read) << read.error().message;
  const RecordCounts& counts = read->counts();
  EXPECT_EQ(counts.groups, made().hierarchy.groups.size());
  EXPECT_EQ(counts.patches, made().hierarchy.patches.size());
  EXPECT_EQ(counts.patch_bytes, made().patch_bytes);
  EXPECT_EQ(counts.object_bytes, made().bytes.size());
  EXPECT_EQ(counts.lattice.origin, made().hierarchy.lattice.origin);
  EXPECT_EQ(counts.lattice.step, made().hierarchy.lattice.step);
  EXPECT_EQ(counts.source_triangles, made().hierarchy.source_triangles);
  EXPECT_TRUE(counts.has_colors);
  EXPECT_EQ(encodeRecords(made().hierarchy, made().patch_bytes), made().bytes);
}

TEST(GroupRecords, sayWhatTheTablesSay) {
  const auto read = GroupRecords::open(made().bytes);
  ASSERT_TRUE(read) << read.error().message;
  ASSERT_GT(read->chunkCount(), 10U);
  EXPECT_EQ(read->leadingGroups(), read->counts().groups);
  const Hierarchy& h = made().hierarchy;
  const Hierarchy grown = grownFrom(*read);
  ASSERT_EQ(grown.groups.size(), h.groups.size());
  ASSERT_EQ(grown.patches.size(), h.patches.size());
  for (std::uint32_t g = 0; g < h.groups.size(); ++g) {
    SCOPED_TRACE("group " + std::to_string(g));
    const Group& group = h.groups[g];
    const Group& stored = grown.groups[g];
    EXPECT_EQ(stored.level, group.level);
    EXPECT_EQ(stored.first_patch, group.first_patch);
    EXPECT_EQ(stored.patch_count, group.patch_count);
    EXPECT_EQ(stored.block_offset, group.block_offset);
    EXPECT_EQ(stored.block_bytes, group.block_bytes);
    const auto parents = h.parentsOf(g);
    const auto stored_parents = grown.parentsOf(g);
    EXPECT_TRUE(std::equal(parents.begin(), parents.end(), stored_parents.begin(), stored_parents.end()));
    expectRoundedUp(stored.error, group.error);
    expectRoundedUp(stored.attribute_error, group.attribute_error);
    expectRoundedUp(stored.typical_error, group.typical_error);
    expectRoundedUp(stored.typical_color_error, group.typical_color_error);
    expectRoundedUp(stored.visible_error, group.visible_error);
    EXPECT_EQ(read->row(g)->block_offset, group.block_offset);
    EXPECT_EQ(read->row(g)->visible_error, stored.visible_error);

    std::vector<float> radii;  // of the chunk, which give its unit
    const std::uint32_t first = g / GroupRecords::kGroupsPerChunk * GroupRecords::kGroupsPerChunk;
    const std::size_t end = std::min<std::size_t>(first + GroupRecords::kGroupsPerChunk, h.groups.size());
    for (std::uint32_t other = first; other < end; ++other)
      for (std::uint32_t p = 0; p < h.groups[other].patch_count; ++p)
        radii.push_back(h.patches[h.groups[other].first_patch + p].bounds.radius);
    std::sort(radii.begin(), radii.end());
    const double unit = std::max(h.lattice.step, double{radii[radii.size() / 2]} / 128);
    expectAround(stored.bounds, group.bounds, unit);
    for (std::uint32_t p = group.first_patch; p < group.first_patch + group.patch_count; ++p) {
      SCOPED_TRACE("patch " + std::to_string(p));
      const Patch& patch = h.patches[p];
      const Patch& kept = grown.patches[p];
      EXPECT_EQ(kept.producer, patch.producer);
      EXPECT_EQ(kept.consumer, patch.consumer);
      EXPECT_EQ(kept.level, patch.level);
      EXPECT_EQ(kept.color_detail, patch.color_detail);
      EXPECT_EQ(kept.triangles, patch.triangles);
      EXPECT_EQ(kept.vertices, patch.vertices);
      EXPECT_EQ(kept.block_offset, patch.block_offset);
      EXPECT_EQ(kept.block_bytes, patch.block_bytes);
      expectAround(kept.bounds, patch.bounds, unit);
      expectAround(kept.cone, patch.cone);
      for (int k = 0; k < 3; ++k) {
        EXPECT_LE(kept.box.min[k], patch.box.min[k]);
        EXPECT_GE(kept.box.max[k], patch.box.max[k]);
        EXPECT_GT(double{kept.box.min[k]}, patch.box.min[k] - 1.01 * unit);
        EXPECT_LT(double{kept.box.max[k]}, patch.box.max[k] + 1.01 * unit);
      }
      if (patch.producer == kNoGroup) continue;
      // The same rounding as in the producer's own record, so that errors stay monotone.
      EXPECT_EQ(kept.own_error, grown.groups[patch.producer].error);
      EXPECT_EQ(kept.own_typical_error, grown.groups[patch.producer].typical_error);
      EXPECT_EQ(kept.own_visible_error, grown.groups[patch.producer].visible_error);
    }
  }
}

TEST(GroupRecords, takeAThirdOfTheTables) {
  const std::uint64_t tables = made().hierarchy.groups.size() * 68 + made().hierarchy.patches.size() * 84;
  EXPECT_LT(made().bytes.size(), tables / 3);
}

TEST(GroupRecords, chunksComeInAnyOrder) {
  const auto whole = GroupRecords::open(made().bytes);
  auto read = GroupRecords::open(base::ByteView(made().bytes).first(whole->counts().front_bytes));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->leadingGroups(), 0U);
  std::vector<std::uint32_t> order(read->chunkCount());
  std::iota(order.begin(), order.end(), 0U);
  std::shuffle(order.begin(), order.end(), std::mt19937(5));
  for (const std::uint32_t chunk : order) {
    const std::uint32_t group = chunk * GroupRecords::kGroupsPerChunk;
    EXPECT_EQ(read->row(group), nullptr);
    EXPECT_TRUE(read->record(group).empty());
    const base::ByteView bytes =
        base::ByteView(made().bytes).subspan(read->chunkOffset(chunk), read->chunkBytes(chunk));
    ASSERT_TRUE(read->add(chunk, bytes));
    ASSERT_TRUE(read->add(chunk, bytes)) << "twice makes no difference";
    const base::ByteView record = read->record(group);
    EXPECT_TRUE(std::equal(record.begin(), record.end(), whole->record(group).begin(), whole->record(group).end()));
  }
  EXPECT_EQ(read->leadingGroups(), read->counts().groups);
}

TEST(GroupRecords, whatAFrontHoldsWholeIsThere) {
  const auto whole = GroupRecords::open(made().bytes);
  const std::uint64_t end = whole->chunkOffset(2);
  EXPECT_EQ(GroupRecords::open(base::ByteView(made().bytes).first(end))->leadingGroups(), 32U);
  EXPECT_EQ(GroupRecords::open(base::ByteView(made().bytes).first(end - 1))->leadingGroups(), 16U);
}

TEST(GroupRecords, damageIsNoticed) {
  const auto whole = GroupRecords::open(made().bytes);
  const std::uint64_t front = whole->counts().front_bytes;
  for (std::uint64_t at = 0; at < front; ++at) {
    base::Bytes damaged = made().bytes;
    damaged[at] ^= 4;
    EXPECT_FALSE(GroupRecords::open(damaged)) << at;
    EXPECT_FALSE(GroupRecords::open(base::ByteView(made().bytes).first(at))) << at;
  }
  // A damaged chunk leaves the others as they are.
  auto read = GroupRecords::open(base::ByteView(made().bytes).first(front));
  for (std::uint64_t at = 0; at < read->chunkBytes(1); ++at) {
    base::Bytes chunk(made().bytes.begin() + static_cast<std::ptrdiff_t>(read->chunkOffset(1)),
                      made().bytes.begin() + static_cast<std::ptrdiff_t>(read->chunkOffset(2)));
    EXPECT_FALSE(read->add(1, base::ByteView(chunk).first(at))) << at;
    chunk[at] ^= 4;
    EXPECT_FALSE(read->add(1, chunk)) << at;
  }
  EXPECT_FALSE(read->has(1));
  EXPECT_TRUE(read->add(0, base::ByteView(made().bytes).subspan(read->chunkOffset(0), read->chunkBytes(0))));
}

// A checksum is no guard against who means harm.
TEST(GroupRecords, sealedDamageIsNoGroupThatCannotBe) {
  const auto whole = GroupRecords::open(made().bytes);
  const RecordCounts& counts = whole->counts();
  std::mt19937 random(11);
  for (int i = 0; i < 3000; ++i) {
    auto read = GroupRecords::open(base::ByteView(made().bytes).first(counts.front_bytes));
    const std::uint32_t chunk = static_cast<std::uint32_t>(random()) % read->chunkCount();
    base::Bytes bytes(made().bytes.begin() + static_cast<std::ptrdiff_t>(read->chunkOffset(chunk)),
                      made().bytes.begin() + static_cast<std::ptrdiff_t>(read->chunkOffset(chunk + 1)));
    for (int k = 0; k < 3; ++k) bytes[4 + random() % (bytes.size() - 4)] = static_cast<std::uint8_t>(random());
    const std::uint32_t crc = base::crc32c(base::ByteView(bytes).subspan(4));
    std::memcpy(bytes.data(), &crc, sizeof(crc));
    if (!read->add(chunk, bytes)) continue;
    const std::uint32_t end = std::min((chunk + 1) * GroupRecords::kGroupsPerChunk, counts.groups);
    for (std::uint32_t group = chunk * GroupRecords::kGroupsPerChunk; group < end; ++group) {
      const Group& row = *read->row(group);
      EXPECT_LE(row.block_offset + row.block_bytes, counts.patch_bytes);
      EXPECT_LE(std::uint64_t{row.first_patch} + row.patch_count, counts.patches);
      Hierarchy growing;
      base::ByteReader in(read->record(group));
      static_cast<void>(addGroup(in, growing, counts.groups, counts.patches));
    }
  }
}

TEST(GroupRecords, aSceneOfOneGroupHasThem) {
  Hierarchy one;
  one.lattice = {glm::dvec3(-3.0, 5.0, 1e6), 0.001};
  one.groups.resize(1);
  Group& group = one.groups[0];
  group.error = group.typical_error = group.visible_error = std::numeric_limits<float>::infinity();
  group.level = 1;
  group.patch_count = 1;
  group.block_offset = 192;
  group.block_bytes = 77;
  group.bounds = {glm::vec3(1.0F, 2.0F, 1e6F), 4.0F};
  one.patches.resize(1);
  Patch& patch = one.patches[0];
  patch.bounds = group.bounds;
  patch.box.add(glm::vec3(0.0F, 0.0F, 1e6F));
  patch.box.add(glm::vec3(2.0F, 4.0F, 1e6F));
  patch.cone = {glm::vec3(0.0F), -1.0F};
  patch.triangles = 1;
  patch.vertices = 3;
  patch.block_bytes = 77;
  const base::Bytes bytes = encodeRecords(one, 269);
  const auto read = GroupRecords::open(bytes);
  ASSERT_TRUE(read) << read.error().message;
  const Hierarchy grown = grownFrom(*read);
  EXPECT_EQ(grown.groups[0].visible_error, std::numeric_limits<float>::infinity());
  EXPECT_EQ(grown.groups[0].block_offset, 192U);
  EXPECT_LE(grown.patches[0].box.min.z, 1e6F);
  EXPECT_GE(grown.patches[0].box.max.z, 1e6F);
  EXPECT_EQ(grown.patches[0].cone.cos_angle, -1.0F);
}

}  // namespace
}  // namespace lod::patch
