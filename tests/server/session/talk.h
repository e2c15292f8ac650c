#pragma once
// The client's side of a session without a socket.
#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <vector>

#include "lod/patch/format.h"
#include "protocol/message.h"
#include "server/session/session.h"
#include "tests/server/session/memory_store.h"

namespace server {

using protocol::ServerMessage;

/// Plays the client's side of a session.
struct Talk {
  explicit Talk(const SceneData& scene) : session(scene) {}

  base::Result<void> say(const protocol::ClientMessage& message) { return session.receive(protocol::encode(message)); }
  void greet() {
    ASSERT_TRUE(say(protocol::Hello{protocol::kVersion, "test 1"}));
    auto message = next();
    ASSERT_TRUE(message && std::holds_alternative<protocol::Welcome>(*message));
  }
  std::optional<ServerMessage> next() {
    auto bytes = session.nextMessage();
    if (!bytes) return std::nullopt;
    auto decoded = protocol::decodeServerMessage(*bytes);
    EXPECT_TRUE(decoded) << decoded.error().message;
    return *decoded;
  }
  /// All messages until the session has nothing to say, at most `limit`.
  std::vector<ServerMessage> drain(std::size_t limit = 10'000) {
    std::vector<ServerMessage> all;
    while (all.size() < limit) {
      auto message = next();
      if (!message) break;
      all.push_back(std::move(*message));
    }
    return all;
  }

  Session session;
};

inline std::uint32_t groupOf(const SceneData& scene, const protocol::Refinement& refine) {
  lod::patch::Hierarchy growing;
  base::ByteReader in(refine.record);
  auto group = lod::patch::addGroup(in, growing, scene.welcome.group_count, scene.welcome.patch_count);
  EXPECT_TRUE(group) << group.error().message;
  return *group;
}

inline std::vector<std::uint32_t> groupsIn(const SceneData& scene, const std::vector<ServerMessage>& messages) {
  std::vector<std::uint32_t> groups;
  for (const auto& message : messages)
    if (const auto* refine = std::get_if<protocol::Refinement>(&message)) groups.push_back(groupOf(scene, *refine));
  return groups;
}

inline std::vector<repository::FaceKey> facesIn(const std::vector<ServerMessage>& messages) {
  std::vector<repository::FaceKey> faces;
  for (const auto& message : messages)
    if (const auto* face = std::get_if<protocol::Face>(&message)) faces.push_back(face->key);
  return faces;
}

/// Returns the index of Completion(sequence), or the number of messages.
inline std::size_t completeAt(const std::vector<ServerMessage>& messages, std::uint32_t sequence) {
  for (std::size_t i = 0; i < messages.size(); ++i)
    if (const auto* complete = std::get_if<protocol::Completion>(&messages[i]);
        complete && complete->sequence == sequence)
      return i;
  return messages.size();
}

inline std::vector<ServerMessage> before(const std::vector<ServerMessage>& messages, std::size_t end) {
  return {messages.begin(), messages.begin() + static_cast<std::ptrdiff_t>(end)};
}

template <class T>
bool unique(std::vector<T> keys) {
  std::sort(keys.begin(), keys.end());
  return std::adjacent_find(keys.begin(), keys.end()) == keys.end();
}

const glm::dvec3 kAbove(0.1, 0.05, 0.7);

}  // namespace server
