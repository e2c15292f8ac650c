// Measures what splats a slow link shows, second by second, for each of the five orders of Rusinkiewicz and Levoy 2001,
// section 4.2, as in their figure 2 (after the start, 1, 10 and 60 seconds): PSNR against the fully streamed picture,
// and bytes that came and were never drawn.
//
//   qsplat_stream_bench SCENE/qsplat.lgq [CHART.svg]     (a file in either form)
//   qsplat_stream_bench SCENE/qsplat.lgq --tours
//
// With --tours: bytes that came and were never drawn while the view moves, over slow and fast links.
//
// The link is simulated: 384 kbit/s, 50 ms each way, a head of 300 bytes before each answer, requests one after the
// other. So the figures are the same on every machine.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <deque>
#include <optional>
#include <string_view>
#include <vector>

#include "base/egl/headless.h"
#include "base/file.h"
#include "base/gl/gl.h"
#include "compare/accuracy.h"
#include "compare/chart.h"
#include "lod/draw/splats.h"
#include "lod/qsplat/stream/stream.h"
#include "tests/bench/bench.h"
#include "tests/bench/splat_view.h"

namespace {
using namespace lod::qsplat;

struct Rate {
  const char* name = "384 kbit/s";
  double bytes_per_second = 384'000.0 / 8.0;
  double one_way_seconds = 0.05;
};
constexpr double kHeadBytes = 300.0;
constexpr double kFrameSeconds = 0.2;
constexpr int kWidth = 1280, kHeight = 720;
constexpr std::array<double, 14> kLooks{0.0, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 90.0, 120.0};
constexpr double kLastLook = kLooks.back();

/// Returns views of the whole model and of parts.
std::vector<base::Camera> viewsOf(const base::Sphere& root) {
  std::vector<base::Camera> views;
  for (const auto& [turn, pitch, radii] :
       {std::array{0.4, 0.6, 1.9}, std::array{2.1, 0.9, 1.2}, std::array{4.0, 0.7, 0.6}}) {
    views.push_back(bench::orbitCamera(root, turn, pitch, radii, kWidth));
  }
  return views;
}

class Canvas {
 public:
  explicit Canvas(const Header& header) : header_(header) {}
  base::Image picture(const std::vector<Splat>& splats, const base::Camera& camera) {
    target_.bind();
    glClearColor(0, 0, 0, 0);
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    lod::draw::SplatView view;
    view.camera = camera;
    view.shading = {header_.colors, glm::normalize(glm::vec3(0.4F, 0.3F, 0.85F))};
    bench::must(renderer_->draw(splats, lod::draw::SplatKernel::kCircle, view,
                                {target_.framebuffer(), kWidth, kHeight, false}));
    return target_.read();
  }

 private:
  const Header header_;
  std::unique_ptr<base::HeadlessContext> context_ = bench::must(base::HeadlessContext::create());
  std::unique_ptr<lod::draw::SplatRenderer> renderer_ = bench::must(lod::draw::SplatRenderer::create());
  base::gl::RenderTarget target_ = bench::must(base::gl::RenderTarget::create(kWidth, kHeight));
};

/// Delivers answers one after the other, at the link's rate.
class Link {
 public:
  explicit Link(base::ByteView file, const Rate& rate = {}) : file_(file), rate_(rate) {}
  void acceptRequests(Stream& stream, double now) {
    for (const ByteRange& range : stream.nextRequests(now)) {
      free_ = std::max(free_, now + rate_.one_way_seconds) +
              (kHeadBytes + static_cast<double>(range.length)) / rate_.bytes_per_second;
      under_way_.push_back({range, free_ + rate_.one_way_seconds});
    }
  }
  /// Hands the next answer that arrives until `until` to the stream, and returns its time.
  std::optional<double> arrive(Stream& stream, double until) {
    if (under_way_.empty() || under_way_.front().due > until) return std::nullopt;
    const Answer answer = under_way_.front();
    under_way_.pop_front();
    stream.acceptAnswer(
        answer.range.id,
        file_.subspan(static_cast<std::size_t>(answer.range.offset), static_cast<std::size_t>(answer.range.length)),
        answer.due);
    return answer.due;
  }

 private:
  struct Answer {
    ByteRange range;
    double due;
  };
  base::ByteView file_;
  const Rate rate_;
  std::deque<Answer> under_way_;
  double free_ = 0.0;
};

struct Run {
  std::vector<std::pair<double, double>> psnr;  ///< second, dB
  double first_picture = 0.0, complete = 0.0;   ///< seconds
  StreamStats at_end;
  std::uint64_t wasted = 0;
};

/// A qsplat.lgq in memory.
struct WholeFile {
  const base::Bytes& bytes;
  Header header;
};

Run streamed(const WholeFile& file, const base::Camera& camera, const base::Image& truth, StreamOrder order,
             Canvas& canvas) {
  StreamOptions options;
  options.order = order;
  options.idle_bytes = 0;
  options.memory_bytes = std::max(file.header.file_bytes, std::uint64_t{1} << 20);
  Stream stream(file.bytes.size(), options);
  Link link(file.bytes);
  TraverseRequest request;
  request.camera = camera;
  Run run;
  Traversal found;
  std::size_t look = 0;
  for (double frame = 0.0; look < kLooks.size(); frame += kFrameSeconds) {
    link.acceptRequests(stream, frame);
    while (const auto at = link.arrive(stream, frame)) link.acceptRequests(stream, *at);
    stream.traverse(request, std::nullopt, found);
    link.acceptRequests(stream, frame);
    const bool all_here = stream.complete();
    if (run.first_picture == 0.0 && !found.splats.empty()) run.first_picture = frame;
    if (all_here && run.complete == 0.0) run.complete = frame;
    // Second 0 is the first picture.
    const bool due = look == 0 ? run.first_picture > 0.0 : frame + 1e-9 >= kLooks[look];
    if (!due && !all_here) continue;
    const double at = all_here ? std::max(frame, look == 0 ? frame : kLooks[look]) : frame;
    const auto accuracy = compare::measureAccuracy(truth, canvas.picture(found.splats, camera));
    run.psnr.emplace_back(at, accuracy ? accuracy->psnr_db : 0.0);
    ++look;
  }
  run.at_end = stream.stats();
  run.wasted = stream.bytesWasted();
  return run;
}

// ---- moving views ----

constexpr double kTourSeconds = 60.0;
constexpr double kTourFrame = 0.1;
constexpr float kMovingPx = 4.0F, kRestingPx = 1.0F;

struct Place {
  double turn = 0.0, pitch = 0.6, radii = 1.0;  ///< of the eye, from the model's middle
  double look = 0.0;                            ///< to the side of the middle, radians
};
struct MovingView {
  const char* name;
  Place (*at)(double seconds);
};
double between(double a, double b, double share) {
  const double s = std::clamp(share, 0.0, 1.0);
  return a + (b - a) * s * s * (3.0 - 2.0 * s);
}
constexpr std::array<MovingView, 4> kMovingViews{{
    // 0.03 radii a second: 1.5 m where the model is 100 m across.
    {"walk: 0.03 radii/s, nearer and around",
     [](double t) {
       return Place{0.4 + 0.02 * t, 0.5, 1.6 - 0.02 * t, 0.0};
     }},
    {"flight: 0.3 radii/s, around",
     [](double t) {
       return Place{0.4 + 0.3 * t, 0.7, 1.0, 0.0};
     }},
    // The view turns from one side to the other in half a second, then rests for two and a half seconds.
    {"glances: 80 degrees in 0.5 s, then 2.5 s of rest",
     [](double t) {
       const int glance = static_cast<int>(t / 3.0);
       const double from = glance % 2 == 0 ? -0.7 : 0.7;
       return Place{0.4 + 0.9 * (glance / 2), 0.5, 0.8, between(from, -from, (t - 3.0 * glance) / 0.5)};
     }},
    {"never at rest: 180 degrees/s",
     [](double t) {
       return Place{0.4, 0.5, 0.6, 3.14159 * t};
     }},
}};

base::Camera cameraAt(const Place& place, const base::Sphere& root) {
  return bench::orbitCamera(root, place.turn, place.pitch, place.radii, kWidth, place.look);
}

struct TourResult {
  StreamStats at_end;
  std::uint64_t wasted = 0;
  double lacking = 0.0;  ///< of the splats drawn, the share that stood in for finer ones, mean over the frames
};

TourResult runTour(const WholeFile& file, const MovingView& view, const Rate& rate, std::uint64_t idle_bytes) {
  StreamOptions options;
  options.idle_bytes = idle_bytes;
  options.memory_bytes = std::max(file.bytes.size(), std::size_t{1} << 20);
  Stream stream(file.bytes.size(), options);
  Link link(file.bytes, rate);
  TourResult run;
  Traversal found;
  std::optional<base::Camera> before;
  int frames = 0;
  for (double now = 0.0; now < kTourSeconds; now += kTourFrame) {
    link.acceptRequests(stream, now);
    while (const auto at = link.arrive(stream, now)) link.acceptRequests(stream, *at);
    TraverseRequest request;
    request.camera = cameraAt(view.at(now), file.header.root);
    const bool rests = before && before->eye_from_scene == request.camera.eye_from_scene;
    request.cutoff_px = rests ? kRestingPx : kMovingPx;
    before = request.camera;
    stream.traverse(request, std::nullopt, found);
    link.acceptRequests(stream, now);
    if (found.splats.empty()) continue;
    ++frames;
    const auto stand_ins = std::count_if(found.splats.begin(), found.splats.end(),
                                         [](const Splat& splat) { return (splat.normal & Splat::kStandIn) != 0; });
    run.lacking += static_cast<double>(stand_ins) / static_cast<double>(found.splats.size());
  }
  run.lacking /= std::max(frames, 1);
  run.at_end = stream.stats();
  run.wasted = stream.bytesWasted();
  return run;
}

void printTours(const WholeFile& file) {
  std::printf("%.0f s each, a frame every %.1f s, cut-off %.0f px moving and %.0f px at rest\n", kTourSeconds,
              kTourFrame, static_cast<double>(kMovingPx), static_cast<double>(kRestingPx));
  std::printf("%-50s %-12s %-10s | %8s %9s %7s %9s %9s\n", "view", "link", "ahead", "kB", "wasted kB", "%", "stand-ins",
              "requests");
  for (const MovingView& view : kMovingViews)
    for (const Rate& rate : {Rate{}, Rate{"5 Mbit/s", 5e6 / 8.0, 0.02}, Rate{"20 Mbit/s", 2e7 / 8.0, 0.015}})
      for (const std::uint64_t idle : {std::uint64_t{0}, StreamOptions{}.idle_bytes}) {
        const TourResult run = runTour(file, view, rate, idle);
        const auto received = static_cast<double>(run.at_end.bytes_received);
        const auto wasted = static_cast<double>(run.wasted);
        std::printf("%-50s %-12s %-10s | %8.0f %9.0f %6.1f%% %8.1f%% %9llu\n", view.name, rate.name,
                    idle == 0 ? "nothing" : "as usual", 1e-3 * received, 1e-3 * wasted, 1e2 * wasted / received,
                    1e2 * run.lacking, static_cast<unsigned long long>(run.at_end.requests));
      }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: qsplat_stream_bench SCENE/qsplat.lgq [CHART.svg | --tours]\n");
    return 2;
  }
  const base::Bytes bytes = bench::must(base::readFile(argv[1]));
  const WholeFile file{bytes, bench::must(readHeader(bytes))};
  if (argc > 2 && std::string_view(argv[2]) == "--tours") return printTours(file), 0;
  std::printf("%s: %.1f MB%s, %llu leaves; 384 kbit/s, 100 ms there and back; 1280 x 720\n", argv[1],
              1e-6 * static_cast<double>(file.bytes.size()), file.header.coded() ? " coded" : "",
              static_cast<unsigned long long>(file.header.leaves));
  Canvas canvas(file.header);
  compare::Chart chart;
  chart.title = "Splats over 384 kbit/s: five orders";
  chart.x_label = "seconds";
  chart.y_label = "PSNR against the fully streamed picture, dB (at most 60)";
  chart.log_x = true;

  const std::vector<base::Camera> views = viewsOf(file.header.root);
  std::vector<base::Image> truths;
  for (const base::Camera& camera : views) {
    const auto blocks = bench::must(openBlocks(file.bytes, file.header));
    TraverseRequest request;
    request.camera = camera;
    truths.push_back(canvas.picture(traverse(*blocks, request).splats, camera));
  }
  std::printf("%-8s %5s | %7s %6s %6s %6s %6s | %9s %8s %9s %8s\n", "order", "view", "start s", "start", "1 s", "10 s",
              "60 s", "all at s", "kB", "wasted kB", "requests");
  for (const auto& [order, name] : kStreamOrderNames) {
    compare::Series series{std::string(name), {}};
    for (std::size_t v = 0; v < views.size(); ++v) {
      const Run run = streamed(file, views[v], truths[v], order, canvas);
      const auto at = [&](double second) {
        for (std::size_t i = 0; i < kLooks.size(); ++i)
          if (kLooks[i] == second) return run.psnr[i].second;
        return 0.0;
      };
      std::printf("%-8s %5zu | %7.1f %6.1f %6.1f %6.1f %6.1f | %9.1f %8llu %9llu %8llu\n", series.name.c_str(), v,
                  run.first_picture, at(0.0), at(1.0), at(10.0), at(60.0), run.complete,
                  static_cast<unsigned long long>(run.at_end.bytes_received / 1000),
                  static_cast<unsigned long long>(run.wasted / 1000),
                  static_cast<unsigned long long>(run.at_end.requests));
      // The last row is the mean over the views at the same seconds.
      for (std::size_t i = 1; i < kLooks.size(); ++i) {
        if (v == 0) series.points.emplace_back(kLooks[i], 0.0);
        series.points[i - 1].second += std::min(run.psnr[i].second, 60.0) / static_cast<double>(views.size());
      }
    }
    chart.series.push_back(std::move(series));
  }
  if (argc > 2) {
    const std::string svg = compare::formatChart(chart);
    bench::must(base::writeFileAtomically(argv[2], {reinterpret_cast<const std::uint8_t*>(svg.data()), svg.size()}));
  }
  std::printf("(seconds up to %.0f; 0 in 'all at s': not all came by then)\n", kLastLook);
  return 0;
}
