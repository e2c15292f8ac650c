// lumigrid-compare: measures speed and accuracy of the methods over real sockets, and writes one page about them.
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <cstdio>

#include "base/json/camera_file.h"
#include "client/native/units.h"
#include "compare/run.h"

namespace {

int fail(const base::Error& error) {
  std::fprintf(stderr, "lumigrid-compare: %s\n", error.message.c_str());
  return 1;
}

struct Arguments {
  compare::RunOptions run;
  std::string path, bandwidth, latency;
};

void declare(CLI::App& app, Arguments& a) {
  compare::RunOptions& o = a.run;
  app.add_option("SCENE", o.scene, "scene directory")->required();
  app.add_option("--path", a.path, "camera path as JSON (`lumigrid tour` writes one)")->required();
  app.add_option("--report", o.report, "directory for results.csv, charts and index.html")->required();
  app.add_option("--patch-tolerances", o.patch_tolerances, "pixels: settings of patches alone")
      ->delimiter(',')
      ->check(CLI::Range(0.1, 1000.0));
  app.add_option("--splats", o.splats, "kernels of qsplat")
      ->delimiter(',')
      ->check(CLI::IsMember({"square", "circle", "fuzzy", "ellipse"}));
  app.add_option("--cutoffs", o.cutoffs, "pixels: settings of qsplat, each with every kernel")
      ->delimiter(',')
      ->check(CLI::Range(0.0, 1000.0));
  app.add_option("--proxy-tolerance", o.proxy_tolerance, "error of the proxy under the images, pixels")
      ->check(CLI::Range(0.1, 1000.0));
  app.add_option("--points", o.points, "sampling points per view")->check(CLI::Range(1, 64));
  app.add_option("--samples", o.samples, "images blended per frame at most")->check(CLI::Range(1, 32));
  app.add_flag("!--no-frames", o.frames, "leave the run with exact frames out");
  app.add_option("--truth-supersampling", o.truth_supersampling, "n x n samples a pixel of the truth")
      ->check(CLI::Range(1, 8));
  app.add_option("--settle", o.settle_seconds, "seconds to wait at most for a view to be complete");
  app.add_option("--realtime", o.realtime_fps,
                 "frames per second, drawn with the data that have arrived; 0: wait for each view");
  app.add_option("--bandwidth", a.bandwidth,
                 "link to emulate, such as 20Mbit or 384kbit (default: the loopback as it is)");
  app.add_option(
      "--latency", a.latency,
      "delay that the emulated link adds to each message towards the viewer, so once per round trip, such as "
      "30ms (default: none)");
  app.add_option(
         "--method", o.methods,
         "methods to run; the proxy without images goes with lumigraph; qsplat is drawn from the scene's file, and "
         "its bytes are the blocks that were looked into")
      ->delimiter(',')
      ->check(CLI::IsMember({"lumigraph", "patches", "qsplat"}));
  app.add_flag("!--no-pictures", o.pictures, "do not write each method's pictures");
}

// Reads the units of the link's options.
base::Result<void> parseLink(Arguments& a) {
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

}  // namespace

int main(int argc, char** argv) {
  // Warnings go to standard error, since standard output carries the figures.
  spdlog::set_default_logger(spdlog::stderr_color_mt("lumigrid-compare"));
  spdlog::set_level(spdlog::level::warn);
  CLI::App app(
      "Grid-Lumigraph, the same proxy without images, patches alone, and splats, against the truth: accuracy and bytes "
      "of every frame.",
      "lumigrid-compare");
  app.option_defaults()->always_capture_default();  // --help shows them
  Arguments arguments;
  declare(app, arguments);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  if (auto parsed = parseLink(arguments); !parsed) {
    fail(parsed.error());
    return 2;
  }
  auto frames = base::readCameraPath(arguments.path);
  if (!frames) return fail(frames.error());
  arguments.run.path = *frames;
  auto runs = compare::runComparison(arguments.run, [](const std::string& line) {
    std::printf("%s\n", line.c_str());
    std::fflush(stdout);
  });
  if (!runs) return fail(runs.error());
  std::printf("report: %s/index.html\n", arguments.run.report.c_str());
  return 0;
}
