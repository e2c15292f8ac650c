#include "protocol/message.h"

#include <algorithm>
#include <cmath>
#include <string_view>
#include <utility>

#include "base/check.h"

// A message is one type byte, then its fields in the order of docs/formats/protocol.md, little-endian and unpadded. The
// last field of Face, Refinement and Frame runs to the end of the message. The transport frames messages, so it needs
// no length.
namespace protocol {
namespace {

enum class MessageType : std::uint8_t {
  kHello = 0x01,
  kView = 0x02,
  kEviction = 0x03,
  kHoldings = 0x04,
  kWelcome = 0x81,
  kFace = 0x82,
  kRefinement = 0x83,
  kFrame = 0x84,
  kCompletion = 0x85,
  kRefusal = 0x86,
};

constexpr double kPi = 3.14159265358979323846;
constexpr std::uint8_t kSplatsOnly = 1;  // the byte behind a Refusal's reason

base::Error bad(std::string_view message, std::string_view what) {
  return {base::ErrorCode::kInvalidInput, std::string(message) + " message: " + std::string(what)};
}

base::ByteWriter begin(MessageType type) {
  base::ByteWriter out;
  out.write(type);
  return out;
}

// ---- texts: logs and windows show them, so they never hold control characters ----

bool isControl(char c) {
  return static_cast<unsigned char>(c) < 0x20 || c == 0x7F;
}

void writeText(base::ByteWriter& out, std::string_view text, std::size_t limit) {
  std::string clean(text.substr(0, limit));
  std::replace_if(clean.begin(), clean.end(), isControl, ' ');
  out.string16(clean);
}

bool readText(base::ByteReader& in, std::size_t limit, std::string& text) {
  text = in.string16();
  return in.ok() && text.size() <= limit && std::none_of(text.begin(), text.end(), isControl);
}

// ---- small values ----

template <class Vector>
bool isFinite(const Vector& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

template <class Vector>
bool isBounded(const Vector& v) {
  using Scalar = typename Vector::value_type;
  const auto limit = static_cast<Scalar>(kMaxCoordinate);
  return isFinite(v) && std::abs(v.x) <= limit && std::abs(v.y) <= limit && std::abs(v.z) <= limit;
}

/// Normalizes a direction. One of unit length stays as it is, bit for bit. False for zero and NaN.
template <class Vector>
bool makeUnit(Vector& v) {
  if (!isBounded(v)) return false;
  const auto length = glm::length(v);
  if (!(length > 1e-9F)) return false;
  if (std::abs(length - 1) > 1e-6F) v /= length;
  return true;
}

/// Reads a flag; false when its byte is neither 0 nor 1.
bool readFlag(base::ByteReader& in, bool& flag) {
  const std::uint8_t byte = in.u8();
  flag = byte == 1;
  return in.ok() && byte <= 1;
}

// ---- cameras ----

void writeCamera(base::ByteWriter& out, const base::ViewCamera& camera) {
  out.write(camera.position);
  out.write(camera.direction);
  out.write(camera.up);
  out.f64(camera.fov_y);
  out.u16(static_cast<std::uint16_t>(camera.width));
  out.u16(static_cast<std::uint16_t>(camera.height));
}

/// Returns null when the camera is valid, and otherwise the fault.
const char* readCamera(base::ByteReader& in, base::ViewCamera& camera) {
  camera.position = in.read<glm::dvec3>();
  camera.direction = in.read<glm::dvec3>();
  camera.up = in.read<glm::dvec3>();
  camera.fov_y = in.f64();
  camera.width = in.u16();
  camera.height = in.u16();

  if (!in.ok()) return "is cut short in its camera";
  if (!isBounded(camera.position)) return "its position is not a number below 1e12";
  if (!makeUnit(camera.direction)) return "its direction is zero or not a number";
  if (!makeUnit(camera.up)) return "its up vector is zero or not a number";
  if (!(glm::length(glm::cross(camera.direction, camera.up)) > 1e-6))
    return "its up vector is parallel to its direction";
  if (!(camera.fov_y >= kMinFov && camera.fov_y <= kPi - kMinFov))
    return "its field of view is outside 0.001 to 3.1406 radians";
  if (camera.width < 1 || camera.width > kMaxViewport || camera.height < 1 || camera.height > kMaxViewport)
    return "its viewport is outside 1 to 16384 pixels a side";
  return nullptr;
}

// ---- lists of keys: Eviction and Holdings ----

template <class Keys>
base::Bytes encodeKeys(MessageType type, const Keys& keys) {
  LUMIGRID_CHECK_LE(keys.faces.size(), kMaxKeysPerMessage);
  LUMIGRID_CHECK_LE(keys.groups.size(), kMaxKeysPerMessage);
  base::ByteWriter out = begin(type);
  out.u32(static_cast<std::uint32_t>(keys.faces.size()));
  out.u32(static_cast<std::uint32_t>(keys.groups.size()));
  for (const repository::FaceKey& key : keys.faces) out.u64(key.code());
  for (std::uint32_t group : keys.groups) out.u32(group);
  return out.take();
}

template <class Keys>
base::Result<ClientMessage> decodeKeys(std::string_view name, base::ByteReader& in) {
  const std::uint32_t face_count = in.u32();
  const std::uint32_t group_count = in.u32();
  if (!in.ok()) return bad(name, "is cut short");
  if (face_count > kMaxKeysPerMessage || group_count > kMaxKeysPerMessage)
    return bad(name, "holds more than 8192 keys of a kind");
  if (in.remaining() != std::size_t{8} * face_count + std::size_t{4} * group_count)
    return bad(name, "its length does not fit its counts");

  Keys keys;
  keys.faces.reserve(face_count);
  for (std::uint32_t i = 0; i < face_count; ++i) {
    auto key = repository::FaceKey::fromCode(in.u64());
    if (!key) return bad(name, key.error().message);
    keys.faces.push_back(*key);
  }
  keys.groups.reserve(group_count);
  for (std::uint32_t i = 0; i < group_count; ++i) keys.groups.push_back(in.u32());
  return ClientMessage(std::move(keys));
}

// ---- client to server ----

base::Bytes encodeOne(const Hello& hello) {
  base::ByteWriter out = begin(MessageType::kHello);
  out.u16(hello.version);
  writeText(out, hello.client, kMaxText);
  return out.take();
}

/// Reads only the version of a Hello of another version: its other fields may have moved, and the server only refuses
/// it.
base::Result<ClientMessage> decodeHello(base::ByteReader& in) {
  Hello hello;
  hello.version = in.u16();
  if (!in.ok()) return bad("Hello", "is cut short");
  if (hello.version != kVersion) return ClientMessage(std::move(hello));
  if (!readText(in, kMaxText, hello.client))
    return bad("Hello", "its client name is cut short, too long or not plain text");
  if (!in.atEnd()) return bad("Hello", "has bytes after its end");
  return ClientMessage(std::move(hello));
}

base::Bytes encodeOne(const View& view) {
  base::ByteWriter out = begin(MessageType::kView);
  out.u32(view.sequence);
  writeCamera(out, view.camera);
  out.f32(view.patch_tolerance_px);
  out.u32(view.max_triangles);
  out.u16(view.max_points);
  out.u8(view.want_frame ? 1 : 0);
  out.u8(view.frame_quality);
  return out.take();
}

base::Result<ClientMessage> decodeView(base::ByteReader& in) {
  View view;
  view.sequence = in.u32();
  if (const char* problem = readCamera(in, view.camera)) return bad("View", problem);
  view.patch_tolerance_px = in.f32();
  view.max_triangles = in.u32();
  view.max_points = in.u16();
  const bool flag_is_valid = readFlag(in, view.want_frame);
  view.frame_quality = in.u8();

  if (!in.ok()) return bad("View", "is cut short");
  if (!in.atEnd()) return bad("View", "has bytes after its end");
  if (view.sequence == 0) return bad("View", "its sequence number is 0; they count from 1");
  if (!(view.patch_tolerance_px >= 0.0F && view.patch_tolerance_px <= kMaxTolerance))
    return bad("View", "its patch tolerance is outside 0 to 1e6 pixels");
  if (!flag_is_valid) return bad("View", "its frame flag is neither 0 nor 1");
  if (view.frame_quality < 1 || view.frame_quality > 100) return bad("View", "its frame quality is outside 1 to 100");
  return ClientMessage(view);
}

base::Bytes encodeOne(const Eviction& keys) {
  return encodeKeys(MessageType::kEviction, keys);
}
base::Bytes encodeOne(const Holdings& keys) {
  return encodeKeys(MessageType::kHoldings, keys);
}

// ---- server to client ----

base::Bytes encodeOne(const Welcome& welcome) {
  base::ByteWriter out = begin(MessageType::kWelcome);
  out.u16(welcome.version);
  writeText(out, welcome.scene_name, kMaxText);
  writeText(out, welcome.units, kMaxUnits);
  out.write(welcome.origin);
  out.write(welcome.box_min);
  out.write(welcome.box_max);
  out.write(welcome.up);
  out.u8(welcome.unlit ? 1 : 0);
  out.write(welcome.light_direction);
  out.u8(welcome.has_colors ? 1 : 0);
  out.write(welcome.lattice_origin);
  out.f64(welcome.lattice_step);
  out.u32(welcome.group_count);
  out.u32(welcome.patch_count);
  out.u64(welcome.source_triangles);
  out.u8(welcome.can_render_frames ? 1 : 0);
  const bool has_images = welcome.grid.pointCount() != 0;
  out.u8(has_images ? 1 : 0);
  if (has_images) welcome.grid.encode(out);
  return out.take();
}

/// Normalizes the directions. Returns null when the values are valid, and otherwise the fault.
const char* checkWelcome(Welcome& welcome) {
  if (!isBounded(welcome.origin)) return "its origin is not a number below 1e12";
  if (!isBounded(welcome.box_min) || !isBounded(welcome.box_max) ||
      glm::any(glm::greaterThan(welcome.box_min, welcome.box_max)))
    return "its box is inside out or not a number";
  if (!makeUnit(welcome.up)) return "its up vector is zero or not a number";
  if (!makeUnit(welcome.light_direction)) return "its light direction is zero or not a number";
  if (!isBounded(welcome.lattice_origin)) return "its lattice origin is not a number below 1e12";
  if (!(welcome.lattice_step > 0.0 && welcome.lattice_step <= kMaxCoordinate))
    return "its lattice step is not above zero";
  if (welcome.group_count > kMaxGroups || welcome.patch_count > kMaxPatches)
    return "its hierarchy is larger than this version allows";
  return nullptr;
}

base::Result<ServerMessage> decodeWelcome(base::ByteReader& in) {
  Welcome welcome;
  welcome.version = in.u16();
  if (in.ok() && welcome.version != kVersion)
    return base::Error{base::ErrorCode::kVersion, "the server speaks protocol " + std::to_string(welcome.version) +
                                                      ", this client speaks " + std::to_string(kVersion) +
                                                      "; update the older one"};
  if (!readText(in, kMaxText, welcome.scene_name))
    return bad("Welcome", "its scene name is cut short, too long or not plain text");
  if (!readText(in, kMaxUnits, welcome.units))
    return bad("Welcome", "its unit of length is cut short, too long or not plain text");
  welcome.origin = in.read<glm::dvec3>();
  welcome.box_min = in.read<glm::vec3>();
  welcome.box_max = in.read<glm::vec3>();
  welcome.up = in.read<glm::vec3>();
  bool flags_are_valid = readFlag(in, welcome.unlit);
  welcome.light_direction = in.read<glm::vec3>();
  flags_are_valid &= readFlag(in, welcome.has_colors);
  welcome.lattice_origin = in.read<glm::dvec3>();
  welcome.lattice_step = in.f64();
  welcome.group_count = in.u32();
  welcome.patch_count = in.u32();
  welcome.source_triangles = in.u64();
  flags_are_valid &= readFlag(in, welcome.can_render_frames);
  bool has_images = false;
  flags_are_valid &= readFlag(in, has_images);
  if (!in.ok()) return bad("Welcome", "is cut short");
  if (!flags_are_valid) return bad("Welcome", "a flag is neither 0 nor 1");
  if (const char* problem = checkWelcome(welcome)) return bad("Welcome", problem);

  if (has_images) {
    auto grid = repository::Grid::decode(in);
    if (!grid) return bad("Welcome", grid.error().message);
    welcome.grid = *grid;
    if (welcome.grid.face_size < 1 || welcome.grid.face_size > kMaxViewport)
      return bad("Welcome", "its face size is outside 1 to 16384");
  }
  if (!in.atEnd()) return bad("Welcome", "has bytes after its end");
  return ServerMessage(std::move(welcome));
}

base::Bytes readRest(base::ByteReader& in) {
  base::ByteView view = in.bytes(in.remaining());
  return {view.begin(), view.end()};
}

base::Bytes encodeOne(const Face& face) {
  base::ByteWriter out = begin(MessageType::kFace);
  out.u64(face.key.code());
  out.bytes(face.value);
  return out.take();
}

base::Result<ServerMessage> decodeFace(base::ByteReader& in) {
  const std::uint64_t code = in.u64();
  if (!in.ok() || in.remaining() == 0) return bad("Face", "is cut short");
  auto key = repository::FaceKey::fromCode(code);
  if (!key) return bad("Face", key.error().message);
  return ServerMessage(Face{*key, readRest(in)});
}

base::Bytes encodeOne(const Refinement& refine) {
  base::ByteWriter out = begin(MessageType::kRefinement);
  out.u32(static_cast<std::uint32_t>(refine.record.size()));
  out.bytes(refine.record);
  out.bytes(refine.block);
  return out.take();
}

base::Result<ServerMessage> decodeRefine(base::ByteReader& in) {
  Refinement refine;
  base::ByteView record = in.bytes(in.u32());
  if (!in.ok() || record.empty() || in.remaining() == 0) return bad("Refinement", "is cut short");
  refine.record.assign(record.begin(), record.end());
  refine.block = readRest(in);
  return ServerMessage(std::move(refine));
}

base::Bytes encodeOne(const Frame& frame) {
  base::ByteWriter out = begin(MessageType::kFrame);
  out.u32(frame.sequence);
  writeCamera(out, frame.camera);
  out.bytes(frame.value);
  return out.take();
}

base::Result<ServerMessage> decodeFrame(base::ByteReader& in) {
  Frame frame;
  frame.sequence = in.u32();
  if (const char* problem = readCamera(in, frame.camera)) return bad("Frame", problem);
  if (frame.sequence == 0) return bad("Frame", "its sequence number is 0; they count from 1");
  if (in.remaining() == 0) return bad("Frame", "is cut short");
  frame.value = readRest(in);
  return ServerMessage(std::move(frame));
}

base::Bytes encodeOne(const Completion& complete) {
  base::ByteWriter out = begin(MessageType::kCompletion);
  out.u32(complete.sequence);
  return out.take();
}

base::Result<ServerMessage> decodeComplete(base::ByteReader& in) {
  Completion complete{in.u32()};
  if (!in.atEnd()) return bad("Completion", "its length is not 5 bytes");
  if (complete.sequence == 0) return bad("Completion", "its sequence number is 0; they count from 1");
  return ServerMessage(complete);
}

base::Bytes encodeOne(const Refusal& refusal) {
  base::ByteWriter out = begin(MessageType::kRefusal);
  out.u16(refusal.version);
  writeText(out, refusal.reason, kMaxText);
  if (refusal.splats_only) out.u8(kSplatsOnly);
  return out.take();
}

/// A Refusal has the same layout in every version, and later versions may append bytes, which are ignored here.
base::Result<ServerMessage> decodeRefusal(base::ByteReader& in) {
  Refusal refusal;
  refusal.version = in.u16();
  if (!readText(in, kMaxText, refusal.reason))
    return bad("Refusal", "its reason is cut short, too long or not plain text");
  refusal.splats_only = !in.atEnd() && in.u8() == kSplatsOnly;
  return ServerMessage(std::move(refusal));
}

}  // namespace

base::Bytes encode(const ClientMessage& message) {
  return std::visit([](const auto& one) { return encodeOne(one); }, message);
}

base::Bytes encode(const ServerMessage& message) {
  return std::visit([](const auto& one) { return encodeOne(one); }, message);
}

base::Result<ClientMessage> decodeClientMessage(base::ByteView bytes) {
  if (bytes.size() > kMaxClientMessage) return bad("client", "is longer than 256 KiB");
  base::ByteReader in(bytes);
  const auto type = static_cast<MessageType>(in.u8());
  if (!in.ok()) return bad("client", "is empty");
  switch (type) {
    case MessageType::kHello:
      return decodeHello(in);
    case MessageType::kView:
      return decodeView(in);
    case MessageType::kEviction:
      return decodeKeys<Eviction>("Eviction", in);
    case MessageType::kHoldings:
      return decodeKeys<Holdings>("Holdings", in);
    default:
      return bad("client", "has the unknown type " + std::to_string(bytes[0]));
  }
}

base::Result<ServerMessage> decodeServerMessage(base::ByteView bytes) {
  if (bytes.size() > kMaxServerMessage) return bad("server", "is longer than 16 MiB");
  base::ByteReader in(bytes);
  const auto type = static_cast<MessageType>(in.u8());
  if (!in.ok()) return bad("server", "is empty");
  switch (type) {
    case MessageType::kWelcome:
      return decodeWelcome(in);
    case MessageType::kFace:
      return decodeFace(in);
    case MessageType::kRefinement:
      return decodeRefine(in);
    case MessageType::kFrame:
      return decodeFrame(in);
    case MessageType::kCompletion:
      return decodeComplete(in);
    case MessageType::kRefusal:
      return decodeRefusal(in);
    default:
      return bad("server", "has the unknown type " + std::to_string(bytes[0]));
  }
}

}  // namespace protocol
