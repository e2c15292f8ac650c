#include "protocol/message.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <random>

namespace protocol {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr std::size_t kViewBytes = 102;  ///< without a section

// ---- random messages ----

class MessageGenerator {
 public:
  explicit MessageGenerator(unsigned seed) : random_(seed) {}

  double real(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_); }
  float single(double low, double high) { return static_cast<float>(real(low, high)); }
  std::uint32_t whole(std::uint32_t low, std::uint32_t high) {
    return std::uniform_int_distribution<std::uint32_t>(low, high)(random_);
  }
  bool coin() { return whole(0, 1) == 1; }
  glm::dvec3 place() { return {real(-1e7, 1e7), real(-1e7, 1e7), real(-1e7, 1e7)}; }
  glm::dvec3 unit() {
    glm::dvec3 v;
    do v = {real(-1, 1), real(-1, 1), real(-1, 1)};
    while (glm::length(v) < 0.1);
    return glm::normalize(v);
  }
  base::Bytes bytes(std::uint32_t least, std::uint32_t most) {
    base::Bytes drawn(whole(least, most));
    for (auto& b : drawn) b = static_cast<std::uint8_t>(whole(0, 255));
    return drawn;
  }
  std::string text() {
    std::string drawn(whole(0, 60), ' ');
    for (auto& c : drawn) c = static_cast<char>(whole(0x20, 0x7E));
    return drawn;
  }
  base::ViewCamera camera() {
    base::ViewCamera camera;
    camera.position = place();
    camera.direction = unit();
    do camera.up = unit();
    while (glm::length(glm::cross(camera.up, camera.direction)) < 0.1);
    camera.fov_y = real(0.01, 3.0);
    camera.width = static_cast<int>(whole(1, 16384));
    camera.height = static_cast<int>(whole(1, 16384));
    if (coin()) camera.section = {unit(), real(-1e7, 1e7)};
    return camera;
  }
  repository::FaceKey key() {
    return {whole(0, repository::kMaxGridIndex), whole(0, repository::kMaxGridIndex),
            whole(0, repository::kMaxGridIndex), whole(0, 5)};
  }
  template <class Keys>
  Keys keys() {
    Keys drawn;
    for (std::uint32_t i = whole(0, 20); i > 0; --i) drawn.faces.push_back(key());
    for (std::uint32_t i = whole(0, 20); i > 0; --i) drawn.groups.push_back(whole(0, 0xFFFFFFFF));
    return drawn;
  }
  Hello hello() { return {kVersion, text(), static_cast<std::uint8_t>(whole(0, 255)), whole(0, 1U << 31U)}; }
  View view() {
    return {whole(1, 0xFFFFFFFF),
            camera(),
            single(0, 100),
            whole(0, 0xFFFFFFFF),
            static_cast<std::uint16_t>(whole(0, 0xFFFF)),
            coin(),
            static_cast<std::uint8_t>(whole(1, 100)),
            static_cast<base::ErrorMeasure>(whole(0, 2))};
  }
  Welcome welcome() {
    Welcome drawn;
    drawn.scene_name = text();
    drawn.units = text().substr(0, kMaxUnits);
    drawn.origin = place();
    drawn.box_min = glm::vec3(place());
    drawn.box_max = drawn.box_min + glm::abs(glm::vec3(place()));
    drawn.up = glm::vec3(unit());
    if (coin()) drawn.start_direction = glm::vec3(unit());
    if (coin()) drawn.start_view = "v=1&p=1,2,3&a=4,5&r=6";
    drawn.attribution = text();
    if (coin())
      drawn.background =
          base::Rgb{static_cast<std::uint8_t>(whole(0, 255)), static_cast<std::uint8_t>(whole(0, 255)), 7};
    if (coin()) drawn.north = glm::vec3(unit());
    if (coin())
      for (std::uint32_t i = whole(1, kMaxHull); i > 0; --i) drawn.hull.emplace_back(place());
    drawn.unlit = coin();
    drawn.light_direction = glm::vec3(unit());
    drawn.has_colors = coin();
    drawn.lattice_origin = place();
    drawn.lattice_step = real(1e-9, 10.0);
    drawn.group_count = whole(1, kMaxGroups);
    drawn.patch_count = whole(1, kMaxPatches);
    drawn.source_triangles = std::uint64_t{whole(0, 0xFFFFFFFF)} << 10;
    drawn.can_render_frames = coin();
    if (coin())
      drawn.grid = {glm::vec3(unit()), single(0.1, 3.0), glm::uvec3(whole(2, 40), whole(2, 40), whole(2, 40)),
                    whole(1, 2048)};
    return drawn;
  }
  std::vector<ClientMessage> clientMessages() { return {hello(), view(), keys<Eviction>(), keys<Holdings>()}; }
  std::vector<ServerMessage> serverMessages() {
    return {welcome(),
            Face{key(), bytes(1, 300)},
            Refinement{bytes(1, 99), bytes(1, 300)},
            Frame{whole(1, 0xFFFFFFFF), camera(), coin(), bytes(1, 300), coin() ? 0.0F : 0.25F},
            Completion{whole(1, 0xFFFFFFFF)},
            Refusal{static_cast<std::uint16_t>(whole(0, 0xFFFF)), text()},
            Part{static_cast<Stream>(whole(0, 1)), coin(), coin(), bytes(1, 300)}};
  }

 private:
  std::mt19937 random_;
};

base::Bytes bytesOf(const ClientMessage& message) {
  return encode(message);
}
base::Bytes bytesOf(const ServerMessage& message) {
  return encode(message);
}

std::string problemOf(const ClientMessage& message) {
  auto decoded = decodeClientMessage(encode(message));
  return decoded ? "" : decoded.error().message;
}
std::string problemOf(const ServerMessage& message) {
  auto decoded = decodeServerMessage(encode(message));
  return decoded ? "" : decoded.error().message;
}

// ---- round trips ----

// The bytes are equal after decoding and encoding again. Together with decodeReadsEveryFieldOfAView below, this proves
// that every field is equal.
TEST(Message, everyClientMessageComesBack) {
  for (unsigned seed = 0; seed < 200; ++seed) {
    for (const ClientMessage& message : MessageGenerator(seed).clientMessages()) {
      auto decoded = decodeClientMessage(encode(message));
      ASSERT_TRUE(decoded) << decoded.error().message;
      EXPECT_EQ(decoded->index(), message.index());
      EXPECT_EQ(bytesOf(*decoded), bytesOf(message));
    }
  }
}

TEST(Message, everyServerMessageComesBack) {
  for (unsigned seed = 0; seed < 200; ++seed) {
    for (const ServerMessage& message : MessageGenerator(seed).serverMessages()) {
      auto decoded = decodeServerMessage(encode(message));
      ASSERT_TRUE(decoded) << decoded.error().message;
      EXPECT_EQ(decoded->index(), message.index());
      EXPECT_EQ(bytesOf(*decoded), bytesOf(message));
    }
  }
}

TEST(Message, aWelcomeByItselfIsTheSame) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    const Welcome welcome = MessageGenerator(seed).welcome();
    EXPECT_EQ(encode(welcome), encode(ServerMessage(welcome)));
  }
}

TEST(Message, decodeReadsEveryFieldOfAView) {
  View sent = MessageGenerator(7).view();
  sent.camera.section = {{0.6, 0.0, -0.8}, 1.5};
  const View got = std::get<View>(*decodeClientMessage(encode(ClientMessage(sent))));
  EXPECT_EQ(got.sequence, sent.sequence);
  EXPECT_EQ(got.camera.position, sent.camera.position);
  EXPECT_EQ(got.camera.direction, sent.camera.direction);
  EXPECT_EQ(got.camera.up, sent.camera.up);
  EXPECT_EQ(got.camera.fov_y, sent.camera.fov_y);
  EXPECT_EQ(got.camera.width, sent.camera.width);
  EXPECT_EQ(got.camera.height, sent.camera.height);
  EXPECT_EQ(got.patch_tolerance_px, sent.patch_tolerance_px);
  EXPECT_EQ(got.max_triangles, sent.max_triangles);
  EXPECT_EQ(got.max_points, sent.max_points);
  EXPECT_EQ(got.want_frame, sent.want_frame);
  EXPECT_EQ(got.frame_quality, sent.frame_quality);
  EXPECT_EQ(got.camera.section, sent.camera.section);
}

TEST(Message, aFrameTellsTheSectionThatItWasDrawnWith) {
  for (const bool last : {false, true}) {
    Frame sent{3, MessageGenerator(7).camera(), last, {0x77}};
    sent.camera.section = {{0.0, 1.0, 0.0}, -2.5};
    const Frame got = std::get<Frame>(*decodeServerMessage(encode(ServerMessage(sent))));
    EXPECT_EQ(got.camera.section, sent.camera.section);
    EXPECT_EQ(got.last, last);
    EXPECT_EQ(got.value, sent.value);
  }
}

TEST(Message, decodeReadsEveryFieldOfAWelcome) {
  const Welcome sent = MessageGenerator(11).welcome();
  const Welcome got = std::get<Welcome>(*decodeServerMessage(encode(ServerMessage(sent))));
  EXPECT_EQ(got.scene_name, sent.scene_name);
  EXPECT_EQ(got.units, sent.units);
  EXPECT_EQ(got.origin, sent.origin);
  EXPECT_EQ(got.box_min, sent.box_min);
  EXPECT_EQ(got.box_max, sent.box_max);
  EXPECT_EQ(got.up, sent.up);
  EXPECT_EQ(got.light_direction, sent.light_direction);
  EXPECT_EQ(got.lattice_origin, sent.lattice_origin);
  EXPECT_EQ(got.lattice_step, sent.lattice_step);
  EXPECT_EQ(got.group_count, sent.group_count);
  EXPECT_EQ(got.patch_count, sent.patch_count);
  EXPECT_EQ(got.source_triangles, sent.source_triangles);
  EXPECT_EQ(got.grid, sent.grid);
  EXPECT_EQ(got.unlit, sent.unlit);
  EXPECT_EQ(got.has_colors, sent.has_colors);
  EXPECT_EQ(got.can_render_frames, sent.can_render_frames);
}

TEST(Message, aWelcomeTellsHowTheSceneIsShown) {
  Welcome sent = MessageGenerator(12).welcome();
  for (const bool said : {true, false}) {
    sent.attribution = said ? "S\u00F6hne & Co." : "";
    sent.background = said ? std::optional(base::Rgb{1, 2, 255}) : std::nullopt;
    sent.north = said ? glm::vec3(0.6F, -0.8F, 0.0F) : glm::vec3(0.0F);
    sent.shadows = said;
    const Welcome got = std::get<Welcome>(*decodeServerMessage(encode(ServerMessage(sent))));
    EXPECT_EQ(got.attribution, sent.attribution);
    EXPECT_EQ(got.background, sent.background);
    EXPECT_EQ(got.north, sent.north);
    EXPECT_EQ(got.shadows, sent.shadows);
  }
  // Without shadows there is no flag, unless a hull follows.
  sent.shadows = true;
  sent.hull.clear();
  base::Bytes bytes = encode(ServerMessage(sent));
  bytes.back() = 0;
  EXPECT_FALSE(decodeServerMessage(bytes));
}

TEST(Message, aWelcomeTellsTheHullWithAndWithoutShadows) {
  for (const bool shadows : {true, false}) {
    Welcome sent = MessageGenerator(12).welcome();
    sent.shadows = shadows;
    sent.hull = {{1.0F, -2.0F, 3.0F}, {0.0F, 0.5F, 1e9F}};
    const base::Bytes bytes = encode(ServerMessage(sent));
    const Welcome got = std::get<Welcome>(*decodeServerMessage(bytes));
    EXPECT_EQ(got.hull, sent.hull);
    EXPECT_EQ(got.shadows, shadows);
    for (std::size_t cut = 1; cut <= 2 * sizeof(glm::vec3) + 1; ++cut) {
      // Cut before the count it is a Welcome without hull.
      const bool is_whole = shadows && cut == 2 * sizeof(glm::vec3) + 1;
      EXPECT_EQ(bool(decodeServerMessage(base::ByteView(bytes).first(bytes.size() - cut))), is_whole) << cut;
    }
  }
}

TEST(Message, aHullOfTooManyPointsOrNoNumbersIsRefused) {
  Welcome welcome;
  welcome.hull.assign(kMaxHull, glm::vec3(1.0F));
  EXPECT_EQ(problemOf(ServerMessage(welcome)), "");
  welcome.hull.emplace_back(1.0F);
  EXPECT_NE(problemOf(ServerMessage(welcome)).find("hull"), std::string::npos);
  for (const double bad : {kNan, kInf, 2e12}) {
    welcome.hull = {glm::vec3(1.0F), glm::vec3(0.0F, static_cast<float>(bad), 0.0F)};
    EXPECT_NE(problemOf(ServerMessage(welcome)).find("hull"), std::string::npos) << bad;
  }
  // A count of none without shadows says nothing.
  welcome.hull.clear();
  base::Bytes bytes = encode(ServerMessage(welcome));
  bytes.insert(bytes.end(), {0, 0});
  EXPECT_FALSE(decodeServerMessage(bytes));
}

// These are the bytes of docs/formats/protocol.md, "A worked row". Version 6 of the format must never read otherwise.
TEST(Message, bytesOfVersionSixStay) {
  EXPECT_EQ(encode(ClientMessage(Hello{6, "ab", kDecodesWebp, 258})),
            (base::Bytes{0x01, 6, 0, 2, 0, 'a', 'b', 1, 2, 1, 0, 0}));
  EXPECT_EQ(encode(ServerMessage(Completion{258})), (base::Bytes{0x85, 2, 1, 0, 0}));
  EXPECT_EQ(encode(ClientMessage(Eviction{{{1, 0, 0, 3}}, {7}})),
            (base::Bytes{0x03, 1, 0, 0, 0, 1, 0, 0, 0, 0, 0x58, 0, 0, 0, 0, 0, 0, 7, 0, 0, 0}));
  EXPECT_EQ(encode(ServerMessage(Refusal{6, "no"})), (base::Bytes{0x86, 6, 0, 2, 0, 'n', 'o'}));
  EXPECT_EQ(encode(ServerMessage(Refusal{6, "no", Streamed::kSplats})), (base::Bytes{0x86, 6, 0, 2, 0, 'n', 'o', 1}));
  EXPECT_EQ(encode(ServerMessage(Part{Stream::kFrames, true, false, {9, 8}})), (base::Bytes{0x87, 1, 1, 0, 9, 8}));
  EXPECT_EQ(encode(ClientMessage(View{})).size(), kViewBytes);
  const base::Bytes frame = encode(ServerMessage(Frame{1, {}, true, {0x77}}));
  ASSERT_EQ(frame.size(), 91U);
  EXPECT_EQ(frame[89], 1);
  EXPECT_EQ(frame[90], 0x77);
  const base::Bytes told = encode(ServerMessage(Frame{1, {}, true, {0x77}, 0.5F}));
  ASSERT_EQ(told.size(), 95U);
  EXPECT_EQ(told[89], 5);
  EXPECT_EQ(told[93], 0x3F);
  EXPECT_EQ(told[94], 0x77);
}

TEST(Message, aCodingErrorThatNoPictureHasIsRefused) {
  for (const float error : {1.0F, 1.5F, std::numeric_limits<float>::quiet_NaN(), -0.1F}) {
    base::Bytes bytes = encode(ServerMessage(Frame{1, {}, false, {0x77}, 0.5F}));
    std::memcpy(&bytes[90], &error, sizeof(error));
    const auto decoded = decodeServerMessage(bytes);
    EXPECT_EQ(static_cast<bool>(decoded), error == 1.0F) << error;
    if (!decoded) {
      EXPECT_NE(decoded.error().message.find("coding error"), std::string::npos);
    }
  }
}

TEST(Message, eachStreamedFileHasTheMethodThatDrawsIt) {
  for (const auto& [streamed, method] : {std::pair(Streamed::kSplats, "qsplat"),
                                         {Streamed::kUmbrellas, "pmr"},
                                         {Streamed::kHlod, "hlod"},
                                         {Streamed::kNothing, ""}}) {
    EXPECT_STREQ(methodOf(streamed), method);
    EXPECT_EQ(streamedOf(method), streamed);
  }
  EXPECT_EQ(streamedOf("patches"), Streamed::kNothing);
}

TEST(Message, bytesBehindARefusalAreReadWhereKnown) {
  for (const auto& [more, instead] : std::vector<std::pair<base::Bytes, Streamed>>{{{}, Streamed::kNothing},
                                                                                   {{0}, Streamed::kNothing},
                                                                                   {{1}, Streamed::kSplats},
                                                                                   {{1, 7, 7}, Streamed::kSplats},
                                                                                   {{2}, Streamed::kUmbrellas},
                                                                                   {{3}, Streamed::kHlod},
                                                                                   {{4}, Streamed::kNothing}}) {
    base::Bytes bytes{0x86, 2, 0, 2, 0, 'n', 'o'};
    bytes.insert(bytes.end(), more.begin(), more.end());
    const auto message = decodeServerMessage(bytes);
    ASSERT_TRUE(message);
    EXPECT_EQ(std::get<Refusal>(*message).reason, "no");
    EXPECT_EQ(std::get<Refusal>(*message).instead, instead);
  }
}

// ---- broken messages ----

TEST(Message, clientMessageCutAnywhereIsRefused) {
  MessageGenerator generator(3);
  for (const ClientMessage& message : generator.clientMessages()) {
    const base::Bytes whole = encode(message);
    const bool is_view = std::holds_alternative<View>(message);
    for (std::size_t length = 0; length < whole.size(); ++length) {
      const bool is_whole = is_view && length == kViewBytes;  // before its section
      EXPECT_EQ(static_cast<bool>(decodeClientMessage(base::ByteView(whole).first(length))), is_whole)
          << "type " << int{whole[0]} << " at " << length;
    }
  }
}

// Values that run to the end of the message become shorter with it; they carry their own checksums. The fields before
// them must be whole.
TEST(Message, serverMessageCutAnywhereIsRefusedOrShorter) {
  MessageGenerator generator(4);
  for (const ServerMessage& message : generator.serverMessages()) {
    const base::Bytes whole = encode(message);
    for (std::size_t length = 0; length < whole.size(); ++length) {
      auto decoded = decodeServerMessage(base::ByteView(whole).first(length));
      if (!decoded) continue;
      const bool open_ended = std::holds_alternative<Face>(*decoded) || std::holds_alternative<Refinement>(*decoded) ||
                              std::holds_alternative<Frame>(*decoded) || std::holds_alternative<Part>(*decoded);
      EXPECT_TRUE(open_ended) << "type " << int{whole[0]} << " at " << length;
      EXPECT_EQ(encode(*decoded).size(), length);
    }
  }
}

TEST(Message, bytesAfterTheEndAreRefused) {
  MessageGenerator generator(5);
  for (const ClientMessage& message : generator.clientMessages()) {
    base::Bytes longer = encode(message);
    longer.push_back(0);
    EXPECT_FALSE(decodeClientMessage(longer)) << "type " << int{longer[0]};
  }
}

TEST(Message, anyByteFlippedIsReadWithoutHarm) {
  MessageGenerator generator(6);
  for (const ClientMessage& message : generator.clientMessages()) {
    const base::Bytes whole = encode(message);
    for (std::size_t i = 0; i < whole.size(); ++i) {
      base::Bytes broken = whole;
      broken[i] ^= static_cast<std::uint8_t>(generator.whole(1, 255));
      auto decoded = decodeClientMessage(broken);
      if (decoded) {
        EXPECT_FALSE(encode(*decoded).empty());
      }
    }
  }
}

TEST(Message, unknownTypesAreRefusedOnTheirSide) {
  EXPECT_FALSE(decodeClientMessage({}));
  EXPECT_FALSE(decodeServerMessage({}));
  EXPECT_FALSE(decodeClientMessage(encode(ServerMessage(Completion{1}))));
  EXPECT_FALSE(decodeServerMessage(encode(ClientMessage(Hello{}))));
  EXPECT_NE(decodeClientMessage(base::Bytes{0x7F}).error().message.find("127"), std::string::npos);
}

TEST(Message, invalidViewsAreRefused) {
  auto withView = [](auto change) {
    View view;
    view.sequence = 1;
    change(view);
    return problemOf(ClientMessage(view));
  };
  EXPECT_EQ(withView([](View&) {}), "");
  EXPECT_NE(withView([](View& v) { v.sequence = 0; }), "");
  EXPECT_NE(withView([](View& v) { v.camera.position.x = kNan; }), "");
  EXPECT_NE(withView([](View& v) { v.camera.position.y = kInf; }), "");
  EXPECT_NE(withView([](View& v) { v.camera.position.z = 1e300; }), "");
  EXPECT_NE(withView([](View& v) { v.camera.direction = glm::dvec3(0.0); }), "");
  EXPECT_NE(withView([](View& v) { v.camera.direction.z = kNan; }), "");
  EXPECT_NE(withView([](View& v) { v.camera.up = glm::dvec3(0.0); }), "");
  EXPECT_NE(withView([](View& v) { v.camera.up = -3.0 * v.camera.direction; }), "");
  EXPECT_NE(withView([](View& v) { v.camera.fov_y = 0.0; }), "");
  EXPECT_NE(withView([](View& v) { v.camera.fov_y = 3.1416; }), "");
  EXPECT_NE(withView([](View& v) { v.camera.fov_y = kNan; }), "");
  EXPECT_NE(withView([](View& v) { v.camera.width = 0; }), "");
  EXPECT_NE(withView([](View& v) { v.camera.height = 16385; }), "");
  EXPECT_NE(withView([](View& v) { v.patch_tolerance_px = -1.0F; }), "");
  EXPECT_NE(withView([](View& v) { v.patch_tolerance_px = static_cast<float>(kNan); }), "");
  EXPECT_EQ(withView([](View& v) { v.frame_quality = kServersChoice; }), "");
  EXPECT_NE(withView([](View& v) { v.frame_quality = 101; }), "");
  EXPECT_EQ(withView([](View& v) { v.camera.section = {{0.0, 2.0, 0.0}, 1e12}; }), "");
  EXPECT_NE(withView([](View& v) { v.camera.section = {{0.0, 0.0, 0.0}, 1.0}; }), "");
  EXPECT_NE(withView([](View& v) { v.camera.section = {{kNan, 1.0, 0.0}, 1.0}; }), "");
  EXPECT_NE(withView([](View& v) { v.camera.section = {{0.0, 1.0, 0.0}, 2e12}; }), "");
  EXPECT_NE(withView([](View& v) { v.camera.section = {{0.0, 1.0, 0.0}, kNan}; }), "");
}

TEST(Message, directionsComeOutUnit) {
  View view;
  view.sequence = 1;
  view.camera.direction = {0.0, 3.0, -4.0};
  view.camera.up = {0.0, 1e-3, 0.0};
  const View got = std::get<View>(*decodeClientMessage(encode(ClientMessage(view))));
  EXPECT_NEAR(glm::length(got.camera.direction), 1.0, 1e-12);
  EXPECT_NEAR(got.camera.direction.y, 0.6, 1e-12);
  EXPECT_NEAR(got.camera.up.y, 1.0, 1e-12);
}

TEST(Message, invalidWelcomesAreRefused) {
  auto withWelcome = [](auto change) {
    Welcome welcome;
    welcome.group_count = welcome.patch_count = 1;
    change(welcome);
    return problemOf(ServerMessage(welcome));
  };
  EXPECT_EQ(withWelcome([](Welcome&) {}), "");
  EXPECT_NE(withWelcome([](Welcome& w) { w.origin.x = kNan; }), "");
  EXPECT_NE(withWelcome([](Welcome& w) { w.box_min.x = 2.0F, w.box_max.x = 1.0F; }), "");
  EXPECT_NE(withWelcome([](Welcome& w) { w.box_max.x = static_cast<float>(kNan); }), "");
  EXPECT_NE(withWelcome([](Welcome& w) { w.up = glm::vec3(0.0F); }), "");
  EXPECT_NE(withWelcome([](Welcome& w) { w.light_direction = glm::vec3(0.0F); }), "");
  EXPECT_NE(withWelcome([](Welcome& w) { w.north.y = static_cast<float>(kNan); }), "");
  EXPECT_NE(withWelcome([](Welcome& w) { w.lattice_step = 0.0; }), "");
  EXPECT_NE(withWelcome([](Welcome& w) { w.lattice_step = kNan; }), "");
  EXPECT_NE(withWelcome([](Welcome& w) { w.group_count = kMaxGroups + 1; }), "");
  EXPECT_NE(withWelcome([](Welcome& w) { w.patch_count = kMaxPatches + 1; }), "");
  EXPECT_NE(withWelcome([](Welcome& w) { w.grid = {glm::vec3(0.0F), 0.0F, glm::uvec3(2), 64}; }), "");
  EXPECT_NE(withWelcome([](Welcome& w) { w.grid = {glm::vec3(0.0F), 1.0F, glm::uvec3(2), 0}; }), "");
}

TEST(Message, keysOutOfRangeAreRefused) {
  base::Bytes bytes = encode(ClientMessage(Holdings{{{1, 2, 3, 5}}, {}}));
  EXPECT_TRUE(decodeClientMessage(bytes));
  bytes[10] |= 0x38;  // direction 7
  EXPECT_FALSE(decodeClientMessage(bytes));
}

// A count that promises more keys than there are must be checked before it is believed.
TEST(Message, longListsAreRefused) {
  EXPECT_TRUE(
      decodeClientMessage(encode(ClientMessage(Eviction{std::vector<repository::FaceKey>(kMaxKeysPerMessage), {}}))));
  base::ByteWriter out;
  out.u8(0x03);
  out.u32(0);
  out.u32(static_cast<std::uint32_t>(kMaxKeysPerMessage + 1));
  for (std::size_t i = 0; i <= kMaxKeysPerMessage; ++i) out.u32(0);
  EXPECT_FALSE(decodeClientMessage(out.view()));

  EXPECT_FALSE(decodeClientMessage(base::Bytes{0x04, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF}));
}

TEST(Message, oversizedMessagesAreRefused) {
  EXPECT_FALSE(decodeClientMessage(base::Bytes(kMaxClientMessage + 1, 1)));
  base::Bytes face(kMaxServerMessage + 1, 0);
  face[0] = 0x82;
  EXPECT_FALSE(decodeServerMessage(face));
  face.pop_back();
  EXPECT_TRUE(decodeServerMessage(face));
}

// ---- versions and texts ----

TEST(Message, helloTellsTheCodecsOfFrames) {
  for (const std::uint8_t codecs : {0, 1, 0x81}) {
    auto bytes = encode(ClientMessage(Hello{kVersion, "ab", codecs}));
    const auto decoded = decodeClientMessage(bytes);
    ASSERT_TRUE(decoded) << "flags that mean nothing yet are passed over";
    EXPECT_EQ(std::get<Hello>(*decoded).abilities, codecs);
    bytes.pop_back();
    EXPECT_FALSE(decodeClientMessage(bytes)) << "no byte is optional";
  }
}

TEST(Message, helloOfAnotherVersionTellsItsNumberWhateverFollows) {
  for (const base::Bytes& bytes : {base::Bytes{0x01, 7, 0}, base::Bytes{0x01, 7, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9}}) {
    auto decoded = decodeClientMessage(bytes);
    ASSERT_TRUE(decoded);
    EXPECT_EQ(std::get<Hello>(*decoded).version, 7);
  }
}

TEST(Message, welcomeOfAnotherVersionIsAVersionError) {
  Welcome welcome;
  welcome.version = 9;
  auto decoded = decodeServerMessage(encode(ServerMessage(welcome)));
  ASSERT_FALSE(decoded);
  EXPECT_EQ(decoded.error().code, base::ErrorCode::kVersion);
  EXPECT_NE(decoded.error().message.find('9'), std::string::npos);
}

TEST(Message, aLongUnitIsCutAndOneOnTheWireRefused) {
  Welcome welcome = MessageGenerator(3).welcome();
  welcome.scene_name.clear();
  welcome.units = std::string(99, 'm');
  base::Bytes bytes = encode(ServerMessage(welcome));
  EXPECT_EQ(std::get<Welcome>(*decodeServerMessage(bytes)).units, std::string(kMaxUnits, 'm'));
  bytes[5] = kMaxUnits + 1;  // type, version, empty name, then the unit's length
  EXPECT_FALSE(decodeServerMessage(bytes));
}

TEST(Message, textsNeverCarryControlCharacters) {
  auto decoded = decodeClientMessage(encode(ClientMessage(Hello{kVersion, "evil\nlog\x1B[31m"})));
  ASSERT_TRUE(decoded);
  EXPECT_EQ(std::get<Hello>(*decoded).client, "evil log [31m");
  EXPECT_FALSE(decodeClientMessage(base::Bytes{0x01, kVersion, 0, 1, 0, '\n', 0}));
  EXPECT_EQ(std::get<Hello>(*decodeClientMessage(encode(ClientMessage(Hello{kVersion, std::string(9999, 'x')}))))
                .client.size(),
            kMaxText);
}

}  // namespace
}  // namespace protocol
