#pragma once
// A viewer of tests that looks at the middle of a served scene (served_scene.h) until the view is complete.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <string>
#include <variant>

#include "tests/server/net/loopback.h"
#include "tests/server/net/served_scene.h"

namespace server {

/// Null, and a failure of the test, where no Welcome comes.
inline std::unique_ptr<LoopbackClient> viewerAt(std::uint16_t port, const std::string& path, protocol::Welcome& welcome,
                                                const std::string& name = "test") {
  auto client = LoopbackClient::connect(port, path);
  EXPECT_TRUE(client) << "no WebSocket at " << path;
  if (!client || !client->send(protocol::Hello{protocol::kVersion, name})) return nullptr;
  const auto message = client->receive();
  EXPECT_TRUE(message && std::holds_alternative<protocol::Welcome>(*message));
  if (!message || !std::holds_alternative<protocol::Welcome>(*message)) return nullptr;
  welcome = std::get<protocol::Welcome>(*message);
  return client;
}

/// Whether all came that the view needs. `largest_face`: where to put the bytes of the largest image that came.
inline bool completes(LoopbackClient& client, const protocol::Welcome& welcome, std::uint32_t sequence,
                      std::size_t* largest_face = nullptr) {
  if (!client.send(viewOf(welcome, sequence))) return false;
  while (const auto message = client.receive()) {
    const auto* face = std::get_if<protocol::Face>(&*message);
    if (face != nullptr && largest_face != nullptr) *largest_face = std::max(*largest_face, face->value.size());
    const auto* completion = std::get_if<protocol::Completion>(&*message);
    if (completion != nullptr && completion->sequence == sequence) return true;
  }
  return false;
}

/// Looks once as a viewer of its own, and leaves.
inline void expectAView(std::uint16_t port, const std::string& path = "/", const std::string& name = "test") {
  protocol::Welcome welcome;
  const auto client = viewerAt(port, path, welcome, name);
  ASSERT_TRUE(client);
  EXPECT_TRUE(completes(*client, welcome, 1));
  client->close();
}

}  // namespace server
