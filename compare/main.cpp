// lumigrid-compare: speed against accuracy, over real sockets, on one page (DESIGN section 9).
#include <CLI/CLI.hpp>
#include <cstdio>

#include "base/json/camera_file.h"
#include "compare/run.h"

namespace {

int fail(const base::Error& error) {
  std::fprintf(stderr, "lumigrid-compare: %s\n", error.message.c_str());
  return 1;
}

void declare(CLI::App& app, compare::RunOptions& o, std::string& path, double& megabits, double& milliseconds) {
  app.add_option("SCENE", o.scene, "scene directory")->required();
  app.add_option("--path", path, "camera path as JSON (`lumigrid tour` writes one)")->required();
  app.add_option("--report", o.report, "directory for results.csv, charts and index.html")->required();
  app.add_option("--patch-tolerances", o.patch_tolerances, "pixels: settings of patches alone")
      ->delimiter(',')
      ->check(CLI::Range(0.1, 1000.0))
      ->capture_default_str();
  app.add_option("--proxy-tolerance", o.proxy_tolerance, "pixels: of the proxy under the images")
      ->check(CLI::Range(0.1, 1000.0))
      ->capture_default_str();
  app.add_option("--points", o.points, "sampling points per view")->check(CLI::Range(1, 64))->capture_default_str();
  app.add_option("--samples", o.samples, "images blended per frame at most")
      ->check(CLI::Range(1, 32))
      ->capture_default_str();
  app.add_flag("!--no-frames", o.frames, "leave the run with exact frames out");
  app.add_option("--truth-supersampling", o.truth_supersampling, "n x n samples a pixel of the truth")
      ->check(CLI::Range(1, 8))
      ->capture_default_str();
  app.add_option("--settle", o.settle_seconds, "seconds to wait at most for a view to be complete")
      ->capture_default_str();
  app.add_option("--realtime", o.realtime_fps, "frames per second, drawn whatever has come; 0: wait for each view")
      ->capture_default_str();
  app.add_option("--bandwidth-mbit", megabits, "link to emulate, Mbit/s; 0: loopback as it is")->capture_default_str();
  app.add_option("--latency-ms", milliseconds, "round trip of that link")->capture_default_str();
  app.add_flag("!--no-pictures", o.pictures, "do not write each method's pictures");
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app(
      "Grid-Lumigraph, the same proxy without images, and patches alone, against the truth: accuracy and bytes of "
      "every frame.",
      "lumigrid-compare");
  compare::RunOptions options;
  std::string path;
  double megabits = 0.0;
  double milliseconds = 0.0;
  declare(app, options, path, megabits, milliseconds);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  auto frames = base::readCameraPath(path);
  if (!frames) return fail(frames.error());
  options.path = *frames;
  options.bytes_per_second = megabits * 1e6 / 8.0;
  options.latency_seconds = milliseconds / 1000.0;
  auto runs = compare::runComparison(
      options, [](const std::string& line) { std::printf("%s\n", line.c_str()), std::fflush(stdout); });
  if (!runs) return fail(runs.error());
  std::printf("report: %s/index.html\n", options.report.c_str());
  return 0;
}
