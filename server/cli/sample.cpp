#include "mesh/generate/sample.h"

#include <fstream>
#include <memory>

#include "server/cli/commands.h"
#include "server/cli/console.h"

namespace server::cli {
namespace {

struct SampleArguments {
  std::string output;
  std::string shape = "statue";
  std::vector<double> origin{0.0, 0.0, 0.0};
  bool no_colors = false;
  bool points = false;
  bool force = false;
  mesh::generate::SampleOptions options;
};

int run(SampleArguments& a) {
  a.options.shape = a.shape == "relief" ? mesh::generate::SampleShape::kRelief : mesh::generate::SampleShape::kStatue;
  a.options.colors = !a.no_colors;
  a.options.faces = !a.points;
  a.options.origin = {a.origin[0], a.origin[1], a.origin[2]};
  if (!a.force && std::ifstream(a.output).good())
    return fail({base::ErrorCode::kExists, a.output + ": exists already; choose another name or say --force"});
  ProgressLine line(false);
  stopOnSignals();
  auto written = mesh::generate::writeSamplePly(a.options, a.output, [&](double done) {
    line.show("sample", done);
    return !stopRequested();
  });
  line.finish();
  return exitStatus(written);
}

}  // namespace

RunCommand addSample(CLI::App& command) {
  auto a = std::make_shared<SampleArguments>();
  command.add_option("-o,--output", a->output, "PLY file to write")->required();
  command.add_option("--triangles", a->options.triangles, "triangle count, 10000 to 1000000000 (within 2 %)")
      ->transform(CLI::AsSizeValue(true))
      ->check(CLI::Range(std::uint64_t{10'000}, std::uint64_t{1'000'000'000}))
      ->default_str("1000000");
  command.add_option("--shape", a->shape, "statue: closed; relief: an open panel")
      ->check(CLI::IsMember({"statue", "relief"}));
  command.add_option("--seed", a->options.seed, "same seed, same bytes, on any machine");
  command.add_option("--origin", a->origin, "added to every position, e.g. survey coordinates")->expected(3);
  command.add_flag("--no-colors", a->no_colors, "leave vertex colours out");
  command.add_flag("--points", a->points, "a point cloud: leave faces out (vertices are half as many as triangles)");
  command.add_flag("--force", a->force, "replace the output");
  return [a] { return run(*a); };
}

}  // namespace server::cli
