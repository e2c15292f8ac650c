#include "protocol/message.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string_view>
#include <type_traits>
#include <utility>

#include "base/check.h"

// A message is one type byte, then its fields in the order of docs/formats/protocol.md, little-endian and unpadded. The
// last field of Face, Refinement and Frame runs to the end of the message. The transport frames messages, so it needs
// no length.
namespace protocol {
namespace {

/// A message's type byte is `first_type` plus its place in the variant.
struct Direction {
  const char* name;
  std::size_t max_bytes;
  const char* max_text;
  std::uint8_t first_type;
  std::array<const char*, 7> messages;  // in the order of the variant
};
constexpr Direction kFromClient{"client", kMaxClientMessage, "64 KiB", 0x01, {"Hello", "View", "Eviction", "Holdings"}};
constexpr Direction kFromServer{"server",
                                kMaxServerMessage,
                                "16 MiB",
                                0x81,
                                {"Welcome", "Face", "Refinement", "Frame", "Completion", "Refusal", "Part"}};

constexpr double kPi = 3.14159265358979323846;

base::Error bad(std::string problem) {
  return {base::ErrorCode::kInvalidInput, std::move(problem)};
}

base::Error bad(std::string_view message, const std::string& problem) {
  return bad(std::string(message) + " message: " + problem);
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

/// Flags of a Frame.
constexpr std::uint8_t kLastFrame = 1, kFrameHasSection = 2, kFrameTellsError = 4;

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

// ---- lists of fields, each for both ways: numbers and vectors as they are in memory, flags as 0 or 1 ----

struct FieldWriter {
  base::ByteWriter& out;

  template <class... Values>
  void operator()(const Values&... values) {
    (out.write(values), ...);
  }
  void side(int pixels) { out.u16(static_cast<std::uint16_t>(pixels)); }
};

struct FieldReader {
  base::ByteReader& in;
  bool flags_are_valid = true;  ///< each is 0 or 1

  template <class... Values>
  void operator()(Values&... values) {
    (read(values), ...);
  }
  void side(int& pixels) { pixels = in.u16(); }

 private:
  template <class Value>
  void read(Value& value) {
    value = in.read<Value>();
  }
  void read(bool& flag) {
    const std::uint8_t byte = in.u8();
    flag = byte == 1;
    flags_are_valid &= byte <= 1;
  }
};

template <class Fields, class Camera>
void cameraFields(Fields& fields, Camera& camera) {
  fields(camera.position, camera.direction, camera.up, camera.fov_y);
  fields.side(camera.width);
  fields.side(camera.height);
}

template <class Fields, class Section>
void sectionFields(Fields& fields, Section& section) {
  fields(section.normal, section.offset);
}

template <class Fields, class SomeView>
void settingFields(Fields& fields, SomeView& view) {
  fields(view.patch_tolerance_px, view.max_triangles, view.max_points, view.want_frame, view.frame_quality,
         view.measure);
}

template <class Fields, class SomeWelcome>
void sceneFields(Fields& fields, SomeWelcome& w) {
  fields(w.origin, w.box_min, w.box_max, w.up, w.start_direction, w.unlit, w.light_direction, w.has_colors,
         w.lattice_origin, w.lattice_step, w.group_count, w.patch_count, w.source_triangles, w.can_render_frames);
}

// ---- cameras ----

/// Returns null when the camera is valid, and otherwise the fault.
const char* readCamera(FieldReader& fields, base::ViewCamera& camera) {
  cameraFields(fields, camera);
  if (!fields.in.ok()) return "is cut short in its camera";
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

/// Returns null when the section is valid, and otherwise the fault.
const char* readSection(FieldReader& fields, std::optional<base::SectionPlane>& section) {
  sectionFields(fields, section.emplace());
  if (!fields.in.ok()) return "is cut short in its section";
  if (!isBounded(section->normal) || !(glm::length(section->normal) > 1e-9))
    return "the normal of its section is zero or not a number";
  if (!(std::abs(section->offset) <= kMaxCoordinate)) return "its section is not within 1e12";
  return nullptr;
}

// ---- lists of keys: Eviction and Holdings ----

template <class Message>
concept ListOfKeys = std::is_same_v<Message, Eviction> || std::is_same_v<Message, Holdings>;

template <ListOfKeys Keys>
void writeBody(base::ByteWriter& out, const Keys& keys) {
  LUMIGRID_CHECK_LE(keys.faces.size(), kMaxKeysPerMessage);
  LUMIGRID_CHECK_LE(keys.groups.size(), kMaxKeysPerMessage);
  out.u32(static_cast<std::uint32_t>(keys.faces.size()));
  out.u32(static_cast<std::uint32_t>(keys.groups.size()));
  for (const repository::FaceKey& key : keys.faces) out.u64(key.code());
  for (std::uint32_t group : keys.groups) out.u32(group);
}

template <ListOfKeys Keys>
base::Result<void> readBody(base::ByteReader& in, Keys& keys) {
  const std::uint32_t face_count = in.u32();
  const std::uint32_t group_count = in.u32();
  if (!in.ok()) return bad("is cut short");
  if (face_count > kMaxKeysPerMessage || group_count > kMaxKeysPerMessage)
    return bad("holds more than 8192 keys of a kind");
  if (in.remaining() != std::size_t{8} * face_count + std::size_t{4} * group_count)
    return bad("its length does not fit its counts");

  keys.faces.reserve(face_count);
  for (std::uint32_t i = 0; i < face_count; ++i) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto key, repository::FaceKey::fromCode(in.u64()));
    keys.faces.push_back(key);
  }
  keys.groups.reserve(group_count);
  for (std::uint32_t i = 0; i < group_count; ++i) keys.groups.push_back(in.u32());
  return {};
}

// ---- client to server ----

void writeBody(base::ByteWriter& out, const Hello& hello) {
  out.u16(hello.version);
  writeText(out, hello.client, kMaxText);
  out.u8(hello.abilities);
  out.u32(hello.frame_pixels);
}

/// Reads only the version of a Hello of another version: its other fields may have moved, and the server only refuses
/// it.
base::Result<void> readBody(base::ByteReader& in, Hello& hello) {
  hello.version = in.u16();
  if (!in.ok()) return bad("is cut short");
  if (hello.version != kVersion) return {};
  if (!readText(in, kMaxText, hello.client)) return bad("its client name is cut short, too long or not plain text");
  hello.abilities = in.u8();
  hello.frame_pixels = in.u32();
  if (!in.ok()) return bad("is cut short");
  if (!in.atEnd()) return bad("has bytes after its end");
  return {};
}

void writeBody(base::ByteWriter& out, const View& view) {
  FieldWriter fields{out};
  fields(view.sequence);
  cameraFields(fields, view.camera);
  settingFields(fields, view);
  if (view.camera.section) sectionFields(fields, *view.camera.section);
}

base::Result<void> readBody(base::ByteReader& in, View& view) {
  FieldReader fields{in};
  fields(view.sequence);
  if (const char* problem = readCamera(fields, view.camera)) return bad(problem);
  settingFields(fields, view);
  if (in.ok() && !in.atEnd())
    if (const char* problem = readSection(fields, view.camera.section)) return bad(problem);
  if (!in.ok()) return bad("is cut short");
  if (!in.atEnd()) return bad("has bytes after its end");
  if (view.sequence == 0) return bad("its sequence number is 0; they count from 1");
  if (!(view.patch_tolerance_px >= 0.0F && view.patch_tolerance_px <= kMaxTolerance))
    return bad("its patch tolerance is outside 0 to 1e6 pixels");
  if (!fields.flags_are_valid) return bad("its frame flag is neither 0 nor 1");
  if (static_cast<std::uint8_t>(view.measure) >= base::kErrorMeasures)
    return bad("its measure of errors is none of 0, 1 and 2");
  if (view.frame_quality > 100) return bad("its frame quality is outside 0 to 100");
  return {};
}

// ---- server to client ----

void writeBody(base::ByteWriter& out, const Welcome& welcome) {
  out.u16(welcome.version);
  writeText(out, welcome.scene_name, kMaxText);
  writeText(out, welcome.units, kMaxUnits);
  writeText(out, welcome.start_view, kMaxText);
  FieldWriter fields{out};
  const bool has_images = welcome.grid.pointCount() != 0;
  sceneFields(fields, welcome);
  fields(has_images);
  if (has_images) welcome.grid.encode(out);
  writeText(out, welcome.attribution, kMaxText);
  fields(welcome.background.has_value());
  for (const std::uint8_t part : welcome.background.value_or(base::Rgb{})) fields(part);
  fields(welcome.north);
  // Earlier clients know none of the rest, so that it is absent where it says nothing.
  if (welcome.shadows || !welcome.hull.empty()) fields(welcome.shadows);
  if (welcome.hull.empty()) return;
  out.u8(static_cast<std::uint8_t>(welcome.hull.size()));
  for (const glm::vec3& point : welcome.hull) fields(point);
}

/// Normalizes the directions. Returns null when the values are valid, and otherwise the fault.
const char* checkWelcome(Welcome& welcome) {
  if (!isBounded(welcome.origin)) return "its origin is not a number below 1e12";
  if (!isBounded(welcome.box_min) || !isBounded(welcome.box_max) ||
      glm::any(glm::greaterThan(welcome.box_min, welcome.box_max)))
    return "its box is inside out or not a number";
  if (!makeUnit(welcome.up)) return "its up vector is zero or not a number";
  if (welcome.start_direction != glm::vec3(0.0F) && !makeUnit(welcome.start_direction))
    return "its first direction is not a number";
  if (!makeUnit(welcome.light_direction)) return "its light direction is zero or not a number";
  if (!isBounded(welcome.lattice_origin)) return "its lattice origin is not a number below 1e12";
  if (!(welcome.lattice_step > 0.0 && welcome.lattice_step <= kMaxCoordinate))
    return "its lattice step is not above zero";
  if (welcome.group_count > kMaxGroups || welcome.patch_count > kMaxPatches)
    return "its hierarchy is larger than this version allows";
  return nullptr;
}

base::Result<void> readBody(base::ByteReader& in, Welcome& welcome) {
  welcome.version = in.u16();
  if (in.ok() && welcome.version != kVersion)
    return base::Error{base::ErrorCode::kVersion, "the server speaks protocol " + std::to_string(welcome.version) +
                                                      ", this client speaks " + std::to_string(kVersion) +
                                                      "; update the older one"};
  if (!readText(in, kMaxText, welcome.scene_name))
    return bad("its scene name is cut short, too long or not plain text");
  if (!readText(in, kMaxUnits, welcome.units))
    return bad("its unit of length is cut short, too long or not plain text");
  if (!readText(in, kMaxText, welcome.start_view))
    return bad("its first view is cut short, too long or not plain text");
  FieldReader fields{in};
  bool has_images = false;
  sceneFields(fields, welcome);
  fields(has_images);
  if (!in.ok()) return bad("is cut short");
  if (!fields.flags_are_valid) return bad("a flag is neither 0 nor 1");
  if (const char* problem = checkWelcome(welcome)) return bad(problem);

  if (has_images) {
    LUMIGRID_ASSIGN_OR_RETURN(welcome.grid, repository::Grid::decode(in));
    if (welcome.grid.face_size < 1 || welcome.grid.face_size > kMaxViewport)
      return bad("its face size is outside 1 to 16384");
  }
  if (!readText(in, kMaxText, welcome.attribution))
    return bad("its attribution is cut short, too long or not plain text");
  bool has_background = false;
  base::Rgb color{};
  fields(has_background, color[0], color[1], color[2], welcome.north);
  if (has_background) welcome.background = color;
  if (!in.ok()) return bad("is cut short");
  if (!fields.flags_are_valid) return bad("a flag is neither 0 nor 1");
  if (welcome.north != glm::vec3(0.0F) && !makeUnit(welcome.north)) return bad("its north is not a number");
  if (in.atEnd()) return {};
  fields(welcome.shadows);
  if (!in.atEnd()) welcome.hull.resize(std::min<std::size_t>(in.u8(), kMaxHull));
  bool is_valid = fields.flags_are_valid && (welcome.shadows || !welcome.hull.empty());
  for (glm::vec3& point : welcome.hull) {
    fields(point);
    is_valid = is_valid && isBounded(point);
  }
  if (!is_valid || !in.atEnd()) return bad("has bytes after its end, or its hull is no list of points");
  return {};
}

base::Bytes readRest(base::ByteReader& in) {
  base::ByteView view = in.bytes(in.remaining());
  return {view.begin(), view.end()};
}

void writeBody(base::ByteWriter& out, const Face& face) {
  out.u64(face.key.code());
  out.bytes(face.value);
}

base::Result<void> readBody(base::ByteReader& in, Face& face) {
  const std::uint64_t code = in.u64();
  if (!in.ok() || in.remaining() == 0) return bad("is cut short");
  LUMIGRID_ASSIGN_OR_RETURN(face.key, repository::FaceKey::fromCode(code));
  face.value = readRest(in);
  return {};
}

void writeBody(base::ByteWriter& out, const Refinement& refine) {
  out.u32(static_cast<std::uint32_t>(refine.record.size()));
  out.bytes(refine.record);
  out.bytes(refine.block);
}

base::Result<void> readBody(base::ByteReader& in, Refinement& refine) {
  base::ByteView record = in.bytes(in.u32());
  if (!in.ok() || record.empty() || in.remaining() == 0) return bad("is cut short");
  refine.record.assign(record.begin(), record.end());
  refine.block = readRest(in);
  return {};
}

void writeBody(base::ByteWriter& out, const Frame& frame) {
  FieldWriter fields{out};
  fields(frame.sequence);
  cameraFields(fields, frame.camera);
  const bool has_section = frame.camera.section.has_value();
  const bool tells_error = frame.coding_error > 0.0F;
  out.u8(static_cast<std::uint8_t>((frame.last ? kLastFrame : 0) | (has_section ? kFrameHasSection : 0) |
                                   (tells_error ? kFrameTellsError : 0)));
  if (has_section) sectionFields(fields, *frame.camera.section);
  if (tells_error) fields(frame.coding_error);
  out.bytes(frame.value);
}

base::Result<void> readBody(base::ByteReader& in, Frame& frame) {
  FieldReader fields{in};
  fields(frame.sequence);
  if (const char* problem = readCamera(fields, frame.camera)) return bad(problem);
  const std::uint8_t flags = in.u8();
  frame.last = (flags & kLastFrame) != 0;
  if (flags > (kLastFrame | kFrameHasSection | kFrameTellsError)) return bad("its flags are none that there are");
  if ((flags & kFrameHasSection) != 0)
    if (const char* problem = readSection(fields, frame.camera.section)) return bad(problem);
  if ((flags & kFrameTellsError) != 0) {
    fields(frame.coding_error);
    if (!(frame.coding_error > 0.0F && frame.coding_error <= 1.0F))
      return bad("its coding error is not within 0 and 1");
  }
  if (frame.sequence == 0) return bad("its sequence number is 0; they count from 1");
  if (in.remaining() == 0) return bad("is cut short");
  frame.value = readRest(in);
  return {};
}

void writeBody(base::ByteWriter& out, const Completion& complete) {
  out.u32(complete.sequence);
}

base::Result<void> readBody(base::ByteReader& in, Completion& complete) {
  complete.sequence = in.u32();
  if (!in.atEnd()) return bad("its length is not 5 bytes");
  if (complete.sequence == 0) return bad("its sequence number is 0; they count from 1");
  return {};
}

void writeBody(base::ByteWriter& out, const Refusal& refusal) {
  out.u16(refusal.version);
  writeText(out, refusal.reason, kMaxText);
  if (refusal.instead != Streamed::kNothing) out.u8(static_cast<std::uint8_t>(refusal.instead));
}

/// A Refusal has the same layout in every version, and later versions may append bytes, which are ignored here.
base::Result<void> readBody(base::ByteReader& in, Refusal& refusal) {
  refusal.version = in.u16();
  if (!readText(in, kMaxText, refusal.reason)) return bad("its reason is cut short, too long or not plain text");
  const std::uint8_t instead = in.atEnd() ? std::uint8_t{0} : in.u8();
  if (instead <= static_cast<std::uint8_t>(Streamed::kHlod)) refusal.instead = static_cast<Streamed>(instead);
  return {};
}

void writeBody(base::ByteWriter& out, const Part& part) {
  FieldWriter fields{out};
  fields(part.stream, part.first, part.last);
  out.bytes(part.bytes);
}

base::Result<void> readBody(base::ByteReader& in, Part& part) {
  FieldReader fields{in};
  fields(part.stream, part.first, part.last);
  if (in.remaining() == 0) return bad("is cut short");
  if (static_cast<std::size_t>(part.stream) >= kStreams) return bad("its stream is neither 0 nor 1");
  if (!fields.flags_are_valid) return bad("a flag is neither 0 nor 1");
  part.bytes = readRest(in);
  return {};
}

// ---- whole messages ----

template <class Message>
base::Bytes encodeFrom(const Direction& direction, const Message& message) {
  base::ByteWriter out;
  out.u8(static_cast<std::uint8_t>(direction.first_type + message.index()));
  std::visit([&](const auto& one) { writeBody(out, one); }, message);
  return out.takeBytes();
}

/// Errors name the message, but for another version.
template <class Message, std::size_t Index>
base::Result<Message> decodeBody(const Direction& direction, base::ByteReader& in) {
  std::variant_alternative_t<Index, Message> one;
  const auto read = readBody(in, one);
  if (read) return Message(std::move(one));
  return read.error().code == base::ErrorCode::kVersion ? read.error()
                                                        : bad(direction.messages[Index], read.error().message);
}

template <class Message, std::size_t... Indices>
base::Result<Message> decodeFrom(const Direction& direction, base::ByteView bytes, std::index_sequence<Indices...>) {
  if (bytes.size() > direction.max_bytes)
    return bad(direction.name, std::string("is longer than ") + direction.max_text);
  base::ByteReader in(bytes);
  const std::uint8_t type = in.u8();
  if (!in.ok()) return bad(direction.name, "is empty");
  std::optional<base::Result<Message>> decoded;
  const auto decodeIf = [&](bool is_type, auto decode) {
    if (is_type) decoded.emplace(decode(direction, in));
  };
  (decodeIf(type == direction.first_type + Indices, decodeBody<Message, Indices>), ...);
  return decoded ? std::move(*decoded) : bad(direction.name, "has the unknown type " + std::to_string(type));
}

struct StreamedName {
  std::string_view method;
  const char* content;
};
/// By the number of Streamed.
constexpr std::array<StreamedName, 4> kStreamedNames{
    {{"", ""}, {"qsplat", "splats"}, {"pmr", "points"}, {"hlod", "triangles and points"}}};

}  // namespace

const char* methodOf(Streamed streamed) {
  return kStreamedNames[static_cast<std::size_t>(streamed)].method.data();
}

const char* contentOf(Streamed streamed) {
  return kStreamedNames[static_cast<std::size_t>(streamed)].content;
}

Streamed streamedOf(std::string_view method) {
  std::size_t number = kStreamedNames.size() - 1;
  while (number > 0 && kStreamedNames[number].method != method) --number;
  return static_cast<Streamed>(number);
}

base::Bytes encode(const ClientMessage& message) {
  return encodeFrom(kFromClient, message);
}

base::Bytes encode(const ServerMessage& message) {
  return encodeFrom(kFromServer, message);
}

base::Bytes encode(const Welcome& welcome) {
  base::ByteWriter out;
  out.u8(kFromServer.first_type);
  writeBody(out, welcome);
  return out.takeBytes();
}

base::Result<ClientMessage> decodeClientMessage(base::ByteView bytes) {
  return decodeFrom<ClientMessage>(kFromClient, bytes, std::make_index_sequence<std::variant_size_v<ClientMessage>>());
}

base::Result<ServerMessage> decodeServerMessage(base::ByteView bytes) {
  return decodeFrom<ServerMessage>(kFromServer, bytes, std::make_index_sequence<std::variant_size_v<ServerMessage>>());
}

}  // namespace protocol
