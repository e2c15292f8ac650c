#pragma once
// The commands of the program `lumigrid`. Each add… function declares its options; the returned function runs it after
// parsing and returns the exit status.
#include <CLI/CLI.hpp>
#include <functional>

namespace server::cli {

using Run = std::function<int()>;

/// What build starts to draw in several processes (server/bake/draw_processes.h).
inline constexpr const char* kDrawCommand = "draw-images";

Run addBuild(CLI::App& command);
Run addDraw(CLI::App& command);
Run addInfo(CLI::App& command);
Run addVerify(CLI::App& command);
Run addPublish(CLI::App& command);
Run addRender(CLI::App& command);
Run addSample(CLI::App& command);
Run addServe(CLI::App& command);
Run addTour(CLI::App& command);

}  // namespace server::cli
