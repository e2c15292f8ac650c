#pragma once
// GLES 3.0, the subset that is WebGL2 as well, in owning objects. All need a current context, on the thread that made
// them.
#include <GLES3/gl3.h>

#include <glm/glm.hpp>
#include <string>
#include <utility>
#include <vector>

#include "base/error.h"
#include "base/image.h"

namespace base::gl {

/// Owns one GL name; Traits::destroy frees it.
template <class Traits>
class Object {
 public:
  Object() = default;
  explicit Object(GLuint name) : name_(name) {}
  Object(Object&& other) noexcept : name_(std::exchange(other.name_, 0)) {}
  Object& operator=(Object&& other) noexcept {
    std::swap(name_, other.name_);
    return *this;
  }
  ~Object() {
    if (name_ != 0) Traits::destroy(name_);
  }
  static Object create() { return Object(Traits::create()); }
  GLuint name() const { return name_; }
  explicit operator bool() const { return name_ != 0; }

 private:
  GLuint name_ = 0;
};

/// Names that GL makes and frees by the array.
template <auto Generate, auto Delete>
struct NameTraits {
  static GLuint create() {
    GLuint name = 0;
    Generate(1, &name);
    return name;
  }
  static void destroy(GLuint name) { Delete(1, &name); }
};
struct ProgramTraits {
  static void destroy(GLuint name);
};
using Buffer = Object<NameTraits<glGenBuffers, glDeleteBuffers>>;
using Texture = Object<NameTraits<glGenTextures, glDeleteTextures>>;
using VertexArray = Object<NameTraits<glGenVertexArrays, glDeleteVertexArrays>>;
using Framebuffer = Object<NameTraits<glGenFramebuffers, glDeleteFramebuffers>>;
using Renderbuffer = Object<NameTraits<glGenRenderbuffers, glDeleteRenderbuffers>>;

/// A linked program. Uniform locations are looked up by name once and kept.
class Program {
 public:
  Program() = default;
  /// Sources without #version and precision lines, which are added ("#version 300 es", highp). The error holds GL's
  /// log.
  static Result<Program> link(const std::string& name, const std::string& vertex_source,
                              const std::string& fragment_source);
  void use() const;
  GLint uniform(const char* name) const;  ///< −1 when it was optimised away
  GLuint name() const { return program_.name(); }

 private:
  Object<ProgramTraits> program_;
  mutable std::vector<std::pair<std::string, GLint>> locations_;
};

/// An off-screen target: RGBA8 colour and 24-bit depth.
class RenderTarget {
 public:
  RenderTarget() = default;
  static Result<RenderTarget> create(int width, int height);
  void bind() const;  ///< also sets the viewport
  int width() const { return width_; }
  int height() const { return height_; }
  GLuint framebuffer() const { return framebuffer_.name(); }
  /// Waits for drawing; RGBA, row 0 at the top.
  Image read() const;

 private:
  Framebuffer framebuffer_;
  Renderbuffer color_;
  Renderbuffer depth_;
  int width_ = 0;
  int height_ = 0;
};

/// Error code of GL since the last call as text, empty when none. For tests and after set-up, not in the frame loop.
std::string takeError();

}  // namespace base::gl
