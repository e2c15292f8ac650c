#include "mesh/generate/sample.h"

#include <fstream>
#include <memory>
#include <optional>

#include "mesh/generate/textured.h"
#include "server/cli/commands.h"
#include "server/cli/console.h"

namespace server::cli {
namespace {

using mesh::generate::SampleOptions;
using mesh::generate::SampleShape;
using mesh::generate::TexturedOptions;
using mesh::generate::TexturedShape;

struct SampleArguments {
  std::string output;
  std::string shape = "statue";
  std::uint64_t triangles = 1'000'000;
  std::optional<std::uint64_t> texels;
  std::uint64_t seed = 1;
  std::vector<double> origin{0.0, 0.0, 0.0};
  bool no_colors = false;
  bool points = false;
  bool force = false;
};

glm::dvec3 originOf(const SampleArguments& a) {
  return {a.origin[0], a.origin[1], a.origin[2]};
}

/// Nothing for shapes that are written as PLY.
std::optional<TexturedShape> texturedShapeNamed(const std::string& name) {
  if (name == "facade") return TexturedShape::kFacade;
  if (name == "terrain") return TexturedShape::kTerrain;
  if (name == "rooms") return TexturedShape::kRooms;
  return std::nullopt;
}

/// One of the two kinds of files, and how it is written.
struct SampleFiles {
  std::vector<std::string> names;
  std::function<base::Result<void>(const std::function<bool(double)>& progress)> write;
};

SampleFiles plyOf(const SampleArguments& a) {
  SampleOptions options;
  options.shape = a.shape == "relief" ? SampleShape::kRelief : SampleShape::kStatue;
  options.triangles = a.triangles;
  options.seed = a.seed;
  options.colors = !a.no_colors;
  options.faces = !a.points;
  options.origin = originOf(a);
  return {{a.output}, [options, path = a.output](const auto& progress) {
            return mesh::generate::writeSamplePly(options, path, progress);
          }};
}

base::Result<SampleFiles> texturedObjOf(const SampleArguments& a, TexturedShape shape) {
  TexturedOptions options;
  options.shape = shape;
  options.triangles = a.triangles;
  options.texels = a.texels.value_or(options.texels);
  options.seed = a.seed;
  options.origin = originOf(a);
  LUMIGRID_ASSIGN_OR_RETURN(auto names, mesh::generate::texturedFiles(options, a.output));
  return SampleFiles{std::move(names), [options, path = a.output](const auto& progress) {
                       return mesh::generate::writeTexturedObj(options, path, progress);
                     }};
}

/// A combination of options that parsing them one by one cannot refuse; empty where there is none.
std::string wrongUsage(const SampleArguments& a, std::optional<TexturedShape> textured) {
  const auto outside = [&](std::uint64_t low, std::uint64_t high) {
    return a.triangles < low || a.triangles > high ? "--triangles: " + a.shape + " has between " + std::to_string(low) +
                                                         " and " + std::to_string(high) + " of them"
                                                   : std::string();
  };
  if (!textured && a.texels) return a.shape + " has no textures; --texels is for OBJ shapes";
  if (!textured) return outside(10'000, 1'000'000'000);
  if (a.no_colors || a.points) return a.shape + " has textures and faces; --no-colors and --points are for PLY shapes";
  return outside(mesh::generate::leastTriangles(*textured), mesh::generate::kMaxTexturedTriangles);
}

int refuse(const std::string& message) {
  fail({base::ErrorCode::kInvalidInput, message});
  return kWrongUsage;
}

int run(SampleArguments& a) {
  const auto textured = texturedShapeNamed(a.shape);
  if (const std::string problem = wrongUsage(a, textured); !problem.empty()) return refuse(problem);
  SampleFiles files;
  if (textured) {
    auto planned = texturedObjOf(a, *textured);
    if (!planned) return refuse(planned.error().message);
    files = std::move(*planned);
  } else {
    files = plyOf(a);
  }
  for (const std::string& name : files.names)
    if (!a.force && std::ifstream(name).good())
      return fail({base::ErrorCode::kExists, name + ": exists already; choose another name or say --force"});
  ProgressLine line(false);
  stopOnSignals();
  const auto written = files.write([&](double done) {
    line.show("sample", done);
    return !stopRequested();
  });
  line.finish();
  return exitStatus(written);
}

}  // namespace

RunCommand addSample(CLI::App& command) {
  auto a = std::make_shared<SampleArguments>();
  command
      .add_option("-o,--output", a->output,
                  "PLY file to write; facade, terrain and rooms: OBJ file, beside which come its .mtl and .jpg files")
      ->required();
  command
      .add_option("--triangles", a->triangles,
                  "triangle count (within 2 %), 10000 to 1000000000; facade and terrain: 128, rooms: 500, to 100000000")
      ->transform(CLI::AsSizeValue(true))
      ->default_str("1000000");
  command
      .add_option("--shape", a->shape,
                  "statue: closed; relief: an open panel; facade: a house front with textures; terrain: hills under an "
                  "orthophoto; rooms: a flat from inside, with textures")
      ->check(CLI::IsMember({"statue", "relief", "facade", "terrain", "rooms"}));
  command
      .add_option("--texels", a->texels,
                  "facade, terrain and rooms: texels of the pictures for each triangle, 1 to 100000")
      ->check(CLI::Range(std::uint64_t{1}, mesh::generate::kMaxTexels))
      ->default_str("500");
  command.add_option("--seed", a->seed, "same seed, same mesh and colours, on any machine");
  command.add_option("--origin", a->origin, "added to every position, e.g. survey coordinates")->expected(3);
  command.add_flag("--no-colors", a->no_colors, "leave vertex colours out");
  command.add_flag("--points", a->points, "a point cloud: leave faces out (vertices are half as many as triangles)");
  command.add_flag("--force", a->force, "replace the output");
  return [a] { return run(*a); };
}

}  // namespace server::cli
