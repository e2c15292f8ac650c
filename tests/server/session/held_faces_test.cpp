#include "server/session/held_faces.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <set>
#include <vector>

#include "plan/view_plan.h"
#include "server/session/session.h"
#include "tests/server/session/memory_store.h"

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
  const auto memory = std::make_shared<HeldMemory>(6'000 * HeldMemory::kFaceBytes);
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

// Claims cost nothing, so that it must leave room for what is sent.
TEST(HeldFaces, claimsGetHalfOfTheRoom) {
  const auto memory = std::make_shared<HeldMemory>(6'000 * HeldMemory::kFaceBytes);
  HeldFaces greedy(memory), honest(memory);
  for (std::uint32_t n = 0; n < 20'000; ++n) greedy.claim(keyOf(n));
  EXPECT_EQ(greedy.size(), 3'000U);
  for (std::uint32_t n = 0; n < 2'500; ++n) honest.add(keyOf(n));
  EXPECT_EQ(countOf(honest, 0, 2'500), 2'500U);
}

// A view that is asked for again and again must not be sent again and again.
TEST(HeldFaces, whatIsForgottenIsMostlyWhatIsLeastNew) {
  HeldFaces held(std::make_shared<HeldMemory>(0));
  for (std::uint32_t n = 0; n < 2 * kMinFacesHeld; ++n) held.add(keyOf(n));
  constexpr std::uint32_t kOfView = 400, kFirst = 10'000;
  std::uint32_t sent = 0;
  for (int view = 0; view < 3; ++view)
    for (std::uint32_t n = kFirst; n < kFirst + kOfView; ++n)
      if (!held.contains(keyOf(n))) ++sent, held.add(keyOf(n));
  EXPECT_LE(sent, kOfView + kOfView / 2);
  EXPECT_GE(countOf(held, kFirst, kFirst + kOfView), kOfView * 9 / 10);
}

TEST(HeldFaces, aViewerWhoEvictsNothingHasALimit) {
  HeldFaces held(nullptr);
  for (std::uint32_t n = 0; n < kMaxFacesHeld + 1'000; ++n) held.add(keyOf(n));
  EXPECT_EQ(held.size(), kMaxFacesHeld);
}

// Codes of the images that a session sends for a view.
std::set<std::uint64_t> facesSentFor(Session& session, const protocol::View& view) {
  EXPECT_TRUE(session.receive(protocol::encode(protocol::ClientMessage(view))));
  std::set<std::uint64_t> sent;
  while (const auto message = session.nextMessage()) {
    const auto decoded = protocol::decodeServerMessage(*message);
    const auto* face = decoded ? std::get_if<protocol::Face>(&*decoded) : nullptr;
    if (face != nullptr) sent.insert(face->key.code());
  }
  return sent;
}

// Two viewers come again and hold all that their view needs, besides much else that they name first. Where there is no
// room to remember that, it is sent again, and nothing is missing.
TEST(HeldFaces, thatAreNotRememberedAreSentAgain) {
  TestScene scene;
  const protocol::View view = scene.view(1, {0.0, 0.0, 0.4});
  const plan::ViewPlan plan = plan::planView(scene.data.toPlan(), view, plan::Holdings{});
  ASSERT_FALSE(plan.faces.empty());
  protocol::Holdings others;
  const glm::uvec3 count = scene.data.welcome.grid.count;
  for (std::uint32_t n = 0; others.faces.size() < kMinFacesHeld; ++n) {
    ASSERT_LT(n, count.x * count.y * count.z * 6);
    const repository::FaceKey key{n / 6 % count.x, n / 6 / count.x % count.y, n / 6 / count.x / count.y, n % 6};
    if (std::find(plan.faces.begin(), plan.faces.end(), key) == plan.faces.end()) others.faces.push_back(key);
  }
  for (const bool has_room : {true, false}) {
    scene.data.held = std::make_shared<HeldMemory>(has_room ? HeldMemory::kDefaultBytes : 0);
    Session session(scene.data);
    for (const protocol::ClientMessage& message :
         {protocol::ClientMessage(protocol::Hello{}), protocol::ClientMessage(others),
          protocol::ClientMessage(protocol::Holdings{plan.faces, {}})})
      EXPECT_TRUE(session.receive(protocol::encode(message)));
    const auto sent = facesSentFor(session, view);
    for (const repository::FaceKey& key : plan.faces) EXPECT_EQ(sent.count(key.code()), has_room ? 0U : 1U);
    EXPECT_EQ(scene.data.held->forgotten() > 0, !has_room);
  }
}

}  // namespace
}  // namespace server
