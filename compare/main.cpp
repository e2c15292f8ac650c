// lumigrid-compare: measures speed and accuracy of the methods, in virtual time or over real sockets.
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <optional>

#include "base/file.h"
#include "base/json/camera_file.h"
#include "base/memory.h"
#include "base/parallel.h"
#include "client/native/units.h"
#include "compare/run.h"
#include "compare/sim/baseline.h"
#include "compare/sim/matrix.h"
#include "compare/sim/results.h"

namespace {

int fail(const base::Error& error) {
  std::fprintf(stderr, "lumigrid-compare: %s\n", error.message.c_str());
  return 1;
}

struct Arguments {
  Arguments() { matrix.jobs = 0; }
  compare::RunOptions run;
  compare::MatrixOptions matrix;
  std::vector<std::string> scenes, methods, shadows, paths, links;
  std::string idle;
  std::string path, bandwidth, latency, clock = "virtual", report, baseline, command, preset;
  double render_ms = 1e3 * compare::Costs().server_render_seconds;
  double decode_ms = 1e3 * compare::Costs().client_decode_seconds;
  double draw_ms = 1e3 * compare::Costs().client_draw_seconds;
  std::vector<int> size{640, 360};
  bool sweep = false;
  std::optional<double> seconds;
  std::optional<int> instants;
};

/// Declares the options of both clocks.
void declareCommon(CLI::App& app, Arguments& a) {
  app.add_option("SCENE", a.scenes, "scene directories; one with --clock real")->required();
  app.add_option("--report", a.report, "directory for results.csv and what else is written")->required();
  app.add_option("--path", a.path, "camera path as JSON, as `lumigrid tour` and `lumigrid-view --record` write it");
  app.add_option(
         "--methods,--method", a.methods,
         "methods to run (default: all that the scene has data for); over sockets there are lumigraph, patches and "
         "qsplat")
      ->delimiter(',')
      ->check(CLI::IsMember(compare::methodNames()));
  app.add_option(
         "--clock", a.clock,
         "virtual: server, link and client in one process in simulated time, the same figures on every machine; "
         "real: over sockets")
      ->check(CLI::IsMember({"virtual", "real"}));
  app.add_flag("!--no-pictures", a.run.pictures, "do not write each method's pictures");
  app.add_option("--truth-supersampling", a.run.truth_supersampling, "n x n samples a pixel of the truth")
      ->check(CLI::Range(1, 8));
}

void declareVirtual(CLI::App& app, Arguments& a) {
  compare::MatrixOptions& o = a.matrix;
  CLI::Option_group& group = *app.add_option_group("Virtual time");
  group.add_option("--paths", a.paths, "paths made for the scene (default: orbit), in place of --path")
      ->delimiter(',')
      ->check(CLI::IsMember(server::pathNames()));
  group
      .add_option("--links", a.links,
                  "links: rate/round trip[/jitter[/loss]], such as 20Mbit/40ms (the default); or train")
      ->delimiter(',');
  group
      .add_option("--matrix", a.preset,
                  "quick: two paths over two links; full: all paths, five links, all values of each method's knob. "
                  "--paths, --links and --path replace its own")
      ->check(CLI::IsMember({"quick", "full"}));
  group
      .add_option("--shadows", a.shadows,
                  "with --methods hlod: a run for each of these, none, hard or soft, against the truth with the same "
                  "shadows of the scene's light (default: none)")
      ->delimiter(',')
      ->check(CLI::IsMember(std::vector<std::string>(lod::hlod::kShadowNames.begin(), lod::hlod::kShadowNames.end())))
      ->default_str("");
  group
      .add_option("--idle", a.idle,
                  "bytes that qsplat and hlod fetch ahead for each view that has all it needs, such as 16M; 0: none "
                  "(default: as viewers do)")
      ->default_str("");
  group.add_flag("--sweep", a.sweep, "each method with all values of its knob");
  group.add_option("--seconds", a.seconds, "duration of each path (12; with --matrix 8)")
      ->check(CLI::Range(0.1, 600.0));
  group.add_option("--size", a.size, "width and height in pixels, as 640 360 or 640x360")
      ->expected(2)
      ->delimiter('x')
      ->check(CLI::Range(16, 16384));
  group.add_option("--instants", a.instants, "pictures judged while a path lasts (12; with --matrix 8)")
      ->check(CLI::Range(1, 10000));
  group.add_option("--judge-at", o.play.also_judged, "seconds after the begin at which pictures are judged, too")
      ->delimiter(',')
      ->check(CLI::Range(0.0, 600.0));
  group.add_option("--stop", o.stop_seconds, "seconds at each view of a --path without times")
      ->check(CLI::Range(0.1, 600.0));
  group.add_option("--baseline", a.baseline,
                   "a summary.csv that was kept: fails with a table where a run loses more than 0.1 dB or 2 % of bytes "
                   "or time against it");
  group.add_option("--jobs", o.jobs, "scenes played at a time, each by a process; 0: as many as there are cores");
  group.add_option("--seed", o.play.seed, "seed of links, paths and instants");
  group.add_option("--server-render-ms", a.render_ms, "cost of an exact frame")->check(CLI::Range(0.0, 1e5));
  group.add_option("--decode-ms", a.decode_ms, "cost of decoding 512 x 512 pixels")->check(CLI::Range(0.0, 1e5));
  group.add_option("--draw-ms", a.draw_ms, "cost of a frame in the client")->check(CLI::Range(0.0, 1e4));
}

void declareReal(CLI::App& app, Arguments& a) {
  compare::RunOptions& o = a.run;
  CLI::Option_group& group = *app.add_option_group("Over sockets (--clock real)");
  group.add_option("--patch-tolerances", o.patch_tolerances, "pixels: settings of patches alone")
      ->delimiter(',')
      ->check(CLI::Range(0.1, 1000.0));
  group.add_option("--splats", o.splats, "kernels of qsplat")
      ->delimiter(',')
      ->check(CLI::IsMember({"square", "circle", "fuzzy", "ellipse"}));
  group.add_option("--cutoffs", o.cutoffs, "pixels: settings of qsplat, each with every kernel")
      ->delimiter(',')
      ->check(CLI::Range(0.0, 1000.0));
  group.add_option("--proxy-tolerance", o.proxy_tolerance, "error of the proxy under the images, pixels")
      ->check(CLI::Range(0.1, 1000.0));
  group.add_option("--points", o.points, "sampling points per view")->check(CLI::Range(1, 64));
  group.add_option("--samples", o.samples, "images blended per frame at most")->check(CLI::Range(1, 32));
  group.add_flag("!--no-frames", o.frames, "leave the run with exact frames out");
  group.add_option("--settle", o.settle_seconds, "seconds to wait at most for a view to be complete");
  group.add_option("--realtime", o.realtime_fps,
                   "frames per second, drawn with the data that have arrived; 0: wait for each view");
  group.add_option("--bandwidth", a.bandwidth,
                   "link to emulate, such as 20Mbit or 384kbit (default: the loopback as it is)");
  group.add_option(
      "--latency", a.latency,
      "delay that the emulated link adds to each message towards the viewer, so once per round trip, such as "
      "30ms (default: none)");
}

// Reads the units of the link's options.
base::Result<void> parseEmulatedLink(Arguments& a) {
  if (!a.bandwidth.empty()) {
    auto rate = client::parseBitRate(a.bandwidth);
    if (!rate) return base::within("--bandwidth", rate.error());
    a.run.bytes_per_second = *rate;
  }
  if (!a.latency.empty()) {
    auto seconds = client::parseDuration(a.latency);
    if (!seconds) return base::within("--latency", seconds.error());
    a.run.latency_seconds = *seconds;
  }
  return {};
}

int usage(const std::string& problem) {
  std::fprintf(stderr, "lumigrid-compare: %s\n", problem.c_str());
  return 2;
}

void print(const std::string& line) {
  std::printf("%s\n", line.c_str());
  std::fflush(stdout);
}

int runOverSockets(Arguments& a) {
  if (a.scenes.size() != 1) return usage("--clock real takes one scene");
  if (!a.shadows.empty()) return usage("--shadows needs --clock virtual");
  if (a.path.empty()) return usage("--clock real takes --path FILE; `lumigrid tour` writes one");
  if (auto parsed = parseEmulatedLink(a); !parsed) return usage(parsed.error().message);
  a.run.scene = a.scenes.front();
  a.run.report = a.report;
  if (!a.methods.empty()) a.run.methods = a.methods;
  for (const std::string& method : a.run.methods)
    if (method != "lumigraph" && method != "patches" && method != "qsplat")
      return usage("--methods " + method + " needs --clock virtual");
  auto path = base::readCameraPath(a.path);
  if (!path) return fail(path.error());
  a.run.path = std::move(path->frames);
  if (auto runs = compare::runComparison(a.run, print); !runs) return fail(runs.error());
  std::printf("report: %s/index.html\n", a.report.c_str());
  return 0;
}

int checkBaseline(const Arguments& a, const std::string& summary, const std::string& baseline) {
  const auto losses = compare::findLosses(summary, baseline, a.baseline);
  if (!losses) return fail(losses.error());
  if (losses->empty()) return 0;
  for (const std::string& loss : *losses) std::fprintf(stderr, "%s\n", loss.c_str());
  std::fprintf(stderr,
               "lumigrid-compare: %zu figures are worse than in %s. Where that is meant, copy %s/summary.csv there and "
               "say why.\n",
               losses->size(), a.baseline.c_str(), a.report.c_str());
  return 1;
}

/// Fills in what the user left open, with the preset's paths and links or the defaults.
base::Result<void> fillMatrix(Arguments& a) {
  const bool short_paths = !a.preset.empty();
  a.matrix.path.seconds = a.seconds.value_or(short_paths ? 8.0 : a.matrix.path.seconds);
  a.matrix.play.instants = a.instants.value_or(short_paths ? 8 : a.matrix.play.instants);
  std::vector<compare::LinkProfile> links;
  for (const std::string& text : a.links) {
    LUMIGRID_ASSIGN_OR_RETURN(auto link, compare::parseLink(text));
    links.push_back(std::move(link));
  }
  a.matrix.parts = compare::matrixParts(a.preset);
  for (compare::MatrixPart& part : a.matrix.parts) {
    if (!a.paths.empty()) part.paths = a.paths;
    if (!links.empty()) part.links = links;
    part.sweep = part.sweep || a.sweep;
  }
  return {};
}

int runInVirtualTime(Arguments& a) {
  if (const auto filled = fillMatrix(a); !filled) return usage(filled.error().message);
  compare::MatrixOptions& o = a.matrix;
  o.scenes = a.scenes;
  if (o.jobs == 0) o.jobs = base::coreCount();
  o.report = a.report;
  o.methods = a.methods;
  if (!a.shadows.empty()) {
    if (a.methods != std::vector<std::string>{"hlod"})
      return usage("--shadows is for --methods hlod alone; other methods have none");
    o.methods.clear();
    for (const std::string& name : a.shadows) o.methods.push_back(compare::hlodWith(*lod::hlod::shadowsFromName(name)));
  }
  o.pictures = a.run.pictures;
  o.command = a.command;
  o.truth_supersampling = a.run.truth_supersampling;
  o.costs = {1e-3 * a.render_ms, 1e-3 * a.decode_ms, 1e-3 * a.draw_ms};
  o.path.width = a.size[0];
  o.path.height = a.size[1];
  o.path.seed = o.play.seed;
  if (!a.path.empty() && !a.paths.empty()) return usage("--path and --paths exclude each other");
  if (!a.path.empty()) o.path_files = {a.path};
  if (!a.idle.empty()) {
    const auto bytes = client::parseByteCount(a.idle);
    if (!bytes) return usage(base::within("--idle", bytes.error()).message);
    o.idle_bytes = *bytes;
  }
  std::string baseline;
  if (!a.baseline.empty()) {
    auto bytes = base::readFile(a.baseline);
    if (!bytes) return fail(bytes.error());
    baseline.assign(bytes->begin(), bytes->end());
  }
  const auto runs = compare::playMatrix(o, print);
  if (!runs) return fail(runs.error());
  std::printf("report: %s/index.html\n", a.report.c_str());
  return a.baseline.empty() ? 0 : checkBaseline(a, compare::summaryCsv(*runs), baseline);
}

}  // namespace

int main(int argc, char** argv) {
  base::keepFreedMemory();  // pictures come and go by the thousand
  // Warnings go to standard error, since standard output carries the figures.
  spdlog::set_default_logger(spdlog::stderr_color_mt("lumigrid-compare"));
  spdlog::set_level(spdlog::level::warn);
  CLI::App app(
      "Speed against accuracy: what each method shows at an instant, and the bytes it took, against the truth of the "
      "view at that instant.",
      "lumigrid-compare");
  app.option_defaults()->always_capture_default();  // --help shows them
  Arguments arguments;
  arguments.command = "lumigrid-compare";
  for (int i = 1; i < argc; ++i) arguments.command += std::string(" ") + argv[i];
  declareCommon(app, arguments);
  declareVirtual(app, arguments);
  declareReal(app, arguments);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  return arguments.clock == "real" ? runOverSockets(arguments) : runInVirtualTime(arguments);
}
