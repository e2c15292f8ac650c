#include "client/render/pixel_blend.h"

#include <algorithm>
#include <string>
#include <utility>

#include "base/check.h"
#include "base/format_text.h"
#include "client/render/shaders.h"
#include "lod/draw/triangles.h"
#include "lod/draw/view_modes.h"

namespace client {
namespace {

// As blend_pixels_fragment.glsl reads them.
constexpr std::size_t kPatchesARow = 256;
constexpr std::size_t kTexelsAPatch = 3;
constexpr std::size_t kListsARow = 256;
static_assert(kMostCellsAcross < 8, "counts along x and y share a number");

constexpr GLint kDepthTarget = 3;
constexpr GLint kWanted = 1;  ///< in the stencil

constexpr std::uint64_t kSurfaceBytes = 14;  ///< a pixel: colours 4, normals 4, patch 2, depth buffer 4
constexpr std::uint64_t kLayerBytes = 10;    ///< depth 4, images 4, coverage 2

std::size_t rowsFor(std::size_t entries, std::size_t entries_a_row) {
  return std::max<std::size_t>(1, (entries + entries_a_row - 1) / entries_a_row);
}

std::uint8_t byteOf(std::size_t number) {
  return static_cast<std::uint8_t>(number & 255U);
}

/// Writes rows of texels into a texture, which is made anew where it has fewer.
void write(base::gl::Texture& texture, GLenum format, GLenum layout, GLenum type, std::size_t width, std::size_t rows,
           const void* texels) {
  const std::size_t row_bytes = width * (format == GL_RGBA32F ? 16 : 4);
  if (texture.bytes() < row_bytes * rows)
    texture = base::gl::unfilteredTexture(format, static_cast<int>(width), static_cast<int>(rows + rows / 2));
  glBindTexture(GL_TEXTURE_2D, texture.name());
  glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, static_cast<GLsizei>(width), static_cast<GLsizei>(rows), layout, type,
                  texels);
  glBindTexture(GL_TEXTURE_2D, 0);
}

/// Returns the source that blends images by the powers of this tuning, from one array of images or from all.
std::string blendSource(const BlendTuning& tuning, bool one_array) {
  return base::formatText("#define ANGLE_POWER %.8f\n#define VOTE_POWER %.8f\n#define HALF_RESOLUTION_POWER %.8f\n%s",
                          static_cast<double>(tuning.angle_power), static_cast<double>(tuning.vote_power),
                          0.5 * static_cast<double>(tuning.resolution_power), one_array ? "#define ONE_ARRAY\n" : "") +
         glsl::kBlendSamples;
}

std::string viewSource() {
  return lod::draw::shadingSource() + lod::draw::seenNormalSource() + lod::draw::viewModesSource() + glsl::kView;
}

/// Binds textures to texture units from `unit` on, for these samplers of the program in use.
void bind(const base::gl::Program& program, int unit,
          std::initializer_list<std::pair<const char*, const base::gl::Texture&>> textures) {
  for (const auto& [name, texture] : textures) {
    glActiveTexture(GL_TEXTURE0 + static_cast<GLenum>(unit));
    glBindTexture(GL_TEXTURE_2D, texture.name());
    glUniform1i(program.uniform(name), unit++);
  }
  glActiveTexture(GL_TEXTURE0);
}

void setPlace(const base::gl::Program& program, const char* name, std::size_t place) {
  glUniform2f(program.uniform(name), static_cast<float>(place % kPatchesARow) / 255.0F,
              static_cast<float>(place / kPatchesARow) / 255.0F);
}

}  // namespace

void bindSamples(const base::gl::Program& program) {
  const GLuint index = glGetUniformBlockIndex(program.name(), "Samples");
  if (index != GL_INVALID_INDEX) glUniformBlockBinding(program.name(), index, kSamplesBinding);
}

base::Result<base::gl::Program> PixelBlend::linkBlend(const std::string& source) {
  LUMIGRID_ASSIGN_OR_RETURN(
      auto program, base::gl::Program::link("lumigraph pixels", glsl::kWholeVertex,
                                            viewSource() + glsl::kSurfaceCode + source + glsl::kBlendPixelsFragment));
  bindSamples(program);
  return program;
}

bool PixelBlend::chooseBlend(const BlendTuning& tuning, bool one_array) {
  const BlendKey key{tuning.angle_power, tuning.vote_power, tuning.resolution_power, one_array};
  for (blend_ = 0; blend_ < blends_.size(); ++blend_)
    if (blends_[blend_].first == key) return blend().name() != 0;
  auto made = linkBlend(blendSource(tuning, one_array));
  blends_.emplace_back(key, made ? std::move(*made) : base::gl::Program{});  // what was refused is not tried again
  return blend().name() != 0;
}

base::Result<PixelBlend> PixelBlend::create() {
  const std::string view = viewSource();
  PixelBlend result;
  LUMIGRID_ASSIGN_OR_RETURN(result.surface_, base::gl::Program::link("lumigraph surface", glsl::kBlendVertex,
                                                                     view + glsl::kProxySurface + glsl::kSurfaceCode +
                                                                         glsl::kSurfaceFragment));
  LUMIGRID_ASSIGN_OR_RETURN(result.wanted_,
                            base::gl::Program::link("lumigraph wanted", glsl::kWholeVertex, glsl::kWantedFragment));
  LUMIGRID_ASSIGN_OR_RETURN(result.shade_, base::gl::Program::link("lumigraph shaded", glsl::kBlendVertex,
                                                                   view + glsl::kProxySurface + glsl::kShadedFragment));
  LUMIGRID_ASSIGN_OR_RETURN(result.show_, base::gl::Program::link("lumigraph blended", glsl::kBlendVertex,
                                                                  view + glsl::kProxySurface + glsl::kBlendedFragment));
  LUMIGRID_ASSIGN_OR_RETURN(result.picture_,
                            base::gl::Program::link("lumigraph picture", glsl::kWholeVertex,
                                                    view + glsl::kSurfaceCode + glsl::kComposeFragment));
  const BlendTuning usual;
  LUMIGRID_ASSIGN_OR_RETURN(auto blend, linkBlend(blendSource(usual, true)));
  result.blends_.emplace_back(BlendKey{usual.angle_power, usual.vote_power, usual.resolution_power, true},
                              std::move(blend));
  result.whole_ = base::gl::WholeTarget::create();
  return result;
}

std::uint64_t PixelBlend::bytesOf(int width, int height) {
  return (kSurfaceBytes + kLayers * kLayerBytes) * static_cast<std::uint64_t>(width) *
         static_cast<std::uint64_t>(height);
}

std::uint64_t PixelBlend::bytes() const {
  std::uint64_t bytes = patches_.bytes() + cells_.bytes() + lists_.bytes();
  for (const base::gl::Texture* texture : {&color_, &normals_, &patch_, &depth_}) bytes += texture->bytes();
  for (const Layer& layer : layers_) bytes += layer.depth.bytes() + layer.images.bytes() + layer.coverage.bytes();
  return bytes;
}

bool PixelBlend::prepare(int width, int height) {
  if (width == width_ && height == height_) return true;
  layers_ = {};
  for (base::gl::Texture* texture : {&color_, &normals_, &patch_, &depth_}) *texture = {};
  const auto make = [&](GLenum format) { return base::gl::unfilteredTexture(format, width, height); };
  color_ = make(GL_RGBA8);
  normals_ = make(GL_RGBA8);
  patch_ = make(GL_RG8);
  depth_ = make(GL_DEPTH24_STENCIL8);
  GLint bound = 0;
  glGetIntegerv(GL_FRAMEBUFFER_BINDING, &bound);
  bool made = true;
  for (Layer& layer : layers_) {
    layer.depth = make(GL_R32UI);
    layer.images = make(GL_RGBA8);
    layer.coverage = make(GL_RG8);
    made =
        made &&
        base::gl::attachTextures(layer.surface, {&color_, &normals_, &patch_, &layer.depth}, &depth_,
                                 GL_DEPTH_STENCIL_ATTACHMENT) &&
        base::gl::attachTextures(layer.blend, {&layer.images, &layer.coverage}, &depth_, GL_DEPTH_STENCIL_ATTACHMENT);
  }
  glBindFramebuffer(GL_FRAMEBUFFER, static_cast<GLuint>(bound));
  width_ = made ? width : 0, height_ = made ? height : 0;
  return made;
}

void PixelBlend::clearSurface(std::size_t layer) const {
  glBindFramebuffer(GL_FRAMEBUFFER, layers_.at(layer).surface.name());
  glViewport(0, 0, width_, height_);
  // Only depths tell where there is a surface. glClear cannot clear integers.
  const std::array<GLuint, 4> none{};
  glClearBufferuiv(GL_COLOR, kDepthTarget, none.data());
  glClear(GL_DEPTH_BUFFER_BIT | GL_STENCIL_BUFFER_BIT);
}

/// Marks in the stencil the pixels where the layer before wants another, and lets only those be drawn.
void PixelBlend::keepToWanted(const Layer& front, int unit) const {
  wanted_.use();
  bind(wanted_, unit, {{"u_front_coverage", front.coverage}});
  glEnable(GL_STENCIL_TEST);
  glStencilMask(0xFF);
  glStencilFunc(GL_ALWAYS, kWanted, 0xFF);
  glStencilOp(GL_KEEP, GL_KEEP, GL_REPLACE);
  glDisable(GL_DEPTH_TEST);
  glColorMask(GL_FALSE, GL_FALSE, GL_FALSE, GL_FALSE);
  whole_.draw();
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glEnable(GL_DEPTH_TEST);
  // Where it may be written, software GL tests the stencil after shading.
  glStencilFunc(GL_EQUAL, kWanted, 0xFF);
  glStencilMask(0);
  surface_.use();
}

void PixelBlend::beginSurface(std::size_t layer, int unit) const {
  // The first layer does not look at another, but a program's textures must not be its target.
  const Layer& other = layers_.at(layer > 0 ? layer - 1 : 1);
  clearSurface(layer);
  if (layer > 0) keepToWanted(other, unit);
  glUniform1i(surface_.uniform("u_behind"), layer > 0 ? 1 : 0);
  setPlace(surface_, "u_inside", patch_count_);
  bind(surface_, unit, {{"u_front_depth", other.depth}, {"u_front_coverage", other.coverage}});
}

void PixelBlend::setPatch(std::size_t place) const {
  setPlace(surface_, "u_patch", place);
}

void PixelBlend::setLists(std::span<const ProxyError> errors, std::span<const PatchCells> cells) {
  LUMIGRID_CHECK(cells.size() <= kMostPatches && errors.size() == cells.size());
  patch_count_ = cells.size();
  std::vector<std::array<glm::vec4, kTexelsAPatch>> patches;
  std::vector<std::array<std::uint8_t, 4>> begins;  // of a cell's list, three bytes, and its length
  std::vector<std::array<std::uint8_t, 4>> lists;   // four samples a texel
  const std::vector<std::uint32_t>* last = nullptr;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const PatchCells& patch = cells[i];
    patches.push_back({glm::vec4(errors[i].shapeForShader(), errors[i].color, begins.size(), patch.samples),
                       glm::vec4(patch.begin, patch.counts.x + 8 * patch.counts.y),
                       glm::vec4(patch.per_unit, patch.counts.z)});
    for (const std::vector<std::uint32_t>& list : patch.lists) {
      if (last != nullptr && list == *last) {  // neighbours mostly share one
        begins.push_back(begins.back());
        continue;
      }
      const std::size_t begin = lists.size();
      begins.push_back({byteOf(begin), byteOf(begin >> 8U), byteOf(begin >> 16U), byteOf(list.size())});
      lists.resize(begin + rowsFor(list.size(), 4));
      for (std::size_t k = 0; k < list.size(); ++k) lists[begin + k / 4][k % 4] = byteOf(list[k]);
      last = &list;
    }
  }
  // The place after the last patch has an empty list.
  patches.push_back({glm::vec4(0.0F, 0.0F, begins.size(), 0.0F), glm::vec4(0.0F, 0.0F, 0.0F, 9.0F),
                     glm::vec4(0.0F, 0.0F, 0.0F, 1.0F)});
  begins.emplace_back();
  patches.resize(rowsFor(patches.size(), kPatchesARow) * kPatchesARow);
  begins.resize(rowsFor(begins.size(), kListsARow) * kListsARow);
  lists.resize(rowsFor(lists.size(), kListsARow) * kListsARow);
  write(patches_, GL_RGBA32F, GL_RGBA, GL_FLOAT, kTexelsAPatch * kPatchesARow, patches.size() / kPatchesARow,
        patches.data());
  write(cells_, GL_RGBA8UI, GL_RGBA_INTEGER, GL_UNSIGNED_BYTE, kListsARow, begins.size() / kListsARow, begins.data());
  write(lists_, GL_RGBA8UI, GL_RGBA_INTEGER, GL_UNSIGNED_BYTE, kListsARow, lists.size() / kListsARow, lists.data());
}

void PixelBlend::blendPixels(std::size_t layer, int unit) const {
  const Layer& blended = layers_.at(layer);
  bind(blend(), unit,
       {{"u_surface_depth", blended.depth},
        {"u_surface_color", color_},
        {"u_surface_normals", normals_},
        {"u_surface_patch", patch_},
        {"u_patches", patches_},
        {"u_cells", cells_},
        {"u_lists", lists_}});
  glBindFramebuffer(GL_FRAMEBUFFER, blended.blend.name());
  glViewport(0, 0, width_, height_);
  const std::array<GLfloat, 4> no_images{}, covered{1.0F, 0.0F, 0.0F, 0.0F};
  glClearBufferfv(GL_COLOR, 0, no_images.data());
  glClearBufferfv(GL_COLOR, 1, covered.data());
  // The triangle lies on the far plane, so only pixels with a surface are nearer. A test in the shader would save
  // nothing on software GL, which runs either way of a branch.
  glDepthFunc(GL_GREATER);
  glDepthMask(GL_FALSE);
  whole_.draw();
  glDepthMask(GL_TRUE);
  glDepthFunc(GL_LESS);
  glDisable(GL_STENCIL_TEST);
  glStencilMask(0xFF);
}

void PixelBlend::compose(std::size_t layer, int unit) const {
  const Layer& blended = layers_.at(layer);
  bind(picture_, unit,
       {{"u_layer_depth", blended.depth},
        {"u_surface_color", color_},
        {"u_surface_normals", normals_},
        {"u_layer_color", blended.images},
        {"u_layer_coverage", blended.coverage}});
  glViewport(0, 0, width_, height_);
  whole_.draw();
}

void PixelBlend::setResult(int unit) const {
  const Layer& front = layers_.front();
  const Layer& back = layers_.back();
  bind(show_, unit,
       {{"u_front_depth", front.depth},
        {"u_front_color", front.images},
        {"u_front_coverage", front.coverage},
        {"u_back_depth", back.depth},
        {"u_back_color", back.images},
        {"u_back_coverage", back.coverage}});
}

}  // namespace client
