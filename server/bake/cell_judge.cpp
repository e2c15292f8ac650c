#include "server/bake/cell_judge.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <list>
#include <set>
#include <unordered_map>
#include <utility>
#include <vector>

#include "base/gl/gl.h"
#include "client/render/lumigraph.h"
#include "lod/patch/traverse.h"
#include "repository/faces/face_image.h"
#include "repository/sampling/cube_face.h"

namespace server {
namespace {

constexpr client::SampleId kNotStored = client::SampleId{1} << 63;  // no face key has this bit
// Lines over twice the tangent of half the angle: pixels per unit at distance 1 of a view of 720 lines and 45°.
const float kUsualView = 720.0F / (2.0F * std::tan(0.125F * 3.14159265F));

}  // namespace

struct CellJudge::State {
  const lod::patch::PatchFile& patches;
  const repository::Store& store;
  const repository::Grid& grid;
  JudgeOptions options;
  lod::draw::Shading shading;
  std::unique_ptr<client::LumigraphRenderer> lumigraph;
  base::gl::RenderTarget target;

  // Images on the GPU, and faces that are not stored or see nothing; by last use.
  struct Face {
    bool image = false;
    std::list<std::uint64_t>::iterator age;
  };
  std::unordered_map<std::uint64_t, Face> faces;
  std::list<std::uint64_t> by_age;  // oldest first
  std::set<std::uint32_t> uploaded;

  base::Result<void> bringPatches(const std::vector<std::uint32_t>& cut);
  base::Result<bool> bringFace(const repository::FaceKey& key, const base::DepthRange& depth);
  base::Result<bool> addImage(const repository::FaceKey& key, const base::Image& rgba, const base::DepthRange& depth);
  bool dropOldest(std::size_t keep);
  std::vector<base::Camera> viewsFrom(SceneRenderer& renderer, const glm::vec3& eye, int size) const;
  base::Result<std::vector<base::Image>> truthOf(SceneRenderer& renderer, const std::vector<base::Camera>& views) const;
  base::Result<lod::patch::Cut> bringProxy(SceneRenderer& renderer, const base::Camera& view);
  base::Result<std::vector<client::SampleId>> bringFaces(SceneRenderer& renderer, std::span<const glm::uvec3> points);
  base::Result<base::PictureError> blend(const std::vector<base::Camera>& views, const std::vector<base::Image>& truth,
                                         const lod::patch::Cut& cut, const std::vector<client::SampleId>& images);
  std::size_t in_use = 0;  // the newest so many belong to the cell at hand
};

CellJudge::~CellJudge() = default;

base::Result<std::unique_ptr<CellJudge>> CellJudge::create(const base::Scene& scene,
                                                           const lod::patch::PatchFile& patches,
                                                           const repository::Store& store, const repository::Grid& grid,
                                                           const JudgeOptions& options) {
  LUMIGRID_ASSIGN_OR_RETURN(
      auto lumigraph, client::LumigraphRenderer::create(patches.hierarchy().lattice, static_cast<int>(grid.face_size),
                                                        options.gpu_budget_bytes));
  LUMIGRID_ASSIGN_OR_RETURN(auto target, base::gl::RenderTarget::create(options.view_size, options.view_size));
  std::unique_ptr<CellJudge> judge(new CellJudge);
  judge->state_.reset(new State{patches,
                                store,
                                grid,
                                options,
                                {scene.light.mode == base::LightMode::kUnlit, scene.light.direction},
                                std::move(lumigraph),
                                std::move(target),
                                {},
                                {},
                                {}});
  return judge;
}

base::Result<void> CellJudge::State::bringPatches(const std::vector<std::uint32_t>& cut) {
  const std::set<std::uint32_t> wanted(cut.begin(), cut.end());
  std::vector<std::uint32_t> gone;
  std::set_difference(uploaded.begin(), uploaded.end(), wanted.begin(), wanted.end(), std::back_inserter(gone));
  for (const std::uint32_t patch : gone) {
    lumigraph->patches().remove(patch);
    uploaded.erase(patch);
  }
  for (const std::uint32_t patch : wanted) {
    if (uploaded.count(patch) != 0) continue;
    LUMIGRID_ASSIGN_OR_RETURN(auto geometry, patches.geometry(patch));
    lumigraph->patches().upload(patch, geometry);
    uploaded.insert(patch);
  }
  return {};
}

bool CellJudge::State::dropOldest(std::size_t keep) {
  if (by_age.size() <= keep) return false;
  const std::uint64_t code = by_age.front();
  by_age.pop_front();
  if (faces[code].image) lumigraph->removeSample(code);
  faces.erase(code);
  return true;
}

// Onto the GPU, in the place of older ones where it is full. False: no room even so.
base::Result<bool> CellJudge::State::addImage(const repository::FaceKey& key, const base::Image& rgba,
                                              const base::DepthRange& depth) {
  const base::Camera camera = repository::faceCamera(grid, key, depth.near_plane, depth.far_plane);
  while (!lumigraph->addSample(key.code(), camera, rgba, 0.0))
    if (!dropOldest(in_use)) return false;
  return true;
}

// Whether the face has an image to blend.
base::Result<bool> CellJudge::State::bringFace(const repository::FaceKey& key, const base::DepthRange& depth) {
  const std::uint64_t code = key.code();
  ++in_use;
  if (const auto found = faces.find(code); found != faces.end()) {
    by_age.splice(by_age.end(), by_age, found->second.age);
    return found->second.image;
  }
  LUMIGRID_ASSIGN_OR_RETURN(auto value, store.get(key));
  bool image = false;
  if (value) {
    LUMIGRID_ASSIGN_OR_RETURN(auto rgba, repository::decodeFaceImage(*value, static_cast<int>(grid.face_size)));
    if (!rgba.empty()) {
      LUMIGRID_ASSIGN_OR_RETURN(auto added, addImage(key, rgba, depth));
      image = added;
    }
  }
  by_age.push_back(code);
  faces[code] = {image, std::prev(by_age.end())};
  return image;
}

// The six views of a place.
std::vector<base::Camera> CellJudge::State::viewsFrom(SceneRenderer& renderer, const glm::vec3& eye, int size) const {
  repository::Grid here;  // whose first point it is
  here.first = eye;
  here.spacing = grid.spacing;
  here.count = glm::uvec3(2);
  here.face_size = static_cast<std::uint32_t>(size);
  const base::DepthRange range = base::depthRangeFor(eye, renderer.sceneCenter(), renderer.sceneRadius());
  std::vector<base::Camera> views;
  for (std::uint32_t d = 0; d < 6; ++d)
    views.push_back(repository::faceCamera(here, {0, 0, 0, d}, range.near_plane, range.far_plane));
  return views;
}

base::Result<std::vector<base::Image>> CellJudge::State::truthOf(SceneRenderer& renderer,
                                                                 const std::vector<base::Camera>& views) const {
  std::vector<base::Image> truth(views.size());
  LUMIGRID_TRY(renderer.renderMany(
      views, options.truth, [&](std::size_t i, RenderedPicture rendered) { truth[i] = std::move(rendered.rgba); }));
  LUMIGRID_TRY(renderer.finish());
  return truth;
}

// The proxy that a client has at the place of these views.
base::Result<lod::patch::Cut> CellJudge::State::bringProxy(SceneRenderer& renderer, const base::Camera& view) {
  lod::patch::CutRequest request;
  request.camera = view;
  request.near_plane = base::depthRangeFor(view.eye, renderer.sceneCenter(), renderer.sceneRadius()).near_plane;
  request.tolerance_px = options.proxy_px * view.pixelsPerUnitAtOne() / kUsualView;
  request.cull = false;
  lod::patch::Cut cut = lod::patch::selectCut(patches.hierarchy(), request);
  LUMIGRID_TRY(bringPatches(cut.patches));
  return cut;
}

base::Result<std::vector<client::SampleId>> CellJudge::State::bringFaces(SceneRenderer& renderer,
                                                                         std::span<const glm::uvec3> points) {
  std::vector<client::SampleId> images;
  in_use = 0;
  for (const glm::uvec3& p : points) {
    const base::DepthRange depth =
        base::depthRangeFor(grid.point(p.x, p.y, p.z), renderer.sceneCenter(), renderer.sceneRadius());
    for (std::uint32_t d = 0; d < 6; ++d) {
      const repository::FaceKey key{p.x, p.y, p.z, d};
      LUMIGRID_ASSIGN_OR_RETURN(auto image, bringFace(key, depth));
      if (image) images.push_back(key.code());
    }
  }
  return images;
}

base::Result<base::PictureError> CellJudge::State::blend(const std::vector<base::Camera>& views,
                                                         const std::vector<base::Image>& truth,
                                                         const lod::patch::Cut& cut,
                                                         const std::vector<client::SampleId>& images) {
  client::LumigraphOptions blend;
  blend.max_samples = options.max_samples;
  blend.fade_seconds = 0.0F;
  blend.use_images = !images.empty();
  base::PictureError error;
  for (std::size_t d = 0; d < views.size(); ++d) {
    const base::Frustum frustum(views[d].clipFromScene());
    std::vector<std::uint32_t> in_view;
    for (const std::uint32_t patch : cut.patches)
      if (frustum.mayOverlap(lumigraph->patches().box(patch))) in_view.push_back(patch);
    target.bind();
    lumigraph->draw(views[d], in_view, images, cut.error_px, shading, blend, 0.0, cut.patches);
    error.add(base::pictureError(truth[d], target.read()));
  }
  if (const std::string fault = base::gl::takeError(); !fault.empty())
    return base::Error{base::ErrorCode::kIo, "blending a held-out view: " + fault};
  return error;
}

base::Result<base::PictureError> CellJudge::judge(SceneRenderer& renderer, const glm::vec3& eye,
                                                  std::span<const glm::uvec3> points) {
  State& s = *state_;
  const auto views = s.viewsFrom(renderer, eye, s.options.view_size);
  LUMIGRID_ASSIGN_OR_RETURN(const auto truth, s.truthOf(renderer, views));
  LUMIGRID_ASSIGN_OR_RETURN(const auto cut, s.bringProxy(renderer, views.front()));
  LUMIGRID_ASSIGN_OR_RETURN(const auto images, s.bringFaces(renderer, points));
  return s.blend(views, truth, cut, images);
}

base::Result<std::pair<base::PictureError, base::PictureError>> CellJudge::judgeWith(SceneRenderer& renderer,
                                                                                     const glm::vec3& eye,
                                                                                     std::span<const glm::uvec3> points,
                                                                                     const glm::vec3& another) {
  State& s = *state_;
  const auto views = s.viewsFrom(renderer, eye, s.options.view_size);
  LUMIGRID_ASSIGN_OR_RETURN(const auto truth, s.truthOf(renderer, views));
  const auto faces = s.viewsFrom(renderer, another, static_cast<int>(s.grid.face_size));
  LUMIGRID_ASSIGN_OR_RETURN(const auto pictures, s.truthOf(renderer, faces));
  LUMIGRID_ASSIGN_OR_RETURN(const auto cut, s.bringProxy(renderer, views.front()));
  LUMIGRID_ASSIGN_OR_RETURN(auto images, s.bringFaces(renderer, points));
  LUMIGRID_ASSIGN_OR_RETURN(const auto without, s.blend(views, truth, cut, images));

  for (std::size_t d = 0; d < faces.size(); ++d) {
    const client::SampleId id = kNotStored | d;
    while (!s.lumigraph->addSample(id, faces[d], pictures[d], 0.0))
      if (!s.dropOldest(s.in_use)) break;
    images.push_back(id);
  }
  const auto with = s.blend(views, truth, cut, images);
  for (std::size_t d = 0; d < faces.size(); ++d) s.lumigraph->removeSample(kNotStored | d);
  if (!with) return with.error();
  return std::pair(without, *with);
}

}  // namespace server
