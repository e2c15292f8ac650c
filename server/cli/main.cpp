// The program lumigrid builds, describes, checks, renders, publishes and serves scenes.
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <sys/resource.h>

#include <CLI/CLI.hpp>
#include <vector>

#include "server/cli/commands.h"
#include "server/cli/console.h"

namespace {

// Each shard of a repository takes three open files, each viewer one. The usual soft limit of 1024 files is there for
// programs that use select(), which this one does not.
void raiseFileLimit() {
  rlimit files{};
  if (::getrlimit(RLIMIT_NOFILE, &files) != 0 || files.rlim_cur == files.rlim_max) return;
  files.rlim_cur = files.rlim_max;
  ::setrlimit(RLIMIT_NOFILE, &files);
}

}  // namespace

int main(int argc, char** argv) {
  using namespace server::cli;
  raiseFileLimit();
  // Logs go to standard error: standard output is for results, so that --json can be piped.
  spdlog::set_default_logger(spdlog::stderr_color_mt("lumigrid"));
  spdlog::set_pattern("%Y-%m-%dT%H:%M:%S.%e %l %v");

  CLI::App app(
      "Lumigrid: look at scanned meshes of any size from any machine.\n\nFirst steps:\n  lumigrid build scan.ply -o "
      "scene\n  lumigrid serve scene\n  lumigrid-view ws://127.0.0.1:8080/",
      "lumigrid");
  app.set_version_flag("--version", "lumigrid 0.1.0");
  app.require_subcommand(1);
  app.option_defaults()->always_capture_default();  // --help shows them; empty lists say default_str("")
  struct Command {
    CLI::App* parser;
    RunCommand run;
  };
  std::vector<Command> commands;
  auto add = [&](const char* name, const char* help, RunCommand (*declare)(CLI::App&)) {
    CLI::App* parser = app.add_subcommand(name, help);
    commands.push_back({parser, declare(*parser)});
    return parser;
  };
  add("build", "Build a scene from meshes: patch hierarchy and image repository. Resumes where it was stopped.",
      addBuild);
  add("serve", "Serve a scene to viewers over WebSocket and HTTP on one port.", addServe);
  add("sign", "Make a link that opens one private scene for a time.", addSign);
  add("publish", "Write a scene as files that never change, for a web server or an object store to serve.", addPublish);
  add("export", "Write a scene for other programs: as 3D Tiles, or as one mesh in PLY or GLB.", addExport);
  add("info", "Say what is in a scene.", addInfo);
  add("set",
      "Change how a scene is shown: up, north, units, coordinates, title, authors, background, first view, light.",
      addSet);
  add("verify", "Read everything in a scene; check every checksum, bound and link.", addVerify);
  add("render", "Render a picture of a scene to PNG.", addRender);
  add("tour", "Write a camera path around a scene, for lumigrid-view --headless and lumigrid-compare.", addTour);
  add(kDrawCommand, "Draw images for a build that started this.", addDraw)->group("");  // not in --help
  add("sample", "Generate a scan-like mesh of any size: as PLY, or with textures as OBJ.", addSample);

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kDone : kWrongUsage;
  }
  for (const Command& command : commands)
    if (command.parser->parsed()) return command.run();
  return kWrongUsage;
}
