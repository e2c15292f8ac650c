// Shows patches and images, from a server or from a published scene.
#include <emscripten/emscripten.h>

#include <memory>

#include "client/web/page.h"
#include "client/web/web_scene.h"

namespace client::web {

const Method kPageMethod = Method::kLumigraph;

namespace {

std::unique_ptr<WebScene> scene;  // null with a server

void pick(const Request& request) {
  scene->source().pick(request.id, request.origin, request.direction);
}

}  // namespace
}  // namespace client::web

extern "C" {

/// Opens a published scene. `numbers`: as in client/web/web_welcome.h, then the lengths of the patches and of the index
/// (0: none).
EMSCRIPTEN_KEEPALIVE void openStatic(const char* place, const char* name, const char* units, const char* patches,
                                     const char* index, const double* numbers) {
  client::web::scene = std::make_unique<client::WebScene>(place, name, units, patches, index, numbers);
  client::web::page.pick = client::web::pick;
}

/// Returns 1 when something arrived.
EMSCRIPTEN_KEEPALIVE int pumpStatic(double now) {
  client::App& app = *client::web::page.app;
  client::StaticSource& source = client::web::scene->source();
  bool came = source.pump(app.session(), now);
  for (const client::AnsweredPick& pick : source.takePicks()) {
    app.answerPick(pick.id, pick.answer);
    came = true;
  }
  return came ? 1 : 0;
}

/// Returns what cannot be shown though the rest goes on; mostly empty.
EMSCRIPTEN_KEEPALIVE const char* staticProblem() {
  return client::web::scene->source().problem().c_str();
}

}  // extern "C"
