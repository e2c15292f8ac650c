#pragma once
// Makes a server's messages about a small scene without a socket: the synthetic hierarchy with its blocks, and a grid
// of 4 × 4 × 3 sampling points.
#include <string>
#include <variant>
#include <vector>

#include "client/source/session.h"
#include "lod/patch/format.h"
#include "protocol/message.h"
#include "tests/support/synthetic_hierarchy.h"

namespace client {

class ScriptedServer {
 public:
  /// The scene has `n` × `n` leaf patches (support::syntheticHierarchy).
  explicit ScriptedServer(int n = 8) : scene_(support::syntheticHierarchy(n)) {
    lod::patch::Hierarchy& h = scene_.hierarchy;
    blocks_.resize(h.groups.size());
    for (std::uint32_t g = 0; g < h.groups.size(); ++g) {
      const auto patches = support::encodedBlock(scene_, g);
      for (std::uint32_t i = 0; i < h.groups[g].patch_count; ++i) {
        const base::Bytes& bytes = (*patches)[i];
        h.patches[h.groups[g].first_patch + i].block_offset = static_cast<std::uint32_t>(blocks_[g].size());
        h.patches[h.groups[g].first_patch + i].block_bytes = static_cast<std::uint32_t>(bytes.size());
        blocks_[g].insert(blocks_[g].end(), bytes.begin(), bytes.end());
      }
      h.groups[g].block_bytes = static_cast<std::uint32_t>(blocks_[g].size());
    }

    welcome.scene_name = "synthetic";
    welcome.origin = {500'000.0, 4'000'000.0, 100.0};
    base::Aabb box;
    for (const auto& patch : h.patches) box.add(patch.box);
    welcome.box_min = box.min;
    welcome.box_max = box.max;
    welcome.lattice_origin = h.lattice.origin;
    welcome.lattice_step = h.lattice.step;
    welcome.group_count = static_cast<std::uint32_t>(h.groups.size());
    welcome.patch_count = static_cast<std::uint32_t>(h.patches.size());
    welcome.source_triangles = h.source_triangles;
    welcome.grid.first = box.min - glm::vec3(8.0F);
    welcome.grid.spacing = 16.0F;
    welcome.grid.count = {4, 4, 3};
    welcome.grid.face_size = 64;
  }

  protocol::Welcome welcome;
  const lod::patch::Hierarchy& hierarchy() const { return scene_.hierarchy; }

  base::Bytes sayWelcome() const { return protocol::encode(protocol::ServerMessage(welcome)); }
  base::Bytes sayFace(const repository::FaceKey& key, std::size_t bytes) const {
    return protocol::encode(protocol::ServerMessage(protocol::Face{key, base::Bytes(bytes, 0x5A)}));
  }
  protocol::Refinement refine(std::uint32_t group) const {
    base::ByteWriter record;
    lod::patch::encodeGroup(scene_.hierarchy, group, record);
    return {record.takeBytes(), blocks_[group]};
  }
  base::Bytes sayGroup(std::uint32_t group) const { return protocol::encode(protocol::ServerMessage(refine(group))); }
  base::Bytes sayComplete(std::uint32_t sequence) const {
    return protocol::encode(protocol::ServerMessage(protocol::Completion{sequence}));
  }
  base::Bytes sayRefusal(std::uint16_t version, const std::string& reason) const {
    return protocol::encode(protocol::ServerMessage(protocol::Refusal{version, reason}));
  }
  base::Bytes sayFrame(std::uint32_t sequence, std::size_t bytes, bool last = true) const {
    return protocol::encode(
        protocol::ServerMessage(protocol::Frame{sequence, lookDown(20.0), last, base::Bytes(bytes, 0x5A)}));
  }

  /// Returns a view down on the middle of the scene from `height` scene units above it.
  base::ViewCamera lookDown(double height) const {
    base::ViewCamera camera;
    camera.position =
        welcome.origin + glm::dvec3(0.5F * (welcome.box_min + welcome.box_max)) + glm::dvec3(0.0, 0.0, height);
    camera.direction = {0.0, 0.0, -1.0};
    camera.up = {0.0, 1.0, 0.0};
    camera.width = 64;
    camera.height = 48;
    return camera;
  }

 private:
  support::SyntheticHierarchy scene_;
  std::vector<base::Bytes> blocks_;
};

/// Returns all messages that the session wants to send now, decoded.
inline std::vector<protocol::ClientMessage> sent(Session& session) {
  std::vector<protocol::ClientMessage> messages;
  while (auto bytes = session.nextToSend()) {
    auto message = protocol::decodeClientMessage(*bytes);
    LUMIGRID_CHECK(bool(message));
    messages.push_back(std::move(*message));
  }
  return messages;
}

template <class Message>
std::vector<Message> only(const std::vector<protocol::ClientMessage>& messages) {
  std::vector<Message> found;
  for (const auto& message : messages)
    if (const auto* one = std::get_if<Message>(&message)) found.push_back(*one);
  return found;
}

}  // namespace client
