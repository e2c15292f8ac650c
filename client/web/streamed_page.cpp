// Shows a method that streams a file of its own, from a server of ours or any other host.
#include <emscripten/emscripten.h>

#include <memory>

#include "client/app/streamed_settings.h"
#include "client/web/page.h"
#include "client/web/web_fetcher.h"

namespace client::web {

std::unique_ptr<SurfaceSight> (*const kPageSight)() = nullptr;

namespace {

std::shared_ptr<StreamedView> view;

}  // namespace
}  // namespace client::web

extern "C" {

/// Opens the method's file. `numbers`: as in client/web/page.h, the two being the length of the file, and 1 where the
/// browser is to save data.
EMSCRIPTEN_KEEPALIVE void openStreamed(const char* place, const char* name, const char* units, const char* start_view,
                                       const char* attribution, const char* file, const double* numbers) {
  client::App& app = *client::web::page.app;
  client::StreamedOptions options;
  static_cast<client::StreamedQuality&>(options) = client::qualityOf(app.settings());
  options.memory_bytes = app.viewer().options().memory_budget_bytes;
  options.clock = client::web::page.options.clock;
  if (numbers[client::web::kWelcomeNumbers + 1] != 0.0) options.idle_bytes = 0;
  const auto bytes = static_cast<std::uint64_t>(numbers[client::web::kWelcomeNumbers]);
  client::web::view =
      client::web::makeView({place, file, bytes}, client::web::welcomeOf(name, units, start_view, attribution, numbers),
                            std::make_unique<client::WebFetcher>(), options);
  app.viewer().setStreamed(client::web::view);
}

/// Returns 1 when something arrived.
EMSCRIPTEN_KEEPALIVE int pumpStatic(double now) {
  return client::web::view->pump(client::web::page.app->session(), now) ? 1 : 0;
}

/// Returns what cannot be shown though the rest goes on; mostly empty.
EMSCRIPTEN_KEEPALIVE const char* staticProblem() {
  return client::web::handOut(client::web::view->stats().warning);
}

}  // extern "C"
