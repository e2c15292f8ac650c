#pragma once
// What server and client say to each other: one struct per message, bytes in and bytes out; how they travel (WebSocket
// binary frames, one message each) is not known here. docs/formats/protocol.md is the contract; DESIGN section 6.
#include <cstdint>
#include <glm/glm.hpp>
#include <string>
#include <variant>
#include <vector>

#include "base/bytes.h"
#include "base/camera.h"
#include "base/error.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/key.h"

namespace protocol {

inline constexpr std::uint16_t kVersion = 1;
/// Limits on what is accepted; a longer message is an error and ends the connection.
inline constexpr std::size_t kMaxClientMessage = 256 * 1024;
inline constexpr std::size_t kMaxServerMessage = 16 * 1024 * 1024;
/// Bytes of a face's value or a group's block that surely fit into one server message: 256 are left for its other
/// fields. Larger ones are never sent.
inline constexpr std::size_t kMaxPayload = kMaxServerMessage - 256;
inline constexpr std::size_t kMaxKeysPerMessage = 8192;  ///< of each kind
inline constexpr std::size_t kMaxText = 512;             ///< bytes of a name or reason; encode() cuts longer ones
inline constexpr std::size_t kMaxUnits = 32;             ///< bytes of the name of a unit of length
inline constexpr int kMaxViewport = 16384;               ///< pixels a side; also of a face
using base::kMaxCoordinate;
using base::kMinFov;
inline constexpr float kMaxTolerance = 1e6F;           ///< pixels
inline constexpr std::uint32_t kMaxGroups = 1U << 27;  ///< a hierarchy of 10^11 triangles stays below
inline constexpr std::uint32_t kMaxPatches = 1U << 29;

// ---- client to server ----

/// First message. The server answers Welcome, or Refusal when versions do not agree.
struct Hello {
  std::uint16_t version = kVersion;
  std::string client;  ///< name and version, for the server's log
};

/// "This is what I look at." The newest view wins; work for older ones is dropped.
struct View {
  std::uint32_t sequence = 0;             ///< counts up from 1
  base::ViewCamera camera;                ///< world coordinates
  float patch_tolerance_px = 4.0F;        ///< refine patches until their projected error is at most this
  std::uint32_t max_triangles = 300'000;  ///< … or the cut reaches this
  std::uint16_t max_points = 8;           ///< sampling points wanted, 0 = no images
  bool want_frame = false;                ///< render the exact view when nothing else is left to send
  std::uint8_t frame_quality = 85;        ///< JPEG quality of that frame
};

/// "I no longer have these."
struct Eviction {
  std::vector<repository::FaceKey> faces;
  std::vector<std::uint32_t> groups;
};

/// "I already have these", after Hello on a reconnect: the server need not send them again. Same shape as Eviction.
struct Holdings {
  std::vector<repository::FaceKey> faces;
  std::vector<std::uint32_t> groups;
};

// ---- server to client ----

struct Welcome {
  std::uint16_t version = kVersion;
  std::string scene_name;
  std::string units;                       ///< of length, as people write it ("m"); empty when not known
  glm::dvec3 origin{0.0};                  ///< world position of scene-local (0, 0, 0)
  glm::vec3 box_min{0.0F}, box_max{0.0F};  ///< scene-local
  glm::vec3 up{0.0F, 0.0F, 1.0F};
  bool unlit = false;
  glm::vec3 light_direction{0.0F, 0.0F, 1.0F};
  bool has_colors = false;
  glm::dvec3 lattice_origin{0.0};
  double lattice_step = 1.0;
  std::uint32_t group_count = 0, patch_count = 0;  ///< of the whole hierarchy: the limits for Refinement
  std::uint64_t source_triangles = 0;
  repository::Grid grid;  ///< count 0: no images
  bool can_render_frames = false;
};

/// A stored face, as in the repository (repository/face_value.h), empty flag included.
struct Face {
  repository::FaceKey key;
  base::Bytes value;
};

/// All that is needed to expand one group: its record, its consumed patches' records (lod/patch/format.h encodeGroup)
/// and geometry.
struct Refinement {
  base::Bytes record;
  base::Bytes block;
};

/// The exact picture of a view that the client asked for.
struct Frame {
  std::uint32_t sequence = 0;  ///< of the View
  base::ViewCamera camera;
  base::Bytes value;  ///< encoded like a Face's value
};

/// Everything the server has for this view was sent.
struct Completion {
  std::uint32_t sequence = 0;
};

/// Why the connection is about to end, in plain words.
struct Refusal {
  std::uint16_t version = kVersion;  ///< the server's
  std::string reason;
  bool splats_only = false;  ///< the scene has splats and nothing else: they are read over HTTP (/qsplat.lgq)
};

using ClientMessage = std::variant<Hello, View, Eviction, Holdings>;
using ServerMessage = std::variant<Welcome, Face, Refinement, Frame, Completion, Refusal>;

/// Control characters in texts become blanks. Key lists over kMaxKeysPerMessage are a caller's mistake: split them.
base::Bytes encode(const ClientMessage& message);
base::Bytes encode(const ServerMessage& message);
/// Hostile input: every length and value is checked (NaN, zero directions, field of view, viewport up to 16384, keys in
/// range). Directions and up vectors come out unit. A Hello of another version decodes to its version alone, so that it
/// can be refused; a Welcome of another version is an error of code kVersion.
base::Result<ClientMessage> decodeClientMessage(base::ByteView bytes);
base::Result<ServerMessage> decodeServerMessage(base::ByteView bytes);

}  // namespace protocol
