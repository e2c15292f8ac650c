#pragma once
// What main.cpp, the functions that every page has, shares with where the scene comes from: static_page.cpp for patches
// and images, splat_page.cpp for splats. Each makes a WebAssembly of its own, so that neither carries the other's code.
#include <emscripten/html5.h>

#include <memory>
#include <string>
#include <vector>

#include "client/app/app.h"

namespace client::web {

struct Page {
  AppOptions options;
  std::unique_ptr<App> app;
  EMSCRIPTEN_WEBGL_CONTEXT_HANDLE context = 0;
  base::Bytes incoming, outgoing;
  std::vector<Annotation> annotations;     ///< on their way in
  void (*pick)(const Request&) = nullptr;  ///< set where rays are looked for here; else they are the page's
  std::string text;                        ///< what the last call handed out
};
extern Page page;

/// What this WebAssembly shows.
extern const Method kPageMethod;

/// Text for JavaScript, valid until the next call.
const char* handOut(std::string text);

}  // namespace client::web
