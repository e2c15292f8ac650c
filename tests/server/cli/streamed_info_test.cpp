#include "server/cli/streamed_info.h"

#include <gtest/gtest.h>

#include "base/file.h"
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

}  // namespace
}  // namespace server::cli
