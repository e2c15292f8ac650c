#pragma once
// The commands of the program `lumigrid`. Each add… function declares the options of one; the function that it returns
// runs the command after parsing and returns the exit status.
#include <CLI/CLI.hpp>
#include <functional>

namespace server::cli {

using RunCommand = std::function<int()>;

/// The hidden command by which `lumigrid build` starts itself to draw in several processes
/// (server/bake/draw_processes.h).
inline constexpr const char* kDrawCommand = "draw-images";

RunCommand addBuild(CLI::App& command);
RunCommand addDraw(CLI::App& command);
RunCommand addExport(CLI::App& command);
RunCommand addInfo(CLI::App& command);
RunCommand addVerify(CLI::App& command);
RunCommand addPublish(CLI::App& command);
RunCommand addRender(CLI::App& command);
RunCommand addSample(CLI::App& command);
RunCommand addServe(CLI::App& command);
RunCommand addSet(CLI::App& command);
RunCommand addSign(CLI::App& command);
RunCommand addTour(CLI::App& command);

}  // namespace server::cli
