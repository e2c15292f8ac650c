#include "server/session/held_faces.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

namespace server {
namespace {

repository::FaceKey keyOf(std::uint32_t n) {
  return {n % 64, n / 64 % 64, n / 4096 % 64, 0};
}

std::uint32_t countOf(const HeldFaces& held, std::uint32_t first, std::uint32_t end) {
  std::uint32_t count = 0;
  for (std::uint32_t n = first; n < end; ++n) count += held.contains(keyOf(n)) ? 1 : 0;
  return count;
}

TEST(HeldFaces, allViewersTogetherHaveALimit) {
  const auto memory = std::make_shared<HeldMemory>(3'000 * HeldMemory::kFaceBytes);
  std::vector<std::unique_ptr<HeldFaces>> viewers;
  for (int i = 0; i < 10; ++i) {
    viewers.push_back(std::make_unique<HeldFaces>(memory));
    for (std::uint32_t n = 0; n < 5'000; ++n) viewers.back()->claim(keyOf(n));
  }
  EXPECT_EQ(viewers.front()->size(), 3'000U) << "the first found room";
  EXPECT_EQ(countOf(*viewers.front(), 0, 3'000), 3'000U) << "those that were named first are remembered";
  for (int i = 1; i < 10; ++i) EXPECT_EQ(viewers[static_cast<std::size_t>(i)]->size(), kMinFacesHeld);
  EXPECT_EQ(memory->bytes(), (3'000 + 9 * kMinFacesHeld) * HeldMemory::kFaceBytes);
  EXPECT_EQ(memory->forgotten(), 2'000 + 9 * (5'000 - kMinFacesHeld));
  viewers.clear();
  EXPECT_EQ(memory->bytes(), 0U);
}

TEST(HeldFaces, whatIsSentTakesThePlaceOfAnotherWhereThereIsNoRoom) {
  const auto memory = std::make_shared<HeldMemory>(0);
  HeldFaces held(memory);
  for (std::uint32_t n = 0; n < 2 * kMinFacesHeld; ++n) {
    held.add(keyOf(n));
    EXPECT_TRUE(held.contains(keyOf(n)));
  }
  EXPECT_EQ(held.size(), kMinFacesHeld);
  EXPECT_EQ(memory->forgotten(), kMinFacesHeld);
  held.add(keyOf(2 * kMinFacesHeld - 1));
  EXPECT_EQ(memory->forgotten(), kMinFacesHeld) << "it was there";
  held.erase(keyOf(2 * kMinFacesHeld - 1));
  held.claim(keyOf(5'000));
  EXPECT_TRUE(held.contains(keyOf(5'000)));
  EXPECT_EQ(memory->bytes(), kMinFacesHeld * HeldMemory::kFaceBytes);
}

TEST(HeldFaces, aViewerWhoEvictsNothingHasALimit) {
  HeldFaces held(nullptr);
  for (std::uint32_t n = 0; n < kMaxFacesHeld + 1'000; ++n) held.add(keyOf(n));
  EXPECT_EQ(held.size(), kMaxFacesHeld);
}

}  // namespace
}  // namespace server
