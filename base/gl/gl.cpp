#include "base/gl/gl.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <string_view>

namespace base::gl {
namespace {

// Gives types a precision that GLSL ES 3.00 leaves without a default, so that sources need no preamble; "#line 1" makes
// the line numbers in GL's log those of the source.
constexpr const char* kPreamble =
    "#version 300 es\n"
    "precision highp float;\n"
    "precision highp int;\n"
    "precision highp sampler2D;\n"
    "precision highp sampler2DArray;\n"
    "precision highp sampler2DShadow;\n"
    "precision highp sampler2DArrayShadow;\n"
    "precision highp usampler2D;\n"
    "precision highp usampler2DArray;\n"
    "#line 1\n";

struct ShaderTraits {
  static constexpr detail::StorageKind kKind = detail::StorageKind::kNone;
  static void destroy(GLuint name) { glDeleteShader(name); }
};
using Shader = Object<ShaderTraits>;

// Returns GL's log as one line, since errors are one line each here.
std::string oneLine(std::string log) {
  while (!log.empty() && (log.back() == '\0' || log.back() == '\n' || log.back() == ' ')) log.pop_back();
  std::replace(log.begin(), log.end(), '\n', ' ');
  return log;
}

template <auto GetParameter, auto GetLog>
std::string logOf(GLuint name) {
  GLint length = 0;
  GetParameter(name, GL_INFO_LOG_LENGTH, &length);
  std::string log(static_cast<std::size_t>(std::max(0, length)), '\0');
  if (length > 0) GetLog(name, length, nullptr, log.data());
  return oneLine(std::move(log));
}

Result<Shader> compile(const std::string& place, GLenum stage, const std::string& source) {
  Shader shader(glCreateShader(stage));
  if (!shader)
    return Error{ErrorCode::kUnsupported, place + ": GL gave no shader object; is a context current on this thread?"};
  const char* parts[] = {kPreamble, source.c_str()};
  glShaderSource(shader.name(), 2, parts, nullptr);
  glCompileShader(shader.name());
  GLint compiled = GL_FALSE;
  glGetShaderiv(shader.name(), GL_COMPILE_STATUS, &compiled);
  if (compiled != GL_TRUE)
    return Error{ErrorCode::kInvalidInput,
                 place + " does not compile: " + logOf<glGetShaderiv, glGetShaderInfoLog>(shader.name())};
  return shader;
}

}  // namespace

// ---- Counts of storage ----

namespace {

struct Held {
  HeldBytes bytes;
  std::uint64_t peak = 0;
  std::uint32_t generation = 0;
};
thread_local Held held;

std::uint64_t* counterOf(detail::StorageKind kind) {
  if (kind == detail::StorageKind::kTexture) return &held.bytes.textures;
  if (kind == detail::StorageKind::kBuffer) return &held.bytes.buffers;
  if (kind == detail::StorageKind::kRenderbuffer) return &held.bytes.renderbuffers;
  return nullptr;
}

std::uint64_t bytesOf(GLenum format, int width, int height) {
  std::uint64_t pixel = 4;
  if (format == GL_RGBA32UI || format == GL_RGBA32F) pixel = 16;
  if (format == GL_RGBA16F) pixel = 8;
  if (format == GL_RG8) pixel = 2;
  return pixel * static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height);
}

std::uint64_t bytesOfLevels(int levels, GLenum format, int width, int height) {
  std::uint64_t bytes = 0;
  for (int level = 0; level < levels; ++level)
    bytes += bytesOf(format, std::max(1, width >> level), std::max(1, height >> level));
  return bytes;
}

}  // namespace

const HeldBytes& heldBytes() {
  return held.bytes;
}
std::uint64_t peakHeldBytes() {
  return held.peak;
}
void resetPeak() {
  held.peak = held.bytes.total();
}

void contextLost() {
  ++held.generation;
  held.bytes = {};
}

std::uint32_t detail::contextGeneration() {
  return held.generation;
}

void detail::addHeld(StorageKind kind, std::uint64_t bytes) {
  if (std::uint64_t* counter = counterOf(kind)) *counter += bytes;
  held.peak = std::max(held.peak, held.bytes.total());
}

void detail::subtractHeld(StorageKind kind, std::uint64_t bytes) {
  if (std::uint64_t* counter = counterOf(kind)) *counter -= bytes;
}

void allocate(Buffer& buffer, GLenum target, const void* data, std::size_t bytes, GLenum usage) {
  glBindBuffer(target, buffer.name());
  glBufferData(target, static_cast<GLsizeiptr>(bytes), data, usage);
  buffer.setStorageBytes(bytes);
}

void allocate2D(Texture& texture, GLenum target, int levels, GLenum format, int width, int height) {
  glBindTexture(target, texture.name());
  glTexStorage2D(target, levels, format, width, height);
  texture.setStorageBytes(bytesOfLevels(levels, format, width, height));
}

void allocate3D(Texture& texture, GLenum target, int levels, GLenum format, int width, int height, int layers) {
  glBindTexture(target, texture.name());
  glTexStorage3D(target, levels, format, width, height, layers);
  texture.setStorageBytes(bytesOfLevels(levels, format, width, height) * static_cast<std::uint64_t>(layers));
}

void allocate(Renderbuffer& renderbuffer, GLenum format, int width, int height) {
  glBindRenderbuffer(GL_RENDERBUFFER, renderbuffer.name());
  glRenderbufferStorage(GL_RENDERBUFFER, format, width, height);
  renderbuffer.setStorageBytes(bytesOf(format, width, height));
}

Texture unfilteredTexture(GLenum format, int width, int height) {
  Texture texture = Texture::create();
  allocate2D(texture, GL_TEXTURE_2D, 1, format, width, height);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  glBindTexture(GL_TEXTURE_2D, 0);
  return texture;
}

bool attachTextures(Framebuffer& framebuffer, std::initializer_list<const Texture*> colors, const Texture* depth,
                    GLenum depth_attachment) {
  framebuffer = Framebuffer::create();
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer.name());
  std::vector<GLenum> attachments;
  for (const Texture* color : colors) {
    attachments.push_back(GL_COLOR_ATTACHMENT0 + static_cast<GLenum>(attachments.size()));
    glFramebufferTexture2D(GL_FRAMEBUFFER, attachments.back(), GL_TEXTURE_2D, color->name(), 0);
  }
  if (depth != nullptr) glFramebufferTexture2D(GL_FRAMEBUFFER, depth_attachment, GL_TEXTURE_2D, depth->name(), 0);
  glDrawBuffers(static_cast<GLsizei>(attachments.size()), attachments.data());
  return glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
}

WholeTarget WholeTarget::create() {
  WholeTarget target;
  target.no_attributes_ = VertexArray::create();
  return target;
}

void WholeTarget::draw() const {
  glBindVertexArray(no_attributes_.name());
  glDrawArrays(GL_TRIANGLES, 0, 3);
  glBindVertexArray(0);
}

// ---- Objects ----

void ProgramTraits::destroy(GLuint name) {
  glDeleteProgram(name);
}

// ---- Program ----

Result<Program> Program::link(const std::string& name, const std::string& vertex_source,
                              const std::string& fragment_source) {
  LUMIGRID_ASSIGN_OR_RETURN(auto vertex,
                            compile("GL program '" + name + "': vertex shader", GL_VERTEX_SHADER, vertex_source));
  LUMIGRID_ASSIGN_OR_RETURN(auto fragment,
                            compile("GL program '" + name + "': fragment shader", GL_FRAGMENT_SHADER, fragment_source));

  Program program;
  program.program_ = Object<ProgramTraits>(glCreateProgram());
  glAttachShader(program.name(), vertex.name());
  glAttachShader(program.name(), fragment.name());
  glLinkProgram(program.name());
  GLint linked = GL_FALSE;
  glGetProgramiv(program.name(), GL_LINK_STATUS, &linked);
  if (linked != GL_TRUE)
    return Error{ErrorCode::kInvalidInput, "GL program '" + name + "' does not link: " +
                                               logOf<glGetProgramiv, glGetProgramInfoLog>(program.name())};
  return program;
}

void Program::use() const {
  glUseProgram(program_.name());
}

GLint Program::uniform(const char* name) const {
  for (const auto& [known, location] : locations_)
    if (known == name) return location;
  const GLint location = glGetUniformLocation(program_.name(), name);
  locations_.emplace_back(name, location);
  return location;
}

// ---- RenderTarget ----

Result<RenderTarget> RenderTarget::create(int width, int height) {
  GLint limit = 0;
  glGetIntegerv(GL_MAX_RENDERBUFFER_SIZE, &limit);
  const std::string size = std::to_string(width) + " x " + std::to_string(height);
  if (width < 1 || height < 1 || width > limit || height > limit)
    return Error{ErrorCode::kUnsupported, "render target of " + size + " pixels: each side must be 1 to " +
                                              std::to_string(limit) + " here; draw the picture in tiles"};

  RenderTarget target;
  target.width_ = width;
  target.height_ = height;
  target.color_ = Renderbuffer::create();
  allocate(target.color_, GL_RGBA8, width, height);
  target.depth_ = Renderbuffer::create();
  allocate(target.depth_, GL_DEPTH_COMPONENT24, width, height);
  glBindRenderbuffer(GL_RENDERBUFFER, 0);

  target.framebuffer_ = Framebuffer::create();
  glBindFramebuffer(GL_FRAMEBUFFER, target.framebuffer_.name());
  glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, target.color_.name());
  glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, target.depth_.name());
  if (glCheckFramebufferStatus(GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE)
    return Error{ErrorCode::kNoSpace, "render target of " + size + " pixels: the GL refuses it (" + takeError() +
                                          "); use a smaller picture or free GPU memory"};
  return target;
}

void RenderTarget::bind() const {
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_.name());
  glViewport(0, 0, width_, height_);
}

Image RenderTarget::read() const {
  Image image(width_, height_, 4);
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_.name());
  glPixelStorei(GL_PACK_ALIGNMENT, 4);
  glReadPixels(0, 0, width_, height_, GL_RGBA, GL_UNSIGNED_BYTE, image.pixels.data());

  // GL's first row is the bottom one; ours is the top one.
  const std::size_t row = static_cast<std::size_t>(width_) * 4;
  for (int y = 0; y < height_ / 2; ++y)
    std::swap_ranges(image.at(0, y), image.at(0, y) + row, image.at(0, height_ - 1 - y));
  return image;
}

bool drawsInSoftware() {
#ifdef __EMSCRIPTEN__
  constexpr GLenum kRenderer = 0x9246;  // UNMASKED_RENDERER_WEBGL, since browsers hide the name otherwise
#else
  constexpr GLenum kRenderer = GL_RENDERER;
#endif
  const GLubyte* text = glGetString(kRenderer);
  const std::string_view renderer = text == nullptr ? "" : reinterpret_cast<const char*>(text);
  constexpr std::array<std::string_view, 4> kSoftware{"llvmpipe", "softpipe", "SwiftShader", "Basic Render"};
  return std::any_of(kSoftware.begin(), kSoftware.end(),
                     [&](std::string_view name) { return renderer.find(name) != std::string_view::npos; });
}

std::string takeError() {
  constexpr std::pair<GLenum, const char*> kNames[] = {
      {GL_INVALID_ENUM, "GL_INVALID_ENUM"},
      {GL_INVALID_VALUE, "GL_INVALID_VALUE"},
      {GL_INVALID_OPERATION, "GL_INVALID_OPERATION"},
      {GL_INVALID_FRAMEBUFFER_OPERATION, "GL_INVALID_FRAMEBUFFER_OPERATION"},
      {GL_OUT_OF_MEMORY, "GL_OUT_OF_MEMORY"}};
  std::string text;
  // A lost context may report errors for ever; a handful is enough.
  for (int i = 0; i < 8; ++i) {
    const GLenum code = glGetError();
    if (code == GL_NO_ERROR) break;
    if (!text.empty()) text += ", ";
    const auto* known = std::find_if(std::begin(kNames), std::end(kNames), [&](auto& n) { return n.first == code; });
    text += known != std::end(kNames) ? known->second : "GL error " + std::to_string(code);
  }
  return text;
}

}  // namespace base::gl
