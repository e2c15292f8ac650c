#include "repository/objects/objects.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>

#include "repository/objects/open_objects.h"
#include "tests/support/temporary_directory.h"

namespace {

using base::Bytes;
using base::ErrorCode;

TEST(Objects, namesStayWithinTheirPlace) {
  for (const char* good : {"a", "images/index.lgi", "a.b/c-d", "..a"})
    EXPECT_TRUE(repository::isObjectName(good)) << good;
  for (const char* bad : {"", "/a", "a/", "a//b", ".", "..", "../a", "a/../b", "a\\b", "a\nb"})
    EXPECT_FALSE(repository::isObjectName(bad)) << bad;
}

TEST(Objects, aDirectoryReturnsTheObjectsPutThere) {
  const support::TemporaryDirectory directory;
  auto sink = repository::openDirectorySink(directory.path() + "/out");
  ASSERT_TRUE(sink);
  ASSERT_TRUE((*sink)->put("scene.json", Bytes{1, 2, 3}, "application/json"));
  ASSERT_TRUE((*sink)->put("images/one", Bytes{4, 5, 6, 7}, ""));
  ASSERT_TRUE((*sink)->putFile("images/two", directory.path() + "/out/images/one", ""));
  EXPECT_EQ(*(*sink)->list(""), (std::vector<std::string>{"images/one", "images/two", "scene.json"}));
  EXPECT_EQ(*(*sink)->list("images"), (std::vector<std::string>{"images/one", "images/two"}));
  EXPECT_EQ(*(*sink)->list("nothing"), std::vector<std::string>());
  EXPECT_EQ(*(*sink)->size("images/one"), std::optional<std::uint64_t>(4));
  EXPECT_EQ(*(*sink)->size("images/three"), std::nullopt);
  EXPECT_FALSE((*sink)->put("../outside", Bytes{1}, ""));

  auto source = repository::openDirectorySource(directory.path() + "/out");
  ASSERT_TRUE(source);
  EXPECT_EQ(*(*source)->read("images/two", 1, 2), (Bytes{5, 6}));
  EXPECT_EQ(*(*source)->read("images/two", 4, 0), Bytes());
  EXPECT_EQ(*(*source)->size("images/two"), 4U);
  const auto beyond = (*source)->read("images/two", 3, std::uint64_t{1} << 60);
  ASSERT_FALSE(beyond);
  EXPECT_EQ(beyond.error().code, ErrorCode::kInvalidInput);
  EXPECT_NE(beyond.error().message.find("images/two: has 4 bytes"), std::string::npos) << beyond.error().message;
  EXPECT_EQ((*source)->read("images/three", 0, 1).error().code, ErrorCode::kNotFound);
  EXPECT_FALSE((*source)->read("../out/scene.json", 0, 1));

  ASSERT_TRUE((*sink)->remove("images/one"));
  EXPECT_EQ((*source)->size("images/one").error().code, ErrorCode::kNotFound);
  EXPECT_EQ(repository::openDirectorySource(directory.path() + "/none").error().code, ErrorCode::kNotFound);
}

// The directory also holds a dangling link and a folder that another user owns, such as lost+found.
TEST(Objects, foreignFilesAreIgnored) {
  const support::TemporaryDirectory directory;
  auto sink = repository::openDirectorySink(directory.path());
  ASSERT_TRUE(sink);
  std::filesystem::create_symlink("/nowhere/at/all", directory / "broken");
  std::filesystem::create_directory(directory / "theirs");
  ASSERT_TRUE((*sink)->put("scene.json", Bytes{1}, ""));
  ASSERT_EQ(::chmod((directory / "theirs").c_str(), 0), 0);
  ASSERT_EQ(::chmod(directory.path().c_str(), 0755), 0);

  const uid_t before = ::geteuid();
  if (before == 0) {  // root may read everything
    ASSERT_EQ(::seteuid(65534), 0);
  }
  const auto names = (*sink)->list("");
  ASSERT_EQ(::seteuid(before), 0);
  ASSERT_TRUE(names) << names.error().message;
  EXPECT_EQ(*names, std::vector<std::string>{"scene.json"});
}

TEST(Objects, aSecondSinkOfADirectoryIsBusy) {
  const support::TemporaryDirectory directory;
  auto sink = repository::openObjectSink("file://" + directory.path());
  ASSERT_TRUE(sink);
  EXPECT_EQ(repository::openObjectSink(directory.path()).error().code, ErrorCode::kBusy);
  sink->reset();
  EXPECT_TRUE(repository::openObjectSink(directory.path()));
}

TEST(Objects, unwritablePlacesAreNamed) {
  for (const char* place : {"http://host/scene", "https://host/scene", "gopher://host/scene"}) {
    const auto refused = repository::openObjectSink(place);
    ASSERT_FALSE(refused) << place;
    EXPECT_EQ(refused.error().code, place[0] == 'g' ? ErrorCode::kInvalidInput : ErrorCode::kUnsupported);
    EXPECT_EQ(refused.error().message.find(place), 0U) << refused.error().message;
  }
}

}  // namespace
