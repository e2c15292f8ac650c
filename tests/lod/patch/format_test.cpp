#include "lod/patch/format.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>

#include "base/crc32c.h"
#include "tests/lod/patch/patch_testing.h"
#include "tests/support/synthetic_hierarchy.h"

namespace lod::patch {
namespace {

using patch_testing::surfaceOf;
using support::SyntheticHierarchy;

// docs/formats/patch.md
constexpr std::size_t kHeader = 96;
constexpr std::size_t kGroupRow = 68;
constexpr std::size_t kPatchRow = 84;

class PatchFormat : public ::testing::Test {
 protected:
  PatchFormat() : path_(::testing::TempDir() + "patch_format_" + std::to_string(::getpid()) + ".lgp") {}
  ~PatchFormat() override { std::filesystem::remove(path_); }

  base::Bytes written(const SyntheticHierarchy& scene) {
    const auto result = support::writeSynthetic(scene, path_);
    EXPECT_TRUE(result) << result.error().message;
    return *base::readFile(path_);
  }
  base::Result<PatchFile> opened(const base::Bytes& bytes) {
    std::ofstream(path_, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    return PatchFile::open(path_);
  }
  std::string faultOf(const base::Bytes& bytes) {
    const auto file = opened(bytes);
    return file ? "" : file.error().message;
  }
  std::string path_;
};

template <class T>
T fieldAt(const base::Bytes& bytes, std::size_t offset) {
  T value;
  std::memcpy(&value, bytes.data() + offset, sizeof(value));
  return value;
}

// Returns the bytes with both checksums right.
base::Bytes sealed(base::Bytes bytes) {
  const auto blocks = static_cast<std::size_t>(fieldAt<std::uint64_t>(bytes, 24));
  const std::uint32_t tables = base::crc32c(base::ByteView(bytes).subspan(kHeader, blocks - kHeader));
  std::memcpy(bytes.data() + 88, &tables, 4);
  const std::uint32_t header = base::crc32c(base::ByteView(bytes).first(92));
  std::memcpy(bytes.data() + 92, &header, 4);
  return bytes;
}

template <class T>
base::Bytes withField(base::Bytes bytes, std::size_t offset, T value) {
  const bool header = offset < kHeader;
  std::memcpy(bytes.data() + offset, &value, sizeof(value));
  if (!header) return sealed(std::move(bytes));
  const std::uint32_t crc = base::crc32c(base::ByteView(bytes).first(92));
  std::memcpy(bytes.data() + 92, &crc, 4);
  return bytes;
}

TEST_F(PatchFormat, readsBackWrittenHierarchies) {
  for (const bool colors : {false, true}) {
    const SyntheticHierarchy scene = support::syntheticHierarchy(8, colors);
    written(scene);
    const auto file = PatchFile::open(path_);
    ASSERT_TRUE(file) << file.error().message;
    const Hierarchy& h = file->hierarchy();
    EXPECT_EQ(h.lattice.origin, scene.hierarchy.lattice.origin);
    EXPECT_EQ(h.lattice.step, scene.hierarchy.lattice.step);
    EXPECT_EQ(h.has_colors, colors);
    EXPECT_EQ(h.source_triangles, scene.hierarchy.source_triangles);
    EXPECT_EQ(h.parents, scene.hierarchy.parents);
    EXPECT_TRUE(h.known.empty());
    ASSERT_EQ(h.groups.size(), scene.hierarchy.groups.size());
    for (std::size_t g = 0; g < h.groups.size(); ++g) {
      EXPECT_EQ(h.groups[g].error, scene.hierarchy.groups[g].error);
      EXPECT_EQ(h.groups[g].attribute_error, scene.hierarchy.groups[g].attribute_error);
      EXPECT_EQ(h.groups[g].bounds.center, scene.hierarchy.groups[g].bounds.center);
      EXPECT_EQ(h.groups[g].bounds.radius, scene.hierarchy.groups[g].bounds.radius);
      EXPECT_EQ(h.groups[g].level, scene.hierarchy.groups[g].level);
    }
    ASSERT_EQ(h.patches.size(), scene.hierarchy.patches.size());
    for (std::uint32_t p = 0; p < h.patches.size(); ++p) {
      EXPECT_EQ(h.patches[p].box.min, scene.hierarchy.patches[p].box.min);
      EXPECT_EQ(h.patches[p].cone.cos_angle, scene.hierarchy.patches[p].cone.cos_angle);
      EXPECT_EQ(h.patches[p].producer, scene.hierarchy.patches[p].producer);
      EXPECT_EQ(h.patches[p].consumer, scene.hierarchy.patches[p].consumer);
      const auto geometry = file->geometry(p);
      ASSERT_TRUE(geometry) << geometry.error().message;
      EXPECT_TRUE(surfaceOf(*geometry) == surfaceOf(scene.geometry[p]));
    }
    EXPECT_EQ(file->verify(), std::vector<std::string>{});
    EXPECT_EQ(file->fileBytes(), std::filesystem::file_size(path_));
  }
}

TEST_F(PatchFormat, aBlockIsItsPatchesOneAfterTheOther) {
  const SyntheticHierarchy scene = support::syntheticHierarchy(4);
  written(scene);
  const auto file = PatchFile::open(path_);
  ASSERT_TRUE(file);
  for (std::uint32_t g = 0; g < file->hierarchy().groups.size(); ++g) {
    const Group& group = file->hierarchy().groups[g];
    const auto block = file->block(g);
    ASSERT_TRUE(block);
    EXPECT_EQ(group.block_offset % 16, 0U);
    base::Bytes joined;
    const auto patches = support::encodedBlock(scene, g);
    for (const base::Bytes& patch : *patches) joined.insert(joined.end(), patch.begin(), patch.end());
    EXPECT_EQ(*block, joined);
    EXPECT_EQ(*file->checkedBlock(g), joined);
    for (std::uint32_t p = group.first_patch; p < group.first_patch + group.patch_count; ++p) {
      const Patch& row = file->hierarchy().patches[p];
      EXPECT_TRUE(decodePatch(base::ByteView(*block).subspan(row.block_offset, row.block_bytes)));
    }
  }
  EXPECT_FALSE(file->block(static_cast<std::uint32_t>(file->hierarchy().groups.size())));
  EXPECT_FALSE(file->geometry(static_cast<std::uint32_t>(file->hierarchy().patches.size())));
}

TEST_F(PatchFormat, aFileThatIsCutWhileItIsOpenGivesErrors) {
  const SyntheticHierarchy scene = support::syntheticHierarchy(4);
  for (const bool to_nothing : {false, true}) {
    const base::Bytes bytes = written(scene);
    const auto file = PatchFile::open(path_);
    ASSERT_TRUE(file);
    const Hierarchy& h = file->hierarchy();
    const std::uint64_t left = to_nothing ? 0 : h.groups.back().block_offset + 1;
    std::filesystem::resize_file(path_, left);
    for (std::uint32_t g = 0; g < h.groups.size(); ++g) {
      const bool is_there = h.groups[g].block_offset + h.groups[g].block_bytes <= left;
      EXPECT_EQ(bool(file->block(g)), is_there);
      EXPECT_EQ(bool(file->checkedBlock(g)), is_there);
      for (std::uint32_t p = h.groups[g].first_patch; is_there && p < h.groups[g].first_patch + 1; ++p)
        EXPECT_TRUE(file->geometry(p));
    }
    const auto lost = file->geometry(h.groups.back().first_patch);
    ASSERT_FALSE(lost);
    EXPECT_NE(lost.error().message.find(path_), std::string::npos) << lost.error().message;
    EXPECT_FALSE(file->verify().empty());
    EXPECT_EQ(file->fileBytes(), bytes.size());
  }
}

// A byte of each patch is changed while the file is open.
TEST_F(PatchFormat, damageIsFoundInACheckedBlock) {
  const SyntheticHierarchy scene = support::syntheticHierarchy(4);
  base::Bytes bytes = written(scene);
  const auto file = PatchFile::open(path_);
  ASSERT_TRUE(file);
  const Hierarchy& h = file->hierarchy();
  std::fstream out(path_, std::ios::in | std::ios::out | std::ios::binary);
  for (std::uint32_t p = 0; p < h.patches.size(); ++p) {
    const Patch& patch = h.patches[p];
    const std::uint64_t at = h.groups[patch.consumer].block_offset + patch.block_offset + patch.block_bytes / 2;
    const auto overwrite = [&](std::uint8_t byte) {
      out.seekp(static_cast<std::streamoff>(at));
      out.put(static_cast<char>(byte));
      out.flush();
    };
    overwrite(bytes[at] ^ 0x10U);
    const auto block = file->checkedBlock(patch.consumer);
    ASSERT_FALSE(block);
    EXPECT_NE(block.error().message.find("patch " + std::to_string(p) + ":"), std::string::npos)
        << block.error().message;
    EXPECT_TRUE(file->block(patch.consumer));
    overwrite(bytes[at]);
    EXPECT_TRUE(file->checkedBlock(patch.consumer));
  }
}

TEST_F(PatchFormat, theFrontAloneGivesTheHierarchy) {
  const base::Bytes bytes = written(support::syntheticHierarchy(4));
  const auto counts = readTableCounts(base::ByteView(bytes).first(kHeader));
  ASSERT_TRUE(counts);
  const auto length = static_cast<std::size_t>(counts->blocks_offset);
  EXPECT_LT(length, bytes.size());
  EXPECT_TRUE(readTables(base::ByteView(bytes).first(length)));
  for (std::size_t cut = 0; cut < length; ++cut) EXPECT_FALSE(readTables(base::ByteView(bytes).first(cut))) << cut;
}

TEST_F(PatchFormat, everyCutIsRefusedByName) {
  const base::Bytes bytes = written(support::syntheticHierarchy(4));
  for (std::size_t length = 0; length < bytes.size(); length += length < 300 ? 1 : 37) {
    const std::string fault = faultOf(base::Bytes(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(length)));
    EXPECT_NE(fault.find(path_), std::string::npos) << length;
  }
  base::Bytes longer = bytes;
  longer.push_back(0);
  EXPECT_NE(faultOf(longer).find("its header says"), std::string::npos);
}

TEST_F(PatchFormat, everyFlippedBitInHeaderOrTablesIsNoticedOnOpening) {
  base::Bytes bytes = written(support::syntheticHierarchy(4));
  const auto tables_end = static_cast<std::size_t>(fieldAt<std::uint64_t>(bytes, 24));
  for (std::size_t bit = 0; bit < tables_end * 8; bit += bit < kHeader * 8 ? 1 : 31) {
    bytes[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
    EXPECT_FALSE(readTables(bytes)) << bit;
    bytes[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
  }
}

TEST_F(PatchFormat, everyDamagedByteBehindTheTablesIsNoticedByVerify) {
  base::Bytes bytes = written(support::syntheticHierarchy(4));
  const auto tables_end = static_cast<std::size_t>(fieldAt<std::uint64_t>(bytes, 24));
  for (std::size_t at = tables_end; at < bytes.size(); at += 41) {
    bytes[at] ^= 0x10;
    const auto file = opened(bytes);
    ASSERT_TRUE(file);
    EXPECT_EQ(file->verify().size(), 1U) << at;
    bytes[at] ^= 0x10;
  }
}

TEST_F(PatchFormat, aWrongFileOrVersionIsNamed) {
  const base::Bytes bytes = written(support::syntheticHierarchy(4));
  EXPECT_NE(faultOf(base::Bytes(500, 'x')).find("not a patch.lgp"), std::string::npos);
  EXPECT_NE(faultOf({}).find("not a patch.lgp"), std::string::npos);
  for (const std::uint32_t version : {1U, 4U}) {
    const auto other = opened(withField<std::uint32_t>(bytes, 8, version));
    ASSERT_FALSE(other);
    EXPECT_EQ(other.error().code, base::ErrorCode::kVersion);
  }
  const auto missing = PatchFile::open(path_ + ".none");
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().code, base::ErrorCode::kNotFound);
}

TEST_F(PatchFormat, eachWrongNumberInTheHeaderIsNamed) {
  const base::Bytes bytes = written(support::syntheticHierarchy(4));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE(faultOf(withField<std::uint32_t>(bytes, 12, 97)).find("97 bytes"), std::string::npos);
  EXPECT_NE(faultOf(withField<std::uint64_t>(bytes, 16, bytes.size() + 1)).find("its header says"), std::string::npos);
  base::Bytes longer = bytes;
  longer.push_back(0);
  EXPECT_NE(faultOf(withField<std::uint64_t>(longer, 16, longer.size())).find("not as long as its blocks"),
            std::string::npos);
  EXPECT_NE(faultOf(withField<std::uint64_t>(bytes, 24, 112)).find("behind the tables"), std::string::npos);
  EXPECT_NE(faultOf(withField(bytes, 32, nan)).find("lattice"), std::string::npos);
  EXPECT_NE(faultOf(withField(bytes, 56, 0.0)).find("lattice"), std::string::npos);
  EXPECT_NE(faultOf(withField(bytes, 56, nan)).find("lattice"), std::string::npos);
  EXPECT_NE(faultOf(withField<std::uint32_t>(bytes, 72, 2)).find("flags"), std::string::npos);
  for (const std::size_t count : {76U, 80U, 84U}) {
    EXPECT_FALSE(faultOf(withField<std::uint32_t>(bytes, count, 0)).empty());
    EXPECT_FALSE(faultOf(withField<std::uint32_t>(bytes, count, 0xFFFFFFFF)).empty());
  }
}

// Breaks one field of a sound file and expects open() to name the fault.
struct Break {
  const char* what;
  std::size_t offset;
  std::uint32_t value;
};

std::uint32_t bitsOf(float x) {
  return std::bit_cast<std::uint32_t>(x);
}

TEST_F(PatchFormat, eachWrongGroupRowIsNamed) {
  const base::Bytes bytes = written(support::syntheticHierarchy(4));
  const auto at = [](std::size_t group, std::size_t field) { return kHeader + group * kGroupRow + field; };
  const std::uint32_t nan = bitsOf(std::numeric_limits<float>::quiet_NaN());
  const auto last = std::size_t{fieldAt<std::uint32_t>(bytes, 76)} - 1;
  for (const Break& broken :
       {Break{"group 2: its sphere is not", at(2, 0), nan},
        Break{"group 2: its sphere is not", at(2, 12), bitsOf(-1.0F)},
        Break{"group 2: its error is not", at(2, 16), nan},
        Break{"group 2: its error is not", at(2, 16), bitsOf(-1.0F)},
        Break{"group 2: its error is not", at(2, 16), bitsOf(std::numeric_limits<float>::infinity())},
        Break{"group 0 must have infinite errors", at(0, 16), bitsOf(1.0F)},
        Break{"its error is larger than that of its parent 1", at(2, 16), bitsOf(1e6F)},
        Break{"its sphere sticks out of that of its parent 1", at(2, 0), bitsOf(1e3F)},
        Break{"group 2: its attribute error", at(2, 20), nan},
        Break{"group 2: its error is not", at(2, 24), nan},
        Break{"group 0 must have infinite errors", at(0, 24), bitsOf(1.0F)},
        Break{"its error is larger than that of its parent 1", at(2, 24), bitsOf(1e6F)},
        Break{"group 2: its typical colour error", at(2, 28), bitsOf(-1.0F)},
        Break{"group 2: its error is not", at(2, 32), nan},
        Break{"group 0 must have infinite errors", at(0, 32), bitsOf(1.0F)},
        Break{"its error is larger than that of its parent 1", at(2, 32), bitsOf(1e6F)},
        Break{"group 2: its level is 0", at(2, 36), 0},
        Break{"its level is not its producer's", at(last, 36), 2},
        Break{"consumes patches that aren't there", at(2, 40), 0xFFFFFFFF},
        Break{"names another consumer", at(2, 40), 0},
        Break{"group 2: it consumes no patches", at(2, 44), 0},
        Break{"together they consume", at(2, 44), 1},
        Break{"consumes patches that aren't there", at(2, 44), 0xFFFFFFFF},
        Break{"its parents aren't in the table", at(2, 48), 0xFFFFFFFF},
        Break{"group 2: it has no parents", at(2, 52), 0},
        Break{"group 0 must have no parents", at(0, 52), 1},
        Break{"its parents aren't in the table", at(2, 52), 0xFFFF},
        Break{"its block has not the length", at(2, 56), 3},
        Break{"its block is not where", at(2, 60), 3}}) {
    const std::string fault = faultOf(withField(bytes, broken.offset, broken.value));
    EXPECT_NE(fault.find(broken.what), std::string::npos) << "said: " << fault << "\nmust say: " << broken.what;
  }
}

TEST_F(PatchFormat, eachWrongPatchRowIsNamed) {
  const base::Bytes bytes = written(support::syntheticHierarchy(4));
  const std::size_t patches = kHeader + kGroupRow * fieldAt<std::uint32_t>(bytes, 76);
  const auto at = [&](std::size_t patch, std::size_t field) { return patches + patch * kPatchRow + field; };
  const std::uint32_t nan = bitsOf(std::numeric_limits<float>::quiet_NaN());
  const auto last = std::size_t{fieldAt<std::uint32_t>(bytes, 80)} - 1;
  for (const Break& broken :
       {Break{"patch 3: its box", at(3, 0), nan}, Break{"patch 3: its box", at(3, 0), bitsOf(1e6F)},
        Break{"patch 3: its sphere", at(3, 24), nan}, Break{"patch 3: its normal cone", at(3, 40), nan},
        Break{"patch 3: its normal cone", at(3, 52), bitsOf(1.5F)},
        Break{"patch 3: its producer doesn't lie below", at(3, 56), 0},
        Break{"patch 3: its producer is not there", at(3, 56), 5000},
        Break{"patch 3: a leaf has level 0", at(3, 56), kNoGroup},
        Break{"patch 3: lies in the range of group", at(3, 60), 0}, Break{"a leaf has level 0", at(last, 64), 1},
        Break{"patch 3: its level is not below", at(3, 64), 9}, Break{"patch 3: its triangle count", at(3, 68), 0},
        Break{"patch 3: its vertex count", at(3, 72), 65536}, Break{"patch 3: its bytes are not where", at(3, 76), 1},
        Break{"its bytes are not where", at(1, 80), 1}}) {
    const std::string fault = faultOf(withField(bytes, broken.offset, broken.value));
    EXPECT_NE(fault.find(broken.what), std::string::npos) << "said: " << fault << "\nmust say: " << broken.what;
  }
}

TEST_F(PatchFormat, eachWrongParentIsNamed) {
  const SyntheticHierarchy scene = support::syntheticHierarchy(4);
  const base::Bytes bytes = written(scene);
  const std::size_t parents =
      kHeader + kGroupRow * scene.hierarchy.groups.size() + kPatchRow * scene.hierarchy.patches.size();
  const auto many = std::find_if(scene.hierarchy.groups.begin(), scene.hierarchy.groups.end(),
                                 [](const Group& g) { return g.parent_count == 2; });
  ASSERT_NE(many, scene.hierarchy.groups.end());
  const std::size_t at = parents + 4 * many->first_parent;
  const auto second = fieldAt<std::uint32_t>(bytes, at + 4);
  EXPECT_NE(faultOf(withField<std::uint32_t>(bytes, at, second)).find("parents"), std::string::npos) << "named twice";
  EXPECT_NE(faultOf(withField<std::uint32_t>(bytes, at, 0)).find("is among its parents"), std::string::npos);
  EXPECT_NE(faultOf(withField<std::uint32_t>(bytes, at, 500)).find("no smaller number"), std::string::npos);
}

TEST_F(PatchFormat, verifyComparesGeometryWithRecords) {
  const SyntheticHierarchy sound = support::syntheticHierarchy(4);
  const auto faults = [&](auto&& spoil) {
    SyntheticHierarchy scene = sound;
    spoil(scene.hierarchy);
    written(scene);
    const auto file = PatchFile::open(path_);
    EXPECT_TRUE(file) << file.error().message;
    return file ? file->verify() : std::vector<std::string>{};
  };
  EXPECT_TRUE(faults([](Hierarchy&) {}).empty());
  const auto box = faults([](Hierarchy& h) { h.patches[4].box.max.x -= 0.5F; });
  ASSERT_EQ(box.size(), 1U);
  EXPECT_NE(box[0].find("patch 4: its box"), std::string::npos);
  const auto sphere = faults([](Hierarchy& h) { h.patches[4].bounds.radius *= 0.9F; });
  ASSERT_EQ(sphere.size(), 1U);
  EXPECT_NE(sphere[0].find("patch 4: its sphere"), std::string::npos);
  const auto cone = faults([](Hierarchy& h) { h.patches[4].cone = {glm::vec3(0, 0, 1), 0.9999F}; });
  ASSERT_EQ(cone.size(), 1U);
  EXPECT_NE(cone[0].find("patch 4: its normal cone"), std::string::npos);
  const auto group = faults([](Hierarchy& h) { h.groups.back().bounds.radius *= 0.5F; });
  ASSERT_FALSE(group.empty());
  EXPECT_NE(group[0].find("the sphere of the group"), std::string::npos);
  const auto colors = faults([](Hierarchy& h) { h.has_colors = true; });
  EXPECT_EQ(colors.size(), sound.hierarchy.patches.size());
}

TEST_F(PatchFormat, theWriterRefusesWhatItsReaderWould) {
  SyntheticHierarchy scene = support::syntheticHierarchy(4);
  scene.hierarchy.groups[3].error = 1e6F;
  const auto result = support::writeSynthetic(scene, path_);
  ASSERT_FALSE(result);
  EXPECT_NE(result.error().message.find("its error is larger"), std::string::npos);
  EXPECT_FALSE(std::filesystem::exists(path_));
}

TEST_F(PatchFormat, theWriterRefusesPatchesThatAreNotTheirRecords) {
  SyntheticHierarchy scene = support::syntheticHierarchy(4);
  ++scene.hierarchy.patches[5].triangles;
  const auto counts = support::writeSynthetic(scene, path_);
  ASSERT_FALSE(counts);
  EXPECT_NE(counts.error().message.find("patch 5: its bytes hold"), std::string::npos);
  --scene.hierarchy.patches[5].triangles;
  const auto missing =
      writePatchFile(path_, scene.hierarchy, [&](std::uint32_t) { return std::vector<base::Bytes>{}; });
  ASSERT_FALSE(missing);
  EXPECT_NE(missing.error().message.find("group 0: 0 encoded patches for 1"), std::string::npos);
}

TEST_F(PatchFormat, aFailedWriteLeavesTheOldFileAndNoOther) {
  const SyntheticHierarchy scene = support::syntheticHierarchy(4);
  const base::Bytes before = written(scene);
  for (std::uint32_t fails_at = 0; fails_at < scene.hierarchy.groups.size(); ++fails_at) {
    const auto result =
        writePatchFile(path_, scene.hierarchy, [&](std::uint32_t g) -> base::Result<std::vector<base::Bytes>> {
          if (g == fails_at) return base::Error{base::ErrorCode::kNoSpace, "spool: full"};
          return support::encodedBlock(scene, g);
        });
    ASSERT_FALSE(result);
    EXPECT_EQ(result.error().code, base::ErrorCode::kNoSpace);
    EXPECT_EQ(result.error().message, "spool: full");
  }
  EXPECT_EQ(*base::readFile(path_), before);
  for (const auto& entry : std::filesystem::directory_iterator(::testing::TempDir()))
    EXPECT_EQ(entry.path().string().find(path_ + "."), std::string::npos) << entry.path();
}

TEST_F(PatchFormat, aFolderThatIsNotThereIsAnErrorWithThePath) {
  const auto result = support::writeSynthetic(support::syntheticHierarchy(4), path_ + ".d/x.lgp");
  ASSERT_FALSE(result);
  EXPECT_NE(result.error().message.find(path_), std::string::npos);
}

}  // namespace
}  // namespace lod::patch
