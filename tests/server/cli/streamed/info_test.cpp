#include "server/cli/streamed/info.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "base/file.h"
#include "tests/support/made_hlod.h"
#include "tests/support/made_pmr.h"
#include "tests/support/temporary_directory.h"

namespace server::cli {
namespace {

class StreamedInfoTest : public testing::Test {
 protected:
  base::Result<nlohmann::json> infoOf(const base::Bytes& file) {
    EXPECT_TRUE(base::writeFileAtomically(directory_ / "pmr.lgm", file));
    return readUmbrellasJson(directory_ / "pmr.lgm");
  }
  void expectError(const base::Bytes& file, const std::string& part) {
    const auto info = infoOf(file);
    ASSERT_FALSE(info);
    EXPECT_EQ(info.error().code, base::ErrorCode::kInvalidInput);
    EXPECT_NE(info.error().message.find("pmr.lgm: "), std::string::npos) << info.error().message;
    EXPECT_NE(info.error().message.find(part), std::string::npos) << info.error().message;
  }
  const support::TemporaryDirectory directory_;
  const support::MadePmr made_ = support::madePmr();
};

TEST_F(StreamedInfoTest, levelsOfAFileAreCounted) {
  const auto info = infoOf(made_.file);
  ASSERT_TRUE(info) << info.error().message;
  EXPECT_EQ((*info)["points"], made_.header.points);
  EXPECT_EQ((*info)["levels"].size(), lod::pmr::kLevels);
  EXPECT_EQ((*info)["levels"][0]["points"], made_.header.points);
}

TEST_F(StreamedInfoTest, aFileOfAnotherLengthThanItsHeaderSaysIsAnErrorThatNamesIt) {
  base::Bytes cut = made_.file;
  cut.pop_back();
  expectError(cut,
              "has " + std::to_string(cut.size()) + " bytes, its header says " + std::to_string(made_.file.size()));
  expectError({}, "not a pmr.lgm");
}

// Memory for the table is asked for only where the file is as long.
TEST_F(StreamedInfoTest, aHeaderWithAHugeTableIsRefused) {
  lod::pmr::Header header = made_.header;
  header.table_bytes = 0xFFFF'FFFF;
  header.file_bytes = std::uint64_t{1} << 40;
  header.base_bytes = 0;
  expectError(lod::pmr::headerBytes(header), "its header says 1099511627776");
}

TEST_F(StreamedInfoTest, depthsOfAnOctreeAreCounted) {
  const support::MadeHlod made = support::HlodMaker(3, 8, true).make();
  const std::string path = directory_ / "hlod.lgh";
  ASSERT_TRUE(base::writeFileAtomically(path, made.file));
  const auto info = readHlodJson(path);
  ASSERT_TRUE(info) << info.error().message;
  EXPECT_EQ((*info)["bytes"], made.file.size());
  EXPECT_EQ((*info)["nodes"], 1 + 4 + 16 + 64);
  EXPECT_EQ((*info)["triangles"], made.header.source_triangles);
  const auto& levels = (*info)["levels"];
  ASSERT_EQ(levels.size(), 4U);
  std::uint64_t bytes = lod::hlod::kHeaderBytes + made.header.table_bytes;
  std::uint64_t number = 0;
  for (std::size_t depth = 0; depth < levels.size(); ++depth) {
    const std::uint64_t nodes = std::uint64_t{1} << 2 * depth;
    EXPECT_EQ(levels[depth]["nodes"], nodes);
    std::uint64_t triangles = 0, points = 0;
    float error = 0.0F;
    for (; nodes != 0 && number < (4 * nodes - 1) / 3; ++number) {
      triangles += made.nodes[number].triangles, points += made.nodes[number].points;
      error = std::max(error, made.nodes[number].error);
    }
    EXPECT_EQ(levels[depth]["triangles"], triangles);
    EXPECT_EQ(levels[depth]["points"], points);
    EXPECT_EQ(levels[depth]["largest_error"], error);
    bytes += levels[depth]["picture_bytes"].get<std::uint64_t>() + levels[depth]["caster_bytes"].get<std::uint64_t>();
  }
  EXPECT_EQ(levels[3]["triangles"], made.header.source_triangles);
  EXPECT_EQ(bytes, made.file.size());
  const std::string text = describeHlod(*info);
  EXPECT_NE(text.find("85 nodes"), std::string::npos) << text;
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 4);
}

TEST_F(StreamedInfoTest, anOctreeOfAnotherLengthThanItsHeaderSaysIsAnErrorThatNamesIt) {
  base::Bytes file = support::HlodMaker(1, 8, false).make().file;
  file.push_back(0);
  const std::string path = directory_ / "hlod.lgh";
  ASSERT_TRUE(base::writeFileAtomically(path, file));
  const auto info = readHlodJson(path);
  ASSERT_FALSE(info);
  EXPECT_EQ(info.error().code, base::ErrorCode::kInvalidInput);
  EXPECT_NE(info.error().message.find("hlod.lgh: "), std::string::npos) << info.error().message;
}

}  // namespace
}  // namespace server::cli
