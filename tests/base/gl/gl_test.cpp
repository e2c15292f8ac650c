#include "base/gl/gl.h"

#include <gtest/gtest.h>

#include "base/egl/headless.h"

namespace base::gl {
namespace {

constexpr const char* kVertex = R"(
layout(location = 3) in vec2 corner;
void main() { gl_Position = vec4(corner, 0.0, 1.0); }
)";
constexpr const char* kFragment = R"(
uniform vec4 u_color;
layout(location = 0) out vec4 out_color;
void main() { out_color = u_color; }
)";

class GlTest : public testing::Test {
 protected:
  void SetUp() override {
    auto context = HeadlessContext::create();
    ASSERT_TRUE(context) << context.error().message;
    context_ = std::move(*context);
  }
  void TearDown() override { EXPECT_EQ(takeError(), ""); }

  std::unique_ptr<HeadlessContext> context_;
};

TEST_F(GlTest, programTakesAttributeLocationsFromItsSource) {
  const auto program = Program::link("flat", kVertex, kFragment);
  ASSERT_TRUE(program) << program.error().message;
  EXPECT_EQ(glGetAttribLocation(program->name(), "corner"), 3);
}

TEST_F(GlTest, uniformsAreFoundAgainAndUnknownOnesAreMinusOne) {
  const auto program = Program::link("flat", kVertex, kFragment);
  ASSERT_TRUE(program);
  const GLint location = program->uniform("u_color");
  EXPECT_GE(location, 0);
  EXPECT_EQ(program->uniform("u_color"), location);
  EXPECT_EQ(program->uniform("u_absent"), -1);
  EXPECT_EQ(program->uniform("u_absent"), -1);
}

TEST_F(GlTest, storageIsCountedByKindWhileItsObjectLives) {
  const HeldBytes before = heldBytes();
  const auto grown = [&before](std::uint64_t HeldBytes::*kind) { return heldBytes().*kind - before.*kind; };
  {
    auto buffer = Buffer::create();
    allocate(buffer, GL_ARRAY_BUFFER, nullptr, 1000, GL_STATIC_DRAW);
    EXPECT_EQ(grown(&HeldBytes::buffers), 1000U);
    allocate(buffer, GL_ARRAY_BUFFER, nullptr, 400, GL_STATIC_DRAW);
    EXPECT_EQ(grown(&HeldBytes::buffers), 400U) << "replaced, not added";

    auto texture = Texture::create();
    allocate3D(texture, GL_TEXTURE_2D_ARRAY, 3, GL_RGBA8, 8, 4, 5);
    EXPECT_EQ(grown(&HeldBytes::textures), 4U * 5U * (32U + 8U + 2U));
    auto renderbuffer = Renderbuffer::create();
    allocate(renderbuffer, GL_RGBA32UI, 2, 3);
    EXPECT_EQ(grown(&HeldBytes::renderbuffers), 96U);
    Texture moved = std::move(texture);
    EXPECT_EQ(grown(&HeldBytes::textures), 840U);
    moved = Texture();
    EXPECT_EQ(moved.bytes(), 0U);
  }
  EXPECT_EQ(heldBytes().total(), before.total());
  EXPECT_GE(peakHeldBytes(), before.total() + 400U + 840U + 96U);
}

TEST_F(GlTest, objectsOfALostContextTouchNothingOfTheNext) {
  auto old = Buffer::create();
  allocate(old, GL_ARRAY_BUFFER, nullptr, 1000, GL_STATIC_DRAW);
  contextLost();
  EXPECT_EQ(heldBytes().total(), 0U);
  context_.reset();
  auto context = HeadlessContext::create();
  ASSERT_TRUE(context);
  context_ = std::move(*context);

  // The new context gives out the same names again.
  auto fresh = Buffer::create();
  allocate(fresh, GL_ARRAY_BUFFER, nullptr, 10, GL_STATIC_DRAW);
  EXPECT_EQ(fresh.name(), old.name());
  old = Buffer();
  EXPECT_TRUE(glIsBuffer(fresh.name()));
  EXPECT_EQ(heldBytes().total(), 10U);
}

TEST_F(GlTest, samplersOfEveryKindWeUseNeedNoPrecision) {
  const auto program = Program::link("samplers", kVertex, R"(
uniform sampler2DArray u_images;
uniform sampler2DShadow u_shadow;
uniform sampler2DArrayShadow u_shadows;
layout(location = 0) out vec4 out_color;
void main() {
  out_color = texture(u_images, vec3(0.5)) * texture(u_shadow, vec3(0.5)) * texture(u_shadows, vec4(0.5));
}
)");
  EXPECT_TRUE(program) << program.error().message;
}

TEST_F(GlTest, compileErrorNamesProgramStageAndWhatIsWrong) {
  const auto program = Program::link("broken", kVertex, "void main() { undeclared_thing = 1.0; }");
  ASSERT_FALSE(program);
  const std::string& message = program.error().message;
  EXPECT_NE(message.find("'broken'"), std::string::npos) << message;
  EXPECT_NE(message.find("fragment shader"), std::string::npos) << message;
  EXPECT_NE(message.find("undeclared_thing"), std::string::npos) << message;
  EXPECT_EQ(message.find('\n'), std::string::npos) << message;
}

TEST_F(GlTest, linkErrorNamesProgramAndVarying) {
  // The fragment shader reads what no vertex shader wrote.
  const auto program = Program::link("unmatched", kVertex, R"(
in vec3 v_missing;
layout(location = 0) out vec4 out_color;
void main() { out_color = vec4(v_missing, 1.0); }
)");
  ASSERT_FALSE(program);
  const std::string& message = program.error().message;
  EXPECT_NE(message.find("'unmatched' does not link"), std::string::npos) << message;
  EXPECT_NE(message.find("v_missing"), std::string::npos) << message;
}

// The target has 3 × 2 pixels; the upper left one is red, the lower right one blue.
//   R . .
//   . . B
TEST_F(GlTest, readBackStartsWithTheTopRow) {
  const auto target = RenderTarget::create(3, 2);
  ASSERT_TRUE(target) << target.error().message;
  target->bind();
  glClearColor(0, 0, 0, 0);
  glClear(GL_COLOR_BUFFER_BIT);
  glEnable(GL_SCISSOR_TEST);
  glScissor(0, 1, 1, 1);  // GL counts rows from the bottom
  glClearColor(1, 0, 0, 1);
  glClear(GL_COLOR_BUFFER_BIT);
  glScissor(2, 0, 1, 1);
  glClearColor(0, 0, 1, 1);
  glClear(GL_COLOR_BUFFER_BIT);
  glDisable(GL_SCISSOR_TEST);

  const Image image = target->read();
  const std::vector<std::uint8_t> expected{255, 0, 0, 255, 0, 0, 0, 0, 0, 0, 0,   0,     // top
                                           0,   0, 0, 0,   0, 0, 0, 0, 0, 0, 255, 255};  // bottom
  EXPECT_EQ(image.width, 3);
  EXPECT_EQ(image.height, 2);
  EXPECT_EQ(image.channels, 4);
  EXPECT_EQ(image.pixels, expected);
}

TEST_F(GlTest, targetHasTwentyFourDepthBits) {
  const auto target = RenderTarget::create(4, 4);
  ASSERT_TRUE(target);
  target->bind();
  GLint bits = 0;
  glGetIntegerv(GL_DEPTH_BITS, &bits);
  EXPECT_GE(bits, 24);
}

TEST_F(GlTest, targetLargerThanTheLimitIsAnErrorThatSaysTheLimit) {
  GLint limit = 0;
  glGetIntegerv(GL_MAX_RENDERBUFFER_SIZE, &limit);
  const auto wide = RenderTarget::create(limit + 1, 1);
  ASSERT_FALSE(wide);
  EXPECT_NE(wide.error().message.find(std::to_string(limit)), std::string::npos) << wide.error().message;
  EXPECT_FALSE(RenderTarget::create(0, 4));
}

TEST_F(GlTest, objectsAreFreedOnceWhenMovedAndDestroyed) {
  GLuint name = 0;
  {
    Buffer first = Buffer::create();
    name = first.name();
    glBindBuffer(GL_ARRAY_BUFFER, name);  // a name becomes an object when it is bound
    Buffer second = std::move(first);
    EXPECT_EQ(second.name(), name);
    EXPECT_EQ(glIsBuffer(name), GL_TRUE);
  }
  EXPECT_EQ(glIsBuffer(name), GL_FALSE);
}

TEST_F(GlTest, takeErrorNamesTheErrorAndClearsIt) {
  glEnable(0xFFFF);
  EXPECT_EQ(takeError(), "GL_INVALID_ENUM");
  EXPECT_EQ(takeError(), "");
}

}  // namespace
}  // namespace base::gl
