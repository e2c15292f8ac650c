#pragma once
// The messages between server and client, one struct each, and their encoding as bytes. How the bytes travel (one
// message per binary WebSocket frame) is not known here. docs/formats/protocol.md is the contract.
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "base/bytes.h"
#include "base/camera.h"
#include "base/error.h"
#include "base/error_measure.h"
#include "base/image.h"
#include "base/view_defaults.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/key.h"

namespace protocol {

inline constexpr std::uint16_t kVersion = 6;
/// Limits on what is accepted; a longer message is an error and ends the connection.
inline constexpr std::size_t kMaxClientMessage = 64 * 1024;
inline constexpr std::size_t kMaxServerMessage = 16 * 1024 * 1024;
/// Bytes of a face's value or a group's block that surely fit into one server message: 256 are left for its other
/// fields. Larger ones are never sent.
inline constexpr std::size_t kMaxPayload = kMaxServerMessage - 256;
inline constexpr std::size_t kMaxKeysPerMessage = 4096;  ///< keys of each kind
inline constexpr std::size_t kMaxText = 512;             ///< bytes of a name or reason; encode() cuts longer ones
inline constexpr std::size_t kMaxUnits = 32;             ///< bytes of the name of a unit of length
inline constexpr int kMaxViewport = 16384;               ///< pixels a side; also of a face
using base::kMaxCoordinate;
using base::kMinFov;
inline constexpr float kMaxTolerance = 1e6F;           ///< pixels
inline constexpr std::uint32_t kMaxGroups = 1U << 27;  ///< a hierarchy of 10^11 triangles has fewer
inline constexpr std::uint32_t kMaxPatches = 1U << 29;

/// Codecs of exact frames. JPEG every client decodes, since stored faces are JPEG.
enum class FrameCodec : std::uint8_t { kJpeg, kWebp };
/// Hello::abilities: the client decodes WebP frames, takes a hull in Welcome, and a frame's coding error.
inline constexpr std::uint8_t kDecodesWebp = 1, kTakesHull = 2, kTakesCodingError = 4;
inline constexpr std::size_t kMaxHull = 32;  ///< points
/// View::frame_quality: the server chooses.
inline constexpr std::uint8_t kServersChoice = 0;

// ---- client to server ----

/// The first message. The server answers with Welcome, or with Refusal when the versions differ.
struct Hello {
  std::uint16_t version = kVersion;
  std::string client;                                                      ///< name and version, for the server's log
  std::uint8_t abilities = kDecodesWebp | kTakesHull | kTakesCodingError;  ///< flags; others mean nothing
  std::uint32_t frame_pixels = 0;  ///< it has room for several frames of so many pixels, where views have fewer
};

/// "I look at this." The server drops its work for older views.
struct View {
  std::uint32_t sequence = 0;  ///< counts up from 1
  base::ViewCamera camera;     ///< world coordinates
  float patch_tolerance_px =
      base::ViewDefaults::kPatchTolerance;  ///< refine patches until their projected error is at most this
  std::uint32_t max_triangles = base::ViewDefaults::kMaxTriangles;  ///< … or the cut reaches this
  std::uint16_t max_points = base::ViewDefaults::kPoints;           ///< sampling points wanted; 0: no images
  bool want_frame = false;                                          ///< render exact frames of it
  std::uint8_t frame_quality = kServersChoice;  ///< of its last frame in its codec, 1..100; others may have less
  base::ErrorMeasure measure = base::ErrorMeasure::kVisible;  ///< of the tolerance
};

/// "I no longer have these."
struct Eviction {
  std::vector<repository::FaceKey> faces;
  std::vector<std::uint32_t> groups;
};

/// "I already have these." A client sends it after Hello when it reconnects, so that the server need not send them
/// again. The layout is that of Eviction.
struct Holdings {
  std::vector<repository::FaceKey> faces;
  std::vector<std::uint32_t> groups;
};

// ---- server to client ----

struct Welcome {
  std::uint16_t version = kVersion;
  std::string scene_name;
  std::string units;                       ///< name of the unit of length ("m"); empty when it is not known
  glm::dvec3 origin{0.0};                  ///< world position of scene-local (0, 0, 0)
  glm::vec3 box_min{0.0F}, box_max{0.0F};  ///< scene-local
  glm::vec3 up{0.0F, 0.0F, 1.0F};
  glm::vec3 start_direction{0.0F};  ///< unit: where the first view looks; zero: the client chooses
  std::string start_view;           ///< permalink of the first view (docs/formats/permalink.md); empty: none
  bool unlit = false;
  bool shadows = false;  ///< images and frames show shadows, which patches by themselves lack
  glm::vec3 light_direction{0.0F, 0.0F, 1.0F};
  bool has_colors = false;
  glm::dvec3 lattice_origin{0.0};
  double lattice_step = 1.0;
  std::uint32_t group_count = 0, patch_count = 0;  ///< counts of the whole hierarchy: the limits for Refinement
  std::uint64_t source_triangles = 0;
  repository::Grid grid;  ///< count 0: no images
  bool can_render_frames = false;
  std::string attribution;              ///< whom viewers name as the scan's authors; empty: nobody
  std::optional<base::Rgb> background;  ///< of pictures, where there is no model; nothing: the client chooses
  glm::vec3 north{0.0F};                ///< unit, perpendicular to up; zero: not known
  /// Scene-local: at most kMaxHull points whose convex hull holds the model; empty: the box does. Only for clients that
  /// take it.
  std::vector<glm::vec3> hull;
};

/// A face as the repository stores it (repository/faces/face_value.h), empty flags included.
struct Face {
  repository::FaceKey key;
  base::Bytes value;
};

/// Everything a client needs to expand one group: the records of the group and of the patches that it consumes
/// (encodeGroup in lod/patch/format.h), and their geometry.
struct Refinement {
  base::Bytes record;
  base::Bytes block;
};

/// The picture of a Frame, encoded.
struct EncodedFrame {
  base::Bytes value;  ///< like a Face's value; its picture may be WebP with alpha
  /// Root mean square of what coding changed of the model's colours, 0..1; 0: not known, or nothing.
  float coding_error = 0.0F;
};

/// An exact picture, for a client that asked for frames, in a codec of its Hello.
struct Frame {
  std::uint32_t sequence = 0;  ///< sequence of the newest View when it was requested
  base::ViewCamera camera;     ///< it was drawn for, which may be ahead of the View's
  bool last = false;           ///< no other frame of this View follows
  base::Bytes value;           ///< as EncodedFrame has it
  float coding_error = 0.0F;   ///< the same, 0..1; 0: not told. Only for clients that take it
};

/// The server has sent everything it has for the view of this sequence.
struct Completion {
  std::uint32_t sequence = 0;
};

/// The file of a scene without patches, which clients read over HTTP.
enum class Streamed : std::uint8_t {
  kNothing,
  kSplats,     ///< /qsplat.lgq
  kUmbrellas,  ///< /pmr.lgm
  kHlod,       ///< /hlod.lgh
};
/// The method that draws it, and what that shows: "qsplat" and "splats"; empty for kNothing.
const char* methodOf(Streamed streamed);
const char* contentOf(Streamed streamed);
/// The file that the method draws; kNothing for methods that draw none of them.
Streamed streamedOf(std::string_view method);

/// Says in plain words why the connection is about to end.
struct Refusal {
  std::uint16_t version = kVersion;  ///< the server's
  std::string reason;
  Streamed instead = Streamed::kNothing;  ///< what the scene has, where it has no patches
};

/// Several larger messages can be under way at once, one a stream.
enum class Stream : std::uint8_t { kData, kFrames };
inline constexpr std::size_t kStreams = 2;

/// A part of a message that would occupy a slow link for long; other messages may come between parts. A first part
/// gives up what its stream has begun.
struct Part {
  Stream stream = Stream::kData;
  bool first = false, last = false;
  base::Bytes bytes;  ///< of the encoded message, which is no Part itself
};

/// Their order gives the type bytes.
using ClientMessage = std::variant<Hello, View, Eviction, Holdings>;
using ServerMessage = std::variant<Welcome, Face, Refinement, Frame, Completion, Refusal, Part>;

/// Control characters in texts become blanks. The caller splits lists of more than kMaxKeysPerMessage keys.
base::Bytes encode(const ClientMessage& message);
base::Bytes encode(const ServerMessage& message);
/// The same bytes; a program that encodes no other message of a server carries only what this one takes.
base::Bytes encode(const Welcome& welcome);
/// Checks every length and value of hostile input (NaN, zero directions, field of view, viewport up to 16384, keys in
/// range). Directions and up vectors come out with unit length. A Hello of another version decodes to its version only,
/// so that it can be refused; a Welcome of another version is an error of code kVersion.
base::Result<ClientMessage> decodeClientMessage(base::ByteView bytes);
base::Result<ServerMessage> decodeServerMessage(base::ByteView bytes);

}  // namespace protocol
