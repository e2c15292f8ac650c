#include "server/render/sample_target.h"

#include <algorithm>
#include <array>

#include "server/render/shaders.h"

namespace server {
namespace {

bool complete() {
  return glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
}

}  // namespace

base::Result<ResolvePass> ResolvePass::create() {
  ResolvePass pass;
  for (std::size_t i = 0; i < kOwnPrograms.size(); ++i) {
    const std::string defines = "#define SUPERSAMPLING " + std::to_string(kOwnPrograms[i]) + "\n";
    LUMIGRID_ASSIGN_OR_RETURN(
        pass.own_[i], base::gl::Program::link("resolve", glsl::kResolveVertex, defines + glsl::kResolveFragment));
  }
  LUMIGRID_ASSIGN_OR_RETURN(pass.any_,
                            base::gl::Program::link("resolve", glsl::kResolveVertex,
                                                    std::string("uniform int u_supersampling;\n#define SUPERSAMPLING "
                                                                "u_supersampling\n") +
                                                        glsl::kResolveFragment));
  pass.whole_ = base::gl::WholeTarget::create();
  return pass;
}

void ResolvePass::run(GLuint samples, int supersampling) const {
  glDisable(GL_DEPTH_TEST);
  glActiveTexture(GL_TEXTURE0);
  glBindTexture(GL_TEXTURE_2D, samples);
  const auto own = std::find(kOwnPrograms.begin(), kOwnPrograms.end(), supersampling);
  const base::gl::Program& program =
      own == kOwnPrograms.end() ? any_ : own_[static_cast<std::size_t>(own - kOwnPrograms.begin())];
  program.use();
  glUniform1i(program.uniform("u_samples"), 0);
  if (own == kOwnPrograms.end()) glUniform1i(program.uniform("u_supersampling"), supersampling);
  whole_.draw();
  glBindTexture(GL_TEXTURE_2D, 0);
}

int SampleTarget::maxSide() {
  GLint texture = 0;
  GLint renderbuffer = 0;
  std::array<GLint, 2> viewport{};
  glGetIntegerv(GL_MAX_TEXTURE_SIZE, &texture);
  glGetIntegerv(GL_MAX_RENDERBUFFER_SIZE, &renderbuffer);
  glGetIntegerv(GL_MAX_VIEWPORT_DIMS, viewport.data());
  return std::min({texture, renderbuffer, viewport[0], viewport[1]});
}

base::Result<void> SampleTarget::fit(int width, int height, int supersampling) {
  if (width_ == width && height_ == height && supersampling_ == supersampling) return {};
  *this = {};
  LUMIGRID_ASSIGN_OR_RETURN(*this, create(width, height, supersampling));
  return {};
}

base::Result<SampleTarget> SampleTarget::create(int width, int height, int supersampling) {
  SampleTarget target;
  target.width_ = width;
  target.height_ = height;
  target.supersampling_ = supersampling;
  const int sample_width = width * supersampling;
  const int sample_height = height * supersampling;

  // The samples are in a texture, since the resolve pass reads it.
  target.samples_ = base::gl::unfilteredTexture(GL_RGBA8, sample_width, sample_height);
  target.depth_ = base::gl::Renderbuffer::create();
  base::gl::allocate(target.depth_, GL_DEPTH_COMPONENT24, sample_width, sample_height);
  target.framebuffer_ = base::gl::Framebuffer::create();
  glBindFramebuffer(GL_FRAMEBUFFER, target.framebuffer_.name());
  glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, target.samples_.name(), 0);
  glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, target.depth_.name());
  bool good = complete();

  // The averaged pixels have a framebuffer of their own.
  if (supersampling > 1) {
    target.resolved_ = base::gl::Renderbuffer::create();
    base::gl::allocate(target.resolved_, GL_RGBA8, width, height);
    target.resolved_framebuffer_ = base::gl::Framebuffer::create();
    glBindFramebuffer(GL_FRAMEBUFFER, target.resolved_framebuffer_.name());
    glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, target.resolved_.name());
    good = good && complete();
  }
  glBindRenderbuffer(GL_RENDERBUFFER, 0);
  if (!good)
    return base::Error{base::ErrorCode::kNoSpace, "the GL refuses a render target of " + std::to_string(sample_width) +
                                                      " x " + std::to_string(sample_height) + " samples (" +
                                                      base::gl::takeError() +
                                                      "); use less supersampling or a smaller picture"};
  return target;
}

void SampleTarget::resume() const {
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_.name());
  glViewport(0, 0, width_ * supersampling_, height_ * supersampling_);
}

void SampleTarget::begin() const {
  resume();
  glClearColor(0.0F, 0.0F, 0.0F, 0.0F);
  glClearDepthf(1.0F);
  glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
}

GLuint SampleTarget::resolve(const ResolvePass& pass, const Tile& part) const {
  if (supersampling_ == 1) return framebuffer_.name();
  glBindFramebuffer(GL_FRAMEBUFFER, resolved_framebuffer_.name());
  glViewport(0, 0, width_, height_);
  glEnable(GL_SCISSOR_TEST);
  glScissor(part.x, height_ - part.y - part.height, part.width, part.height);
  pass.run(samples_.name(), supersampling_);
  glDisable(GL_SCISSOR_TEST);
  return resolved_framebuffer_.name();
}

}  // namespace server
