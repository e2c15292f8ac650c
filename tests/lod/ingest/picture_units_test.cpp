// Units of pictures outlive the run that found them, and what is damaged is as if it were not there.
#include "lod/ingest/picture_units.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <utility>
#include <vector>

#include "base/file.h"
#include "base/jpeg/blocks.h"
#include "base/jpeg/jpeg.h"
#include "lod/ingest/staged_build.h"
#include "tests/support/temporary_directory.h"

namespace lod::ingest {
namespace {

class PictureUnitsTest : public testing::Test {
 protected:
  void write(const std::vector<std::pair<mesh::SourcePicture, base::Bytes>>& all) {
    auto written = PictureUnits::create(scratch_.path());
    ASSERT_TRUE(written);
    for (const auto& [picture, units] : all) written->add(picture, units);
  }
  const support::TemporaryDirectory scratch_;
};

TEST_F(PictureUnitsTest, comeBackByTheirPicture) {
  write({{{"a.jpg", 0, 0}, base::Bytes(50, 1)},
         {{"scene.glb", 100, 20}, base::Bytes(70, 2)},
         {{"scene.glb", 120, 30}, base::Bytes(90, 3)},
         {{"a.jpg", 0, 0}, base::Bytes(10, 4)}});
  const auto read = PictureUnits::open(scratch_.path());
  ASSERT_TRUE(read);
  EXPECT_EQ(read->of({"a.jpg", 0, 0}), base::Bytes(50, 1));
  EXPECT_EQ(read->of({"scene.glb", 100, 20}), base::Bytes(70, 2));
  EXPECT_EQ(read->of({"scene.glb", 120, 30}), base::Bytes(90, 3));
  EXPECT_TRUE(read->of({"b.jpg", 0, 0}).empty());
  EXPECT_TRUE(read->of({"scene.glb", 100, 21}).empty());
}

TEST_F(PictureUnitsTest, thatAreDamagedAreLeftOut) {
  write({{{"a.jpg", 0, 0}, base::Bytes(50, 1)}, {{"b.jpg", 0, 0}, base::Bytes(50, 2)}});
  const std::string path = scratch_ / PictureUnits::kName;
  std::filesystem::resize_file(path, std::filesystem::file_size(path) - 5);
  const auto read = PictureUnits::open(scratch_.path());
  ASSERT_TRUE(read);
  EXPECT_EQ(read->of({"a.jpg", 0, 0}), base::Bytes(50, 1));
  EXPECT_TRUE(read->of({"b.jpg", 0, 0}).empty());

  std::filesystem::remove(path);
  const auto none = PictureUnits::open(scratch_.path());
  ASSERT_TRUE(none);
  EXPECT_TRUE(none->of({"a.jpg", 0, 0}).empty());
}

// A JPEG with the standard's tables whose triangles have many texels: its units are known once the mesh is read.
TEST_F(PictureUnitsTest, areThoseOfTheSourcesPictures) {
  base::Image image(256, 256, 3);
  for (std::size_t i = 0; i < image.pixels.size(); ++i) image.pixels[i] = static_cast<std::uint8_t>(i * 7 >> 4);
  base::Bytes jpeg;
  ASSERT_TRUE((*base::beginJpeg(256, 256, 90, base::Subsampling::k420, jpeg))->add(image));
  ASSERT_TRUE(base::writeFileAtomically(scratch_ / "a.jpg", jpeg));
  const auto text = [&](const char* name, std::string_view content) {
    return base::writeFileAtomically(scratch_ / name, base::viewOfText(content));
  };
  ASSERT_TRUE(text("mesh.mtl", "newmtl a\nmap_Kd a.jpg\n"));
  ASSERT_TRUE(text("mesh.obj",
                   "mtllib mesh.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
                   "usemtl a\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"));
  auto spool = SourceSpool::create(scratch_.path());
  ASSERT_TRUE(spool);
  const auto input = sourceFromFiles({scratch_ / "mesh.obj"}, {}, 1);
  ASSERT_TRUE(input);
  SourceInfo notes;
  ASSERT_TRUE(input->read(*spool, notes));
  const auto units = PictureUnits::open(scratch_.path());
  ASSERT_TRUE(units);
  const auto quarter = base::JpegBlocks::readQuarter(jpeg, std::uint64_t{1} << 30);
  ASSERT_TRUE(quarter);
  EXPECT_EQ(units->of({scratch_ / "a.jpg", 0, 0}), quarter->units);
}

}  // namespace
}  // namespace lod::ingest
