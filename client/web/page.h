#pragma once
// Shared by main.cpp, which has the functions of every page, and the two sources of scenes: static_page.cpp for patches
// and images, streamed_page.cpp for methods that stream a file of their own, which splat_page.cpp, umbrella_page.cpp
// and hlod_page.cpp name. Each method makes a WebAssembly module of its own, so that none carries another's code.
#include <emscripten/html5.h>

#include <memory>
#include <string>
#include <vector>

#include "client/app/app.h"
#include "client/source/streamed_file.h"

namespace client::web {

/// Makes the lines of sight of a page with images (ViewerOptions::make_sight), else null.
extern std::unique_ptr<SurfaceSight> (*const kPageSight)();

struct Page {
  AppOptions options{.viewer = {.make_sight = kPageSight}};
  std::unique_ptr<App> app;
  EMSCRIPTEN_WEBGL_CONTEXT_HANDLE context = 0;
  base::Bytes incoming, outgoing;
  std::vector<Annotation> annotations;  ///< collected by addAnnotation()
  void (*pick)(const Request&) =
      nullptr;       ///< casts rays, where this module can; else null, and the page asks the server
  std::string text;  ///< text that the last call returned
};
extern Page page;

/// The method that this WebAssembly module shows.
extern const Method kPageMethod;

/// Makes the view of the streamed method that this module shows.
std::shared_ptr<StreamedView> makeView(FilePlace file, const protocol::Welcome& welcome,
                                       std::unique_ptr<RangeFetcher> fetcher, const StreamedOptions& options);

/// Count of the numbers that the page's JavaScript reads from scene.json (client/web/site/static_scene.js): origin,
/// box_min, box_max, up (world, 3 each), 1 when unlit and 2 with shadows, the light's direction (3), the first
/// direction (3), the background as 0xrrggbb or -1, north in degrees or NaN, the count of the hull's points.
inline constexpr int kWelcomeNumbers = 22;
/// Three numbers of the function that opens the scene come next, then those points (3 each), then more of the function.
inline constexpr int kHullAt = kWelcomeNumbers + 3;
/// Makes a Welcome from these values.
protocol::Welcome welcomeOf(const std::string& name, const std::string& units, const std::string& start_view,
                            const std::string& attribution, const double* numbers);

/// Keeps a text for JavaScript, valid until the next call.
const char* handOut(std::string text);

}  // namespace client::web
