#pragma once
// GLES 3.0 objects with owners: the subset that is WebGL2 as well. All of them need a current context and belong to the
// thread that created them. Their storage is counted by kind.
//
// There is at most one context a thread: the counts are the thread's, and contextLost() abandons all of the thread's
// objects.
#include <GLES3/gl3.h>

#include <cstddef>
#include <cstdint>

#include <glm/glm.hpp>
#include <initializer_list>
#include <string>
#include <utility>
#include <vector>

#include "base/error.h"
#include "base/image.h"

namespace base::gl {

/// Bytes of GL storage that this thread's objects have: as requested, without the driver's padding.
struct HeldBytes {
  std::uint64_t textures = 0, buffers = 0, renderbuffers = 0;
  std::uint64_t total() const { return textures + buffers + renderbuffers; }
};
const HeldBytes& heldBytes();
/// Returns the largest total since the thread began, or since resetPeak().
std::uint64_t peakHeldBytes();
void resetPeak();

/// Tells that the thread's context is gone. All objects created before are abandoned: they free nothing and hold
/// nothing, and may only be destroyed.
void contextLost();

namespace detail {
enum class StorageKind : std::uint8_t { kNone, kTexture, kBuffer, kRenderbuffer };
std::uint32_t contextGeneration();  ///< one more after each contextLost()
void addHeld(StorageKind kind, std::uint64_t bytes);
void subtractHeld(StorageKind kind, std::uint64_t bytes);
}  // namespace detail

/// Owns one GL name and the count of its storage; Traits::destroy frees it, Traits::kKind says where it is counted.
template <class Traits>
class Object {
 public:
  Object() = default;
  explicit Object(GLuint name) : name_(name), generation_(detail::contextGeneration()) {}
  Object(Object&& other) noexcept { swap(other); }
  Object& operator=(Object&& other) noexcept {
    swap(other);
    return *this;
  }
  ~Object() {
    if (name_ == 0 || generation_ != detail::contextGeneration()) return;
    detail::subtractHeld(Traits::kKind, bytes_);
    Traits::destroy(name_);
  }
  static Object create() { return Object(Traits::create()); }
  GLuint name() const { return name_; }
  explicit operator bool() const { return name_ != 0; }
  std::uint64_t bytes() const { return bytes_; }
  /// Sets how many bytes the object's storage takes; called by the allocate functions below.
  void setStorageBytes(std::uint64_t bytes) {
    detail::subtractHeld(Traits::kKind, std::exchange(bytes_, bytes));
    detail::addHeld(Traits::kKind, bytes);
  }

 private:
  void swap(Object& other) noexcept {
    std::swap(name_, other.name_);
    std::swap(generation_, other.generation_);
    std::swap(bytes_, other.bytes_);
  }
  GLuint name_ = 0;
  std::uint32_t generation_ = 0;
  std::uint64_t bytes_ = 0;
};

/// Traits of names that GL generates and deletes in arrays.
template <auto Generate, auto Delete, detail::StorageKind Counted>
struct NameTraits {
  static constexpr detail::StorageKind kKind = Counted;
  static GLuint create() {
    GLuint name = 0;
    Generate(1, &name);
    return name;
  }
  static void destroy(GLuint name) { Delete(1, &name); }
};
struct ProgramTraits {
  static constexpr detail::StorageKind kKind = detail::StorageKind::kNone;
  static void destroy(GLuint name);
};
using Buffer = Object<NameTraits<glGenBuffers, glDeleteBuffers, detail::StorageKind::kBuffer>>;
using Texture = Object<NameTraits<glGenTextures, glDeleteTextures, detail::StorageKind::kTexture>>;
using VertexArray = Object<NameTraits<glGenVertexArrays, glDeleteVertexArrays, detail::StorageKind::kNone>>;
using Framebuffer = Object<NameTraits<glGenFramebuffers, glDeleteFramebuffers, detail::StorageKind::kNone>>;
using Renderbuffer = Object<NameTraits<glGenRenderbuffers, glDeleteRenderbuffers, detail::StorageKind::kRenderbuffer>>;
using Query = Object<NameTraits<glGenQueries, glDeleteQueries, detail::StorageKind::kNone>>;

// These functions allocate storage and count it. Each leaves its object bound to the target.

/// glBufferData with `bytes` of `data` (null: undefined contents).
void allocate(Buffer& buffer, GLenum target, const void* data, std::size_t bytes, GLenum usage);
/// glTexStorage2D and 3D; formats: RG8 (2 bytes a pixel), RGBA8, RGBA8UI, R32UI, DEPTH_COMPONENT24 and
/// DEPTH24_STENCIL8 (4), RGBA16F (8), RGBA32F and RGBA32UI (16).
void allocate2D(Texture& texture, GLenum target, int levels, GLenum format, int width, int height);
void allocate3D(Texture& texture, GLenum target, int levels, GLenum format, int width, int height, int layers);
void allocate(Renderbuffer& renderbuffer, GLenum format, int width, int height);
/// A two-dimensional texture of one level that is read without filtering; leaves none bound.
Texture unfilteredTexture(GLenum format, int width, int height);

/// Makes a framebuffer of these colours and, unless it is null, this depth, and leaves it bound. False if the GL
/// refuses. `depth_attachment`: GL_DEPTH_STENCIL_ATTACHMENT for a depth with a stencil.
bool attachTextures(Framebuffer& framebuffer, std::initializer_list<const Texture*> colors, const Texture* depth,
                    GLenum depth_attachment = GL_DEPTH_ATTACHMENT);

/// A triangle over the whole target, for vertex shaders that place its corners by gl_VertexID.
class WholeTarget {
 public:
  static WholeTarget create();
  /// Draws it with the program in use.
  void draw() const;

 private:
  VertexArray no_attributes_;
};

/// A linked program. Uniform locations are queried by name once and kept.
class Program {
 public:
  Program() = default;
  /// Compiles and links sources. They have no #version and precision lines; these are added ("#version 300 es", highp).
  /// The error contains GL's log.
  static Result<Program> link(const std::string& name, const std::string& vertex_source,
                              const std::string& fragment_source);
  void use() const;
  GLint uniform(const char* name) const;  ///< location; −1 if the compiler removed the uniform
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
  void bind() const;  ///< binds it and sets the viewport
  int width() const { return width_; }
  int height() const { return height_; }
  GLuint framebuffer() const { return framebuffer_.name(); }
  /// Waits for drawing and reads RGBA; row 0 is at the top.
  Image read() const;

 private:
  Framebuffer framebuffer_;
  Renderbuffer color_;
  Renderbuffer depth_;
  int width_ = 0;
  int height_ = 0;
};

/// Whether the context draws on the CPU, by the renderer's name: llvmpipe, SwiftShader and the like.
bool drawsInSoftware();

/// Returns GL's errors since the last call as text, empty when none. For tests and set-up, not for the frame loop.
std::string takeError();

}  // namespace base::gl
