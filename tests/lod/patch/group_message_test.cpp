#include <gtest/gtest.h>

#include <cstring>
#include <random>

#include "lod/patch/format.h"
#include "lod/patch/traverse.h"
#include "tests/support/synthetic_hierarchy.h"

namespace lod::patch {
namespace {

using support::SyntheticHierarchy;

constexpr std::size_t kGroupRow = 4;
constexpr std::size_t kFirstPatchRow = 4 + 68;

const SyntheticHierarchy& scene() {
  static const SyntheticHierarchy made = [] {
    SyntheticHierarchy s = support::syntheticHierarchy(8);
    for (Patch& patch : s.hierarchy.patches) patch.block_bytes = 100;
    for (Group& group : s.hierarchy.groups) {
      for (std::uint32_t i = 0; i < group.patch_count; ++i)
        s.hierarchy.patches[group.first_patch + i].block_offset = 100 * i;
      group.block_bytes = 100 * group.patch_count;
    }
    return s;
  }();
  return made;
}

std::uint32_t groupTotal() {
  return static_cast<std::uint32_t>(scene().hierarchy.groups.size());
}
std::uint32_t patchTotal() {
  return static_cast<std::uint32_t>(scene().hierarchy.patches.size());
}

base::Bytes message(std::uint32_t group) {
  base::ByteWriter out;
  encodeGroup(scene().hierarchy, group, out);
  return out.takeBytes();
}

base::Result<std::uint32_t> add(base::ByteView bytes, Hierarchy& growing) {
  base::ByteReader in(bytes);
  return addGroup(in, growing, groupTotal(), patchTotal());
}

Hierarchy emptyOne() {
  Hierarchy growing;
  growing.lattice = scene().hierarchy.lattice;
  growing.source_triangles = scene().hierarchy.source_triangles;
  return growing;
}

CutRequest request() {
  base::ViewCamera view;
  view.position = {4.0, -6.0, 5.0};
  view.direction = glm::normalize(glm::dvec3(0.2, 1.0, -0.4));
  view.up = {0.0, 0.0, 1.0};
  CutRequest r;
  r.camera = base::cameraFromView(view, glm::dvec3(0.0), 0.01F, 1000.0F);
  r.tolerance_px = 0.5F;
  return r;
}

// Field by field, so that a difference has a name.
void expectSameRows(const Hierarchy& a, const Hierarchy& b) {
  EXPECT_EQ(a.parents, b.parents);
  ASSERT_EQ(a.groups.size(), b.groups.size());
  ASSERT_EQ(a.patches.size(), b.patches.size());
  for (std::uint32_t g = 0; g < a.groups.size(); ++g) {
    base::ByteWriter from_a;
    base::ByteWriter from_b;
    encodeGroup(a, g, from_a);
    encodeGroup(b, g, from_b);
    EXPECT_EQ(from_a.view(), from_b.view()) << "group " << g;
  }
}

TEST(GroupMessage, aHierarchyGrownInOrderIsTheOriginal) {
  Hierarchy growing = emptyOne();
  for (std::uint32_t g = 0; g < groupTotal(); ++g) {
    EXPECT_FALSE(growing.isKnown(g) && !growing.known.empty());
    const auto added = add(message(g), growing);
    ASSERT_TRUE(added) << added.error().message;
    EXPECT_EQ(*added, g);
    EXPECT_TRUE(growing.isKnown(g));
  }
  expectSameRows(growing, scene().hierarchy);
  EXPECT_TRUE(checkHierarchy(growing));
}

TEST(GroupMessage, severalMessagesInOneBufferAreReadOneByOne) {
  base::ByteWriter out;
  for (std::uint32_t g = 0; g < groupTotal(); ++g) encodeGroup(scene().hierarchy, g, out);
  base::ByteReader in(out.view());
  Hierarchy growing = emptyOne();
  for (std::uint32_t g = 0; g < groupTotal(); ++g) ASSERT_TRUE(addGroup(in, growing, groupTotal(), patchTotal()));
  EXPECT_TRUE(in.atEnd());
}

TEST(GroupMessage, anyOrderAndRepeatsGiveTheSameCut) {
  std::mt19937 random(9);
  std::vector<std::uint32_t> order;
  for (std::uint32_t g = 0; g < groupTotal(); ++g) order.insert(order.end(), 2, g);
  std::shuffle(order.begin(), order.end(), random);
  Hierarchy growing = emptyOne();
  for (const std::uint32_t g : order) ASSERT_TRUE(add(message(g), growing));
  EXPECT_EQ(growing.parents.size(), scene().hierarchy.parents.size());
  const Cut cut = selectCut(growing, request());
  EXPECT_EQ(cut.patches, selectCut(scene().hierarchy, request()).patches);
  EXPECT_GT(cut.patches.size(), 5U);
}

TEST(GroupMessage, aHalfGrownHierarchyIsCutLikeAWholeOneWithTheRestMissing) {
  std::mt19937 random(10);
  for (int trial = 0; trial < 50; ++trial) {
    Hierarchy growing = emptyOne();
    std::vector<bool> here(groupTotal(), false);
    for (std::uint32_t g = 0; g < groupTotal(); ++g) {
      here[g] = g == 0 || random() % 100 < 80;
      if (here[g]) {
        ASSERT_TRUE(add(message(g), growing));
      }
    }
    const Cut grown = selectCut(growing, request());
    const Cut whole = selectCut(scene().hierarchy, request(), [&](std::uint32_t g) { return here[g]; });
    EXPECT_EQ(grown.patches, whole.patches);
    EXPECT_EQ(grown.expanded, whole.expanded);
    EXPECT_TRUE(grown.wanted.empty()) << "nothing is known of an unknown group";
    EXPECT_GE(grown.error_px, whole.error_px) << "a bound stands in for what isn't known";
    EXPECT_EQ(selectUniformCut(growing, 0.0F).patches.empty(), false);
  }
}

// The groups disagree: a patch of group 1 names group g as its producer, but g names another parent, which is not
// expanded.
TEST(GroupMessage, aGroupIsNotExpandedBehindAParentThatItDoesNotName) {
  Hierarchy growing = emptyOne();
  ASSERT_TRUE(add(message(0), growing));
  base::Bytes first = message(1);
  const std::uint32_t child = groupTotal() - 1;
  std::memcpy(first.data() + kFirstPatchRow + 56, &child, 4);
  ASSERT_TRUE(add(first, growing));
  // The child names its first parent only, which is not here.
  ASSERT_GT(scene().hierarchy.parentsOf(child)[0], 1U);
  base::Bytes orphan = message(child);
  orphan.resize(orphan.size() - 4 * (scene().hierarchy.groups[child].parent_count - 1));
  const std::uint32_t one = 1;
  std::memcpy(orphan.data() + kGroupRow + 52, &one, 4);
  ASSERT_TRUE(add(orphan, growing));
  CutRequest everything = request();
  everything.tolerance_px = 0.0F;
  everything.cull = false;
  EXPECT_EQ(selectCut(growing, everything).expanded, (std::vector<std::uint32_t>{0, 1}));
}

TEST(GroupMessage, everyCutIsRefusedAndChangesNothing) {
  const base::Bytes bytes = message(5);
  Hierarchy growing = emptyOne();
  for (std::size_t length = 0; length < bytes.size(); ++length) {
    base::ByteReader in(base::ByteView(bytes).first(length));
    EXPECT_FALSE(addGroup(in, growing, groupTotal(), patchTotal())) << length;
  }
  EXPECT_TRUE(growing.groups.empty() && growing.patches.empty() && growing.parents.empty() && growing.known.empty());
}

TEST(GroupMessage, eachWrongNumberIsNamedAndChangesNothing) {
  struct Break {
    const char* what;
    std::size_t offset;
    std::uint32_t value;
  };
  const std::uint32_t nan = 0x7FC00000;
  const std::size_t patch = kFirstPatchRow;
  const auto parents = message(5).size() - 4 * scene().hierarchy.groups[5].parent_count;
  for (const Break& broken : {Break{"the scene has", 0, groupTotal()},
                              Break{"names another consumer", 0, 6},
                              Break{"its sphere", kGroupRow, nan},
                              Break{"its error", kGroupRow + 16, nan},
                              Break{"its error", kGroupRow + 32, nan},
                              Break{"its error", kGroupRow + 24, nan},
                              Break{"its level", kGroupRow + 36, 0},
                              Break{"the scene has", kGroupRow + 40, patchTotal()},
                              Break{"the scene has", kGroupRow + 40, 0xFFFFFFFF},
                              Break{"consumes no patches", kGroupRow + 44, 0},
                              Break{"cut short", kGroupRow + 44, 0xFFFFFFFF},
                              Break{"no parents", kGroupRow + 52, 0},
                              Break{"cut short", kGroupRow + 52, 0xFFFFFFFF},
                              Break{"length of its patches", kGroupRow + 56, 1},
                              Break{"its box", patch, nan},
                              Break{"doesn't lie below", patch + 56, 5},
                              Break{"producer that the scene hasn't", patch + 56, groupTotal()},
                              Break{"another consumer", patch + 60, 2},
                              Break{"its triangle count", patch + 68, 70000},
                              Break{"bytes are not where", patch + 76, 1},
                              Break{"no smaller number", parents, 5}}) {
    base::Bytes bytes = message(5);
    std::memcpy(bytes.data() + broken.offset, &broken.value, 4);
    Hierarchy growing = emptyOne();
    const auto added = add(bytes, growing);
    ASSERT_FALSE(added) << broken.what;
    EXPECT_NE(added.error().message.find(broken.what), std::string::npos)
        << added.error().message << "\nmust say: " << broken.what;
    EXPECT_TRUE(growing.groups.empty() && growing.patches.empty() && growing.parents.empty() && growing.known.empty());
  }
}

TEST(GroupMessage, aParentNamedTwiceIsRefused) {
  const auto& groups = scene().hierarchy.groups;
  std::uint32_t g = 0;
  while (groups[g].parent_count != 2) ++g;
  base::Bytes bytes = message(g);
  std::memcpy(bytes.data() + bytes.size() - 4, bytes.data() + bytes.size() - 8, 4);
  Hierarchy growing = emptyOne();
  EXPECT_FALSE(add(bytes, growing));
}

TEST(GroupMessage, patchesOfAnotherGroupCanNotBeTaken) {
  Hierarchy growing = emptyOne();
  ASSERT_TRUE(add(message(4), growing));
  base::Bytes thief = message(5);
  std::memcpy(thief.data() + kGroupRow + 40, &scene().hierarchy.groups[4].first_patch, 4);
  const auto added = add(thief, growing);
  ASSERT_FALSE(added);
  EXPECT_NE(added.error().message.find("another group's"), std::string::npos);
}

}  // namespace
}  // namespace lod::patch
