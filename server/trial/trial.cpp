#include "server/trial/trial.h"

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "base/egl/headless.h"
#include "base/picture_error.h"
#include "lod/patch/proxy_sight.h"
#include "protocol/welcome.h"
#include "server/bake/draw_memory.h"
#include "server/bake/face_encoder.h"
#include "server/bake/face_sample.h"
#include "server/trial/direct_viewer.h"
#include "server/trial/drawn_store.h"
#include "server/trial/own_context.h"
#include "server/views/camera_paths.h"
#include "server/views/indoors.h"
#include "server/views/random_views.h"

namespace server {
namespace {

using base::Result;

constexpr std::uint32_t kSeed = 4711;  // gives other views than those of comparisons, whose seed is 1 by default
constexpr int kViewsOfPath = 2;        // a choice: ten views take a tenth of a minute on software GL
constexpr const char* kPaths[] = {"orbit", "approach", "walk", "inspection", "teleports"};
constexpr int kTruthSamples = 4;  // along each side of a pixel, as comparisons have

Result<std::vector<base::ViewCamera>> heldOutViews(const base::Scene& scene, const lod::patch::PatchFile& patches) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto rooms, Indoors::ofScene(scene, patches));
  PathOptions options;
  options.seed = kSeed;
  UnitRandom random(kSeed);
  std::vector<base::ViewCamera> views;
  for (const char* name : kPaths) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto path, makePath(name, scene, options, rooms ? &*rooms : nullptr));
    for (int i = 0; i < kViewsOfPath; ++i) views.push_back(path.at(path.seconds() * (i + random()) / kViewsOfPath));
  }
  return views;
}

struct JudgedView {
  base::ViewCamera camera;
  base::Image truth;
};

class Trials {
 public:
  Trials(const base::Scene& scene, const lod::patch::PatchFile& patches, const BakeOptions& options,
         const std::function<bool(double)>& progress)
      : scene_(scene), patches_(patches), options_(options), progress_(progress) {}

  Result<Trial> run() {
    LUMIGRID_TRY(checkBakeOptions(options_));
    LUMIGRID_ASSIGN_OR_RETURN(const auto drawing, base::HeadlessContext::create());
    LUMIGRID_ASSIGN_OR_RETURN(auto renderer, createRenderer());
    LUMIGRID_ASSIGN_OR_RETURN(const auto viewing, base::HeadlessContext::create());
    OwnContext gl(*drawing, *viewing);
    auto result = tryBoth(*renderer, gl);
    drawing->makeCurrent();
    renderer.reset();
    return result;
  }

 private:
  Result<std::unique_ptr<SceneRenderer>> createRenderer() const {
    constexpr std::uint64_t kViewerBytes = 1'000'000'000;  // ViewerOptions::memory_budget_bytes
    LUMIGRID_ASSIGN_OR_RETURN(const auto budget,
                              limitSampling({patches_.hierarchy(), drawnSide(options_.grid), renderOptions(options_)},
                                            kViewerBytes, options_.limits.resolved().memory_bytes));
    return SceneRenderer::create(scene_, patches_, budget);
  }

  Result<Trial> tryBoth(SceneRenderer& renderer, OwnContext& gl) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto views, judgedViews(renderer, gl));
    if (views.empty())
      return base::Error{base::ErrorCode::kInvalidInput, "no view of the trial shows the model; say what to build"};
    Trial trial;
    trial.views = views.size();
    SceneData data;
    data.welcome = protocol::welcomeOf(scene_, "trial");
    describeHierarchy(patches_.hierarchy(), data.welcome);
    data.patches = &patches_;
    data.ahead_bytes = 0;
    LUMIGRID_ASSIGN_OR_RETURN(trial.patches, figuresOf(data, client::Method::kPatches, views));

    const DrawnStore store(renderer, gl, options_);
    LUMIGRID_ASSIGN_OR_RETURN(const auto sight, lod::patch::ProxySight::ofFile(patches_));
    data.images = &store;
    data.sight = &sight;
    data.welcome.grid = options_.grid;
    LUMIGRID_ASSIGN_OR_RETURN(trial.images, figuresOf(data, client::Method::kLumigraph, views));
    return trial;
  }

  Result<std::vector<JudgedView>> judgedViews(SceneRenderer& renderer, OwnContext& gl) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto cameras, heldOutViews(scene_, patches_));
    steps_ = 3 * cameras.size();
    const base::Sphere bounds{renderer.sceneCenter(), renderer.sceneRadius()};
    std::vector<JudgedView> views;
    for (const base::ViewCamera& view : cameras) {
      LUMIGRID_TRY(step());
      const base::Camera camera = base::cameraForScene(view, scene_.origin, bounds);
      LUMIGRID_ASSIGN_OR_RETURN(auto picture, gl.use([&] {
        return renderer.render(camera, {.tolerance_px = 0.0F, .supersampling = kTruthSamples});
      }));
      if (showsModel(picture.rgba)) views.push_back({view, std::move(picture.rgba)});
    }
    return views;
  }

  Result<TrialFigures> figuresOf(const SceneData& data, client::Method method, const std::vector<JudgedView>& views) {
    DirectViewer viewer(data, settledOptions(method));
    TrialFigures figures;
    figures.worst_psnr_db = base::kEqualDb;
    for (const JudgedView& view : views) {
      LUMIGRID_TRY(step());
      LUMIGRID_ASSIGN_OR_RETURN(const auto picture, viewer.show(view.camera));
      const double psnr_db = base::foregroundError(view.truth, picture).psnr();
      figures.mean_psnr_db += psnr_db / static_cast<double>(views.size());
      figures.worst_psnr_db = std::min(figures.worst_psnr_db, psnr_db);
    }
    figures.bytes = viewer.bytesReceived();
    return figures;
  }

  Result<void> step() {
    if (progress_(std::min(1.0, static_cast<double>(done_++) / static_cast<double>(steps_)))) return {};
    return base::Error{base::ErrorCode::kCancelled, "stopped; the same command tries the methods again"};
  }

  const base::Scene& scene_;
  const lod::patch::PatchFile& patches_;
  const BakeOptions& options_;
  const std::function<bool(double)>& progress_;
  std::size_t done_ = 0, steps_ = 1;
};

}  // namespace

Result<Trial> tryMethods(const base::Scene& scene, const lod::patch::PatchFile& patches, const BakeOptions& options,
                         const std::function<bool(double done)>& progress) {
  return Trials(scene, patches, options, progress).run();
}

}  // namespace server
