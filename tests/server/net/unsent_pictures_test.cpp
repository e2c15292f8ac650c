#include "server/net/unsent_pictures.h"

#include <gtest/gtest.h>

#include <memory>

namespace server {
namespace {

using Held = std::unique_ptr<UnsentPicture>;

TEST(UnsentPictures, anAddressIsCountedUntilItsPicturesAreTaken) {
  UnsentPictures all;
  EXPECT_EQ(all.countOf("a"), 0U);
  Held first = std::make_unique<UnsentPicture>(all, "a", 100);
  Held second = std::make_unique<UnsentPicture>(all, "a", 200);
  EXPECT_EQ(all.countOf("a"), 2U);
  EXPECT_EQ(all.countOf("b"), 0U);
  first.reset();
  EXPECT_EQ(all.countOf("a"), 1U);
  second.reset();
  EXPECT_EQ(all.countOf("a"), 0U);
}

TEST(UnsentPictures, largeOnesOfOneAddressLeaveRoomForOthers) {
  UnsentPictures all;
  const UnsentPicture first(all, "a", UnsentPictures::kRoom), second(all, "a", UnsentPictures::kRoom);
  EXPECT_TRUE(all.hasRoom());
  Held others[3];
  for (int i = 0; i < 3; ++i) {
    EXPECT_TRUE(all.hasRoom());
    others[i] = std::make_unique<UnsentPicture>(all, std::string(1, static_cast<char>('b' + i)), UnsentPictures::kRoom);
  }
  EXPECT_FALSE(all.hasRoom());
  others[0].reset();
  EXPECT_TRUE(all.hasRoom());
}

}  // namespace
}  // namespace server
