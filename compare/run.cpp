#include "compare/run.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <sstream>
#include <thread>

#include "base/egl/headless.h"
#include "base/file.h"
#include "base/format_text.h"
#include "base/json/scene_file.h"
#include "base/parallel.h"
#include "base/png/png.h"
#include "base/stopwatch.h"
#include "client/native/headless.h"
#include "compare/painter.h"
#include "lod/patch/format.h"
#include "server/net/server.h"
#include "server/render/scene_renderer.h"
#include "server/render/splat_scene.h"

namespace compare {
namespace {

namespace fs = std::filesystem;
using base::Result;

std::string frameFile(const std::string& directory, std::size_t frame, const char* suffix = "") {
  return directory + base::formatText("/frame_%04zu%s.png", frame, suffix);
}

/// Draws the truth of all views before anything else runs, since llvmpipe does not stand several drawing contexts.
Result<Truth> drawTruth(const RunOptions& options, const std::function<void(const std::string&)>& log) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto scene, server::openScene(options.scene));
  LUMIGRID_ASSIGN_OR_RETURN(const auto gl, base::HeadlessContext::create());
  LUMIGRID_ASSIGN_OR_RETURN(const auto painter, Painter::create(*scene, *gl));
  const Truth truth(*scene, options.report + "/truth", options.truth_supersampling);
  for (std::size_t i = 0; i < options.path.size(); ++i) {
    log("truth: frame " + std::to_string(i + 1) + " of " + std::to_string(options.path.size()));
    if (const auto drawn = truth.picture(options.path[i], *painter); !drawn) return drawn.error();
  }
  return truth;
}

/// A server in this process, on a free port of the loopback, for as long as the object lives.
class LocalServer {
 public:
  static Result<std::unique_ptr<LocalServer>> start(const std::string& scene, bool render_frames) {
    server::ServerOptions options;
    options.port = 0;
    options.render_frames = render_frames;
    LUMIGRID_ASSIGN_OR_RETURN(auto opened, server::Server::open({scene}, options));
    auto local = std::unique_ptr<LocalServer>(new LocalServer);
    local->server_ = std::move(opened);
    local->thread_ = std::thread([raw = local.get()] { (void)raw->server_->run(false); });
    return local;
  }
  ~LocalServer() {
    server_->stop();
    thread_.join();
  }
  std::string url() const { return "ws://127.0.0.1:" + std::to_string(server_->port()) + "/"; }

 private:
  LocalServer() = default;
  std::unique_ptr<server::Server> server_;
  std::thread thread_;
};

struct Setting {
  std::string method;
  double tolerance;
  bool images, frames;
  std::optional<lod::draw::SplatKernel> splats;  ///< splats are drawn here from the file, without a server
};

std::vector<Setting> settingsOf(const RunOptions& options) {
  const auto wanted = [&](const char* method) {
    return std::find(options.methods.begin(), options.methods.end(), method) != options.methods.end();
  };
  std::vector<Setting> settings;
  if (wanted("lumigraph")) {
    settings.push_back({"lumigraph", options.proxy_tolerance, true, false, {}});
    if (options.frames) settings.push_back({"lumigraph+frames", options.proxy_tolerance, true, true, {}});
    settings.push_back({"proxy", options.proxy_tolerance, false, false, {}});
  }
  if (wanted("patches"))
    for (double tolerance : options.patch_tolerances) settings.push_back({"patches", tolerance, false, false, {}});
  if (wanted("qsplat"))
    for (const std::string& kernel : options.splats)
      for (double cutoff : options.cutoffs)
        settings.push_back({"qsplat " + kernel, cutoff, false, false, lod::draw::splatKernelFromName(kernel)});
  return settings;
}

client::HeadlessOptions clientOptions(const RunOptions& options, const Setting& setting, const std::string& url) {
  client::HeadlessOptions client;
  client.url = url;
  client.path = options.path;
  client.settle_seconds = options.settle_seconds;
  client.realtime_fps = options.realtime_fps;
  client.link = {options.bytes_per_second, options.latency_seconds};
  client.viewer.method = setting.images ? client::Method::kLumigraph : client::Method::kPatches;
  client.viewer.session.images = setting.images;
  client.viewer.session.frames = setting.frames;
  client.viewer.session.setPatchTolerance(static_cast<float>(setting.tolerance));
  client.viewer.session.max_points = static_cast<std::uint16_t>(options.points);
  client.viewer.lumigraph.max_samples = options.samples;
  client.viewer.session.cache_bytes = options.cache_bytes;
  // High enough that the tolerance decides, not the budget, so that the chart's settings differ as labelled.
  client.viewer.session.max_triangles = 4'000'000;
  return client;
}

FrameResult frameResult(const client::HeadlessFrame& frame, const Accuracy& accuracy) {
  const client::SessionStats& s = frame.stats.session;
  FrameResult r;
  r.frame = static_cast<int>(frame.index);
  r.seconds = frame.seconds;
  r.draw_ms = frame.draw_ms;
  r.bytes = s.bytes_received;
  r.bytes_images = s.bytes_faces;
  r.bytes_patches = s.bytes_patches;
  r.bytes_frames = s.bytes_frames;
  r.triangles = frame.stats.lumigraph.triangles;
  r.images = frame.stats.lumigraph.samples_used;
  r.complete = frame.stats.complete;
  r.accuracy = accuracy;
  return r;
}

Result<void> writePictures(const std::string& directory, std::size_t frame, const base::Image& truth,
                           const base::Image& picture) {
  LUMIGRID_TRY(base::makeDirectories(directory));
  LUMIGRID_TRY(base::writePng(picture, frameFile(directory, frame)));
  return base::writePng(differencePicture(truth, picture), frameFile(directory, frame, "_difference"));
}

/// Measures a frame's picture against the truth, and writes both where pictures are wanted.
Result<Accuracy> measureFrame(const RunOptions& options, const std::string& run_name, const Truth& truth,
                              std::size_t index, const base::Image& picture) {
  LUMIGRID_ASSIGN_OR_RETURN(auto reference, truth.keptPicture(options.path[index]));
  auto accuracy = measureAccuracy(reference, picture);
  if (!accuracy) return base::within("frame " + std::to_string(index), accuracy.error());
  if (options.pictures) LUMIGRID_TRY(writePictures(options.report + "/" + run_name, index, reference, picture));
  return accuracy;
}

Result<RunResult> runOverSocket(const RunOptions& options, const Setting& setting, const Truth& truth) {
  LUMIGRID_ASSIGN_OR_RETURN(auto server, LocalServer::start(options.scene, setting.frames));
  RunResult run{setting.method, setting.tolerance, {}};
  std::optional<base::Error> failed;
  client::HeadlessOptions client = clientOptions(options, setting, server->url());
  client.on_frame = [&](const client::HeadlessFrame& frame) {
    if (failed) return;
    auto accuracy = measureFrame(options, run.name(), truth, frame.index, frame.image);
    if (!accuracy)
      failed = accuracy.error();
    else
      run.frames.push_back(frameResult(frame, *accuracy));
  };
  client.cancelled = [&] { return failed.has_value(); };
  auto done = client::runHeadless(client);
  if (failed) return *failed;
  if (!done) return done.error();
  return run;
}

// The bytes of a frame are those of all blocks read so far, as many as a client would have had to fetch.
Result<RunResult> runSplats(const RunOptions& options, const Setting& setting, const Truth& truth) {
  LUMIGRID_ASSIGN_OR_RETURN(auto scene, base::readScene(options.scene));
  LUMIGRID_ASSIGN_OR_RETURN(auto file, server::openSplats(options.scene, scene));
  LUMIGRID_ASSIGN_OR_RETURN(const auto context, base::HeadlessContext::create());
  LUMIGRID_ASSIGN_OR_RETURN(auto renderer, server::SplatScene::create(scene, file));
  server::SplatOptions how;
  how.kernel = *setting.splats;
  how.cutoff_px = static_cast<float>(setting.tolerance);
  RunResult run{setting.method, setting.tolerance, {}};
  const base::Stopwatch watch;
  for (std::size_t i = 0; i < options.path.size(); ++i) {
    const double start = watch.seconds();
    auto picture = renderer->render(base::cameraForScene(options.path[i], scene.origin, renderer->bounds()), how);
    if (!picture) return picture.error();
    FrameResult frame;
    frame.draw_ms = 1000.0 * (watch.seconds() - start);
    frame.frame = static_cast<int>(i);
    frame.seconds = start;
    frame.bytes = picture->bytes;
    frame.triangles = picture->splats;
    frame.complete = true;
    LUMIGRID_ASSIGN_OR_RETURN(frame.accuracy, measureFrame(options, run.name(), truth, i, picture->rgba));
    run.frames.push_back(frame);
  }
  return run;
}

Result<RunResult> runOne(const RunOptions& options, const Setting& setting, const Truth& truth) {
  return setting.splats ? runSplats(options, setting, truth) : runOverSocket(options, setting, truth);
}

Result<ReportContext> describe(const RunOptions& options) {
  ReportContext context;
  context.scene = fs::path(options.scene).lexically_normal().filename().string();
  context.machine = machineName();
  context.commit = LUMIGRID_COMMIT;
  LUMIGRID_ASSIGN_OR_RETURN(auto gl, base::HeadlessContext::create());
  context.renderer = gl->renderer();
  context.width = options.path[0].width;
  context.height = options.path[0].height;
  context.link = "loopback";
  if (options.bytes_per_second > 0.0)
    context.link = std::to_string(static_cast<long>(options.bytes_per_second * 8.0 / 1000.0)) + " kbit/s, " +
                   std::to_string(static_cast<long>(options.latency_seconds * 1000.0)) + " ms";
  return context;
}

}  // namespace

std::string machineName() {
  std::ifstream info("/proc/cpuinfo");
  std::string name = "unknown processor";
  for (std::string line; std::getline(info, line);)
    if (line.rfind("model name", 0) == 0) {
      name = line.substr(line.find(':') + 2);
      break;
    }
  return name + ", " + std::to_string(base::coreCount()) + " cores";
}

Result<std::vector<RunResult>> runComparison(const RunOptions& options,
                                             const std::function<void(const std::string&)>& log) {
  if (options.path.empty()) return base::Error{base::ErrorCode::kInvalidInput, "the camera path is empty"};
  LUMIGRID_ASSIGN_OR_RETURN(const auto truth, drawTruth(options, log));
  std::vector<RunResult> runs;
  for (const Setting& setting : settingsOf(options)) {
    auto run = runOne(options, setting, truth);
    if (!run) return base::within(setting.method, run.error());
    log(base::formatText("%-28s %8.2f MB  %6.2f dB  SSIM %.4f  %7.1f ms", run->name().c_str(),
                         static_cast<double>(run->totalBytes()) / 1e6, run->meanPsnr(), run->meanSsim(),
                         run->medianDrawMs()));
    runs.push_back(std::move(*run));
  }
  LUMIGRID_ASSIGN_OR_RETURN(auto context, describe(options));
  LUMIGRID_TRY(writeReport(options.report, context, runs));
  return runs;
}

}  // namespace compare
