#include "client/native/headless.h"

#include <GLES3/gl3.h>

#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "base/egl/headless.h"
#include "base/file.h"
#include "base/format_text.h"
#include "base/gl/gl.h"
#include "base/png/png.h"
#include "base/stopwatch.h"
#include "client/native/first_view.h"
#include "client/native/native_decoder.h"
#include "client/native/units.h"

namespace client {
namespace {

/// Longest wait between two polls of the connection, which bounds the delay until finished decoding and fading are
/// noticed.
constexpr double kPollSeconds = 0.002;

/// One run along the path.
class HeadlessRun {
 public:
  explicit HeadlessRun(const HeadlessOptions& options) : options_(options), path_(options.path), here_since_(start_) {}

  base::Result<HeadlessSummary> run();

 private:
  base::Result<void> prepare();
  base::Result<void> openScene(Method method);
  base::Result<void> waitForWelcome();
  base::Result<void> takeFirstView();
  base::Result<void> checkConnection();
  base::Result<void> settleView(const base::ViewCamera& camera);
  base::Result<void> waitUntil(double seconds, const base::ViewCamera& camera);
  base::Result<void> drawView(const base::ViewCamera& camera);
  base::Result<void> bindTarget(const base::ViewCamera& camera);
  base::Result<void> drawFrame(std::size_t index);
  base::Result<void> saveFrame(const HeadlessFrame& frame);
  bool pump();

  const HeadlessOptions& options_;
  std::vector<base::ViewCamera> path_;
  std::unique_ptr<base::HeadlessContext> context_;
  std::unique_ptr<Link> connection_;
  std::unique_ptr<Viewer> viewer_;
  std::optional<base::gl::RenderTarget> target_;
  std::string lines_;
  HeadlessSummary summary_;
  double draw_ms_ = 0.0;
  base::Stopwatch start_;       // start of the run, then time of the Welcome
  base::Stopwatch here_since_;  // when the session was last ready
};

base::Result<void> HeadlessRun::prepare() {
  LUMIGRID_TRY(checkUrl(options_.url));
  if (!options_.out_dir.empty()) LUMIGRID_TRY(base::makeDirectories(options_.out_dir));
  LUMIGRID_ASSIGN_OR_RETURN(auto context, base::HeadlessContext::create());
  context_ = std::move(context);
  summary_.renderer = context_->renderer();

  return openScene(options_.viewer.method);
}

/// Makes the viewer, and the link that feeds it.
base::Result<void> HeadlessRun::openScene(Method method) {
  summary_.method = method;
  // With pictures that wait to be complete nothing fades in, and uploads have no limit; at a fixed rate both happen as
  // on a screen.
  ViewerOptions viewer = options_.viewer;
  viewer.method = method;
  if (options_.realtime_fps <= 0.0) {
    viewer.lumigraph.fade_seconds = 0.0F;
    viewer.upload_milliseconds = 0.0;
  }
  viewer_ = std::make_unique<Viewer>(viewer, std::make_unique<NativeDecoder>(std::max(1U, options_.decoder_threads)));
  // Streamed methods are refined fully in each picture, too.
  StreamedOptions streamed = options_.streamed;
  if (options_.realtime_fps <= 0.0) {
    streamed.frame_seconds = 0.0;
    streamed.decode_per_frame = 0;
  }
  LUMIGRID_ASSIGN_OR_RETURN(
      auto link, isStreamed(method) ? openStreamedLink(options_.url, method, options_.link, streamed, options_.access)
                                    : openLink(options_.url, options_.link, options_.access));
  connection_ = std::move(link);
  return {};
}

/// Takes in what arrived, and hands the viewer the streamed view as soon as the link has it.
bool HeadlessRun::pump() {
  const bool arrived = connection_->pump(viewer_->session());
  if (isStreamed(summary_.method)) viewer_->setStreamed(connection_->streamed());
  return arrived;
}

/// Returns an error when the run is refused, cancelled, or without its server for longer than connect_timeout. A
/// shorter loss repairs itself.
base::Result<void> HeadlessRun::checkConnection() {
  if (options_.cancelled && options_.cancelled()) return base::Error{base::ErrorCode::kCancelled, "stopped on request"};
  Session& session = viewer_->session();
  if (session.phase() == SessionPhase::kRefused) return base::Error{base::ErrorCode::kNetwork, session.problem()};
  if (session.phase() == SessionPhase::kReady) {
    here_since_ = base::Stopwatch();
    return {};
  }
  if (here_since_.seconds() <= options_.connect_timeout) return {};
  return base::Error{base::ErrorCode::kNetwork,
                     session.problem().empty() ? options_.url + ": no answer in time; is lumigrid serve running there?"
                                               : session.problem()};
}

base::Result<void> HeadlessRun::waitForWelcome() {
  bool may_change = options_.method_is_default;
  while (viewer_->session().phase() != SessionPhase::kReady) {
    connection_->waitForArrival(0.05);
    pump();
    if (const auto instead = viewer_->session().methodInstead(); instead && std::exchange(may_change, false))
      LUMIGRID_TRY(openScene(*instead));
    LUMIGRID_TRY(checkConnection());
  }
  const std::optional<base::Rgb>& background = viewer_->session().welcome()->background;
  if (options_.scene_background && background) viewer_->setBackground(opaque(*background));
  start_ = base::Stopwatch();
  return {};
}

base::Result<void> HeadlessRun::takeFirstView() {
  LUMIGRID_ASSIGN_OR_RETURN(const FirstView first,
                            firstViewOf(*viewer_->session().welcome(), options_.view, options_.width, options_.height));
  path_ = {first.camera};
  if (first.light.on) viewer_->setLight(first.light.direction());
  if (first.colors_by_resolution) viewer_->setResolutionColors(true);
  return {};
}

base::Result<void> HeadlessRun::bindTarget(const base::ViewCamera& camera) {
  if (!target_ || target_->width() != camera.width || target_->height() != camera.height) {
    LUMIGRID_ASSIGN_OR_RETURN(auto target, base::gl::RenderTarget::create(camera.width, camera.height));
    target_ = std::move(target);
  }
  target_->bind();
  return {};
}

base::Result<void> HeadlessRun::drawView(const base::ViewCamera& camera) {
  LUMIGRID_TRY(bindTarget(camera));
  const base::Stopwatch begin;
  LUMIGRID_TRY(viewer_->draw(camera, start_.seconds()));
  glFinish();
  draw_ms_ = 1e3 * begin.seconds();
  return {};
}

/// Takes in data until the view is complete or the time is up. Draws only when nothing more is to be taken in, since
/// drawing in software costs more than all else.
base::Result<void> HeadlessRun::settleView(const base::ViewCamera& camera) {
  const base::Stopwatch begin;
  while (begin.seconds() < options_.settle_seconds) {
    pump();
    LUMIGRID_TRY(checkConnection());
    LUMIGRID_ASSIGN_OR_RETURN(auto more, viewer_->update(camera, start_.seconds()));
    if (!more && viewer_->allHere()) {
      LUMIGRID_TRY(drawView(camera));
      if (viewer_->stats().complete) return {};
      continue;
    }
    connection_->waitForArrival(kPollSeconds);
  }
  return drawView(camera);
}

/// Takes in data until `seconds` after the Welcome.
base::Result<void> HeadlessRun::waitUntil(double seconds, const base::ViewCamera& camera) {
  while (true) {
    pump();
    LUMIGRID_TRY(checkConnection());
    const double left = seconds - start_.seconds();
    if (left <= 0.0) return {};
    if (const auto more = viewer_->update(camera, start_.seconds()); !more) return more.error();
    connection_->waitForArrival(std::min(left, kPollSeconds));
  }
}

base::Result<void> HeadlessRun::saveFrame(const HeadlessFrame& frame) {
  if (options_.out_dir.empty()) return {};
  LUMIGRID_TRY(base::writePng(frame.image, options_.out_dir + base::formatText("/frame_%04zu.png", frame.index)));
  lines_ += formatHeadlessFrame(frame) + "\n";
  return {};
}

base::Result<void> HeadlessRun::drawFrame(std::size_t index) {
  const base::ViewCamera& camera = path_[index];
  const base::Stopwatch begin;
  if (options_.realtime_fps > 0.0) {
    LUMIGRID_TRY(waitUntil(static_cast<double>(index) / options_.realtime_fps, path_[index == 0 ? 0 : index - 1]));
    LUMIGRID_TRY(drawView(camera));
    viewer_->addFrameTime(1e-3 * draw_ms_);
  } else {
    LUMIGRID_TRY(settleView(camera));
  }

  HeadlessFrame result;
  result.index = index;
  result.camera = camera;
  result.seconds = start_.seconds();
  result.settle_seconds = options_.realtime_fps > 0.0 ? 0.0 : begin.seconds();
  result.draw_ms = draw_ms_;
  result.stats = viewer_->stats();
  result.link = connection_->counts();
  result.image = readPicture(*target_, *viewer_);
  ++summary_.frames;
  summary_.incomplete += result.stats.complete ? 0 : 1;
  LUMIGRID_TRY(saveFrame(result));
  if (options_.on_frame) options_.on_frame(result);
  return {};
}

base::Result<HeadlessSummary> HeadlessRun::run() {
  LUMIGRID_TRY(prepare());
  LUMIGRID_TRY(waitForWelcome());
  if (path_.empty()) LUMIGRID_TRY(takeFirstView());
  for (std::size_t i = 0; i < path_.size(); ++i) LUMIGRID_TRY(drawFrame(i));
  if (!options_.out_dir.empty())
    LUMIGRID_TRY(
        base::writeFileAtomically(options_.out_dir + "/frames.jsonl",
                                  base::ByteView(reinterpret_cast<const std::uint8_t*>(lines_.data()), lines_.size())));

  summary_.seconds = start_.seconds();
  const ViewerStats stats = viewer_->stats();
  summary_.session = stats.session;
  summary_.broken = stats.broken;
  summary_.last_fault = stats.last_fault;
  return summary_;
}

/// Adds the figures of a method that streams a file of its own.
void addStreamed(nlohmann::ordered_json& line, const StreamedStats& streamed) {
  if (const SplatStats& splats = streamed.splats; splats.stream.blocks > 0) {
    line["splats"] = {{"drawn", streamed.drawn},           {"nodes", splats.nodes},
                      {"cutoff_px", streamed.error_px},    {"blocks", splats.stream.blocks},
                      {"present", splats.stream.present},  {"requested", splats.stream.requested},
                      {"wanted", splats.stream.wanted},    {"evicted", splats.stream.evicted},
                      {"failures", splats.stream.failures}};
  }
  if (const UmbrellaStats& umbrellas = streamed.umbrellas; umbrellas.stream.leaves > 0) {
    line["umbrellas"] = {{"points", umbrellas.points},          {"triangles", umbrellas.triangles},
                         {"tolerance", streamed.error_px},      {"leaves", umbrellas.stream.leaves},
                         {"drawn", umbrellas.leaves},           {"present", umbrellas.stream.present},
                         {"lacking", umbrellas.stream.lacking}, {"failures", umbrellas.stream.failures}};
  }
  if (const HlodStats& hlod = streamed.hlod; hlod.stream.nodes > 0) {
    line["hlod"] = {{"triangles", hlod.triangles},         {"points", hlod.points},
                    {"error_px", streamed.error_px},       {"shadows", lod::hlod::nameOf(hlod.shadows)},
                    {"shadow_maps", hlod.shadow_maps},     {"casters", hlod.casters},
                    {"shadow_texels", hlod.shadow_texels}, {"nodes", hlod.stream.nodes},
                    {"drawn", hlod.stream.drawn},          {"present", hlod.stream.present},
                    {"lacking", hlod.stream.lacking},      {"failures", hlod.stream.failures}};
  }
}

}  // namespace

base::Result<HeadlessSummary> runHeadless(const HeadlessOptions& options) {
  return HeadlessRun(options).run();
}

std::string formatHeadlessFrame(const HeadlessFrame& frame) {
  const SessionStats& session = frame.stats.session;
  const LumigraphStats& drawn = frame.stats.lumigraph;
  nlohmann::ordered_json line;
  line["frame"] = frame.index;
  line["seconds"] = frame.seconds;
  line["settle_seconds"] = frame.settle_seconds;
  line["draw_ms"] = frame.draw_ms;
  line["complete"] = frame.stats.complete;
  line["error_px"] = frame.stats.error_px;
  line["bound_px"] = frame.stats.bound_px;
  line["triangles"] = drawn.triangles;
  line["patches"] = drawn.patches;
  line["samples"] = drawn.samples_used;
  line["samples_per_pixel"] = frame.stats.effort.samples * frame.stats.effort.pictures;
  line["scale"] = frame.stats.effort.scale;
  line["points"] = frame.stats.effort.points;
  line["samples_resident"] = drawn.samples_resident;
  line["gpu_bytes"] = drawn.gpu_bytes;
  line["cache_bytes"] = session.cache_bytes;
  line["bytes"] = {{"total", session.bytes_received},
                   {"faces", session.bytes_faces},
                   {"patches", session.bytes_patches},
                   {"frames", session.bytes_frames}};
  addStreamed(line, frame.stats.streamed);
  line["messages"] = session.messages_received;
  if (frame.link.requests > 0) line["link"] = {{"requests", frame.link.requests}, {"bytes", frame.link.bytes}};
  line["broken"] = frame.stats.broken;
  return line.dump();
}

}  // namespace client
