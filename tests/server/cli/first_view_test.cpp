#include "server/cli/first_view.h"

#include <gtest/gtest.h>

#include <fstream>
#include <random>

#include "client/app/permalink.h"
#include "tests/support/temporary_directory.h"

namespace server::cli {
namespace {

const std::string kLink =
    "v=1&p=500004.5,4000007,103.25&a=-120.5,-20&r=12.5&f=60&m=hlod&o=sco&x=z,102.5,b&l=135.5,-20&s=soft";

// `lumigrid set` has no viewer in it, and so a check of its own; it must agree with the viewer's reader.
TEST(FirstView, aLinkIsAcceptedExactlyWhenViewersAcceptIt) {
  EXPECT_TRUE(isPermalink(kLink));
  for (const std::string text : {"",
                                 "v=1",
                                 "v=1&",
                                 "v=1&x=z,2.5,b",
                                 "v=1&x=z,2.5",
                                 "v=1&p=1,2,3&x=z,2.5,b",
                                 "v=1&a=4,5&r=6&x=z,2.5,b",
                                 "v=2&p=1,2,3&a=4,5&r=6",
                                 "v=1&p=1,2,3&a=4,5&r=6",
                                 "v=1&p=1,2,3&a=4,5&r=6&",
                                 "p=1,2,3&a=4,5&r=6",
                                 "v=1&a=4,5&r=6&p=1,2,3",
                                 "v=1&p=1,2&a=4,5&r=6",
                                 "v=1&p=1,2,3,4&a=4,5&r=6",
                                 "v=1&p=1,2,1e13&a=4,5&r=6",
                                 "v=1&p=1,2,nan&a=4,5&r=6",
                                 "v=1&p=1,2,3&a=361,5&r=6",
                                 "v=1&p=1,2,3&a=4,91&r=6",
                                 "v=1&p=1,2,3&a=4,5&r=0",
                                 "v=1&p=1,2,3&a=4,5&r=-1",
                                 "v=1&p=1,2,3&a=4,5",
                                 "v=1&p=1,2,3&a=4,5&r=6&r=6",
                                 "v=1&p=1,2,3&a=4,5&r=6&q=1",
                                 "v=1&p=1,2,3&a=4,5&r=6&f=171",
                                 "v=1&p=1,2,3&a=4,5&r=6&f=0.1",
                                 "v=1&p=1,2,3&a=4,5&r=6&m=full",
                                 "v=1&p=1,2,3&a=4,5&r=6&m=hlod",
                                 "v=1&p=1,2,3&a=4,5&r=6&o=ss",
                                 "v=1&p=1,2,3&a=4,5&r=6&o=",
                                 "v=1&p=1,2,3&a=4,5&r=6&o=t",
                                 "v=1&p=1,2,3&a=4,5&r=6&x=w,1,a",
                                 "v=1&p=1,2,3&a=4,5&r=6&x=x,1,c",
                                 "v=1&p=1,2,3&a=4,5&r=6&x=x,1",
                                 "v=1&p=1,2,3&a=4,5&r=6&x=x,,a",
                                 "v=1&p=1,2,3&a=4,5&r=6&l=135,20",
                                 "v=1&p=1,2,3&a=4,5&r=6&l=181,20",
                                 "v=1&p=1,2,3&a=4,5&r=6&l=135,91",
                                 "v=1&p=1,2,3&a=4,5&r=6&l=135",
                                 "v=1&p=1,2,3&a=4,5&r=6&m=hlod&s=hard",
                                 "v=1&p=1,2,3&a=4,5&r=6&s=mild",
                                 "v=1&p=1,2,3&a=4,5&r=6&&f=60",
                                 "v=1&p= 1,2,3&a=4,5&r=6",
                                 "v=1&p=1,2,3&a=4,5&r=00000000000000000000000000000000000000006"})
    EXPECT_EQ(isPermalink(text), bool(client::parsePermalink(text))) << text;
  const std::string long_link = kLink + std::string(600, '0');
  EXPECT_EQ(isPermalink(long_link), bool(client::parsePermalink(long_link)));
}

TEST(FirstView, linksThatWereHarmedAreJudgedAlike) {
  std::mt19937 random(5);
  const std::string letters = "v=1&pafrmoxls,.-+eE09bcsz ";
  int refused = 0;
  for (int round = 0; round < 4000; ++round) {
    std::string text = kLink;
    for (int i = std::uniform_int_distribution<int>(1, 3)(random); i > 0; --i) {
      const auto at = std::uniform_int_distribution<std::size_t>(0, text.size() - 1)(random);
      const char letter = letters[std::uniform_int_distribution<std::size_t>(0, letters.size() - 1)(random)];
      if (round % 3 == 0) text.erase(at, 1);
      if (round % 3 == 1) text[at] = letter;
      if (round % 3 == 2) text.insert(at, 1, letter);
    }
    const bool is_link = isPermalink(text);
    refused += is_link ? 0 : 1;
    ASSERT_EQ(is_link, bool(client::parsePermalink(text))) << text;
  }
  EXPECT_GT(refused, 400);
  EXPECT_LT(refused, 3600);
}

// An interior is cut open at its height, in the world; a view that somebody chose stays.
TEST(FirstView, aCutIsStoredUntilAViewIsChosen) {
  base::Scene scene;
  scene.origin = {500000.0, 4000000.0, 100.0};
  scene.box_min = scene.origin;
  scene.box_max = scene.origin + glm::dvec3(20.0, 10.0, 3.0);
  scene.up = {0.0, 0.0, 1.0};
  lod::patch::Orientation found;
  found.section_height = 2.51239F;
  setFirstView(found, nullptr, scene);
  EXPECT_EQ(scene.start_view, "v=1&x=z,102.512,b");
  EXPECT_TRUE(isPermalink(scene.start_view));
  scene.up = {-1.0, 0.0, 0.0};
  setFirstView(found, nullptr, scene);
  EXPECT_EQ(scene.start_view, "v=1&x=x,499997.49,a");
  found.section_height.reset();
  setFirstView(found, nullptr, scene);
  EXPECT_EQ(scene.start_view, "");
  scene.start_view = kLink;
  found.section_height = 1.0F;
  setFirstView(found, nullptr, scene);
  EXPECT_EQ(scene.start_view, kLink);
}

TEST(FirstView, theLinkIsFoundInAnAddressAndInAFile) {
  EXPECT_EQ(*permalinkIn(kLink), kLink);
  EXPECT_EQ(*permalinkIn("https://example.org/scans/#" + kLink), kLink);
  const support::TemporaryDirectory directory;
  const std::string file = directory / "view.txt";
  std::ofstream(file) << "https://example.org/scans/#" << kLink << " \r\n";
  EXPECT_EQ(*permalinkIn(file), kLink);
  std::ofstream(file) << "nothing\n";
  for (const std::string& bad : {file, std::string("from above"), std::string()}) {
    const auto found = permalinkIn(bad);
    ASSERT_FALSE(found) << bad;
    EXPECT_EQ(found.error().code, base::ErrorCode::kInvalidInput);
  }
}

}  // namespace
}  // namespace server::cli
