#include "client/native/user_files.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>

#include "base/file.h"

namespace client {
namespace {

class UserFiles : public ::testing::Test {
 protected:
  void SetUp() override {
    directory = (std::filesystem::temp_directory_path() / ("lumigrid_user_" + std::to_string(::getpid()))).string();
    std::filesystem::remove_all(directory);
  }
  void TearDown() override { std::filesystem::remove_all(directory); }
  void write(const std::string& file, const std::string& text) const {
    std::filesystem::create_directories(directory);
    ASSERT_TRUE(bool(base::writeFileAtomically(directory + "/" + file, base::Bytes(text.begin(), text.end()))));
  }
  std::string directory;
};

TEST_F(UserFiles, settingsComeBackAsTheyWereKept) {
  Settings settings;
  settings.fov_degrees = 60.5;
  settings.images = 0.0;
  settings.points = 4.0;
  settings.theme = 1.0;
  ASSERT_TRUE(bool(writeSettings(directory, settings))) << "the directory is made";
  const ReadSettings read = readSettings(directory);
  EXPECT_TRUE(read.complaints.empty());
  EXPECT_EQ(read.settings, settings);
}

TEST_F(UserFiles, onlyWhatDiffersIsWritten) {
  EXPECT_EQ(formatSettings({}), "{\n \"version\": 1\n}\n");
  Settings settings;
  settings.theme = 2.0;
  EXPECT_EQ(formatSettings(settings), "{\n \"version\": 1,\n \"theme\": \"dark\"\n}\n");
}

TEST_F(UserFiles, withoutAFileTheDefaultsHold) {
  const ReadSettings read = readSettings(directory);
  EXPECT_TRUE(read.complaints.empty());
  EXPECT_EQ(read.settings, Settings());
  EXPECT_TRUE(readSettings("").complaints.empty());
  EXPECT_FALSE(bool(writeSettings("", {})));
}

TEST_F(UserFiles, namesWrongSettingsAndKeepsTheOthers) {
  const ReadSettings read = parseSettings(R"({"version": 1, "fov_degrees": 60, "points": 99, "images": "yes", )"
                                          R"("theme": "purple", "samples": 2.5, "colour": 1})");
  EXPECT_EQ(read.settings.fov_degrees, 60.0);
  Settings expected;
  expected.fov_degrees = 60.0;
  EXPECT_EQ(read.settings, expected);
  EXPECT_EQ(read.complaints.size(), 5U);
  for (const char* bad : {"", "[]", "{", "{\"version\": 2}", "{\"fov_degrees\": 60}"}) {
    EXPECT_EQ(parseSettings(bad).complaints.size(), 1U) << bad;
    EXPECT_EQ(parseSettings(bad).settings, Settings());
  }
}

TEST_F(UserFiles, bookmarksAreKeptPerScene) {
  Bookmarks one;
  one[3] = "v=1&p=1,2,3&a=0,0&r=1";
  ASSERT_TRUE(bool(writeBookmarks(directory, "a@0,0,0", one)));
  Bookmarks two;
  two[9] = "v=1&p=4,5,6&a=0,0&r=1";
  ASSERT_TRUE(bool(writeBookmarks(directory, "b@0,0,0", two)));
  EXPECT_EQ(*readBookmarks(directory, "a@0,0,0"), one);
  EXPECT_EQ(*readBookmarks(directory, "b@0,0,0"), two);
  EXPECT_EQ(*readBookmarks(directory, "c@0,0,0"), Bookmarks());
}

TEST_F(UserFiles, aBrokenFileOfBookmarksIsNotOverwritten) {
  write("bookmarks.json", "precious, but not JSON");
  EXPECT_FALSE(bool(readBookmarks(directory, "a")));
  EXPECT_FALSE(bool(writeBookmarks(directory, "a", {})));
  EXPECT_EQ(base::readFile(directory + "/bookmarks.json")->size(), 22U);
}

TEST_F(UserFiles, linksThatCannotBeReadArePassedOver) {
  write("bookmarks.json", R"({"version":1,"scenes":{"a":{"1":"nonsense","2":7,"3":"v=1&p=1,2,3&a=0,0&r=1","x":1}}})");
  const auto bookmarks = readBookmarks(directory, "a");
  ASSERT_TRUE(bool(bookmarks));
  EXPECT_TRUE((*bookmarks)[1].empty() && (*bookmarks)[2].empty());
  EXPECT_FALSE((*bookmarks)[3].empty());
}

}  // namespace
}  // namespace client
