// The page's side of the thin client: what JavaScript calls (client/web/site/). Everything runs on the page's one
// thread; nothing here waits.
#include <GLES3/gl3.h>
#include <emscripten/emscripten.h>
#include <emscripten/html5.h>

#include <algorithm>
#include <memory>
#include <string>

#include "base/camera.h"
#include "client/viewer.h"
#include "client/web/web_decoder.h"

namespace {

struct Page {
  std::unique_ptr<client::Viewer> viewer;
  base::ViewCamera camera;
  base::Bytes incoming, outgoing;
  std::string text;
};
Page page;

}  // namespace

extern "C" {

EMSCRIPTEN_KEEPALIVE int start(const char* canvas) {
  EmscriptenWebGLContextAttributes attributes;
  emscripten_webgl_init_context_attributes(&attributes);
  attributes.majorVersion = 2;
  attributes.alpha = false;
  attributes.antialias = false;
  attributes.powerPreference = EM_WEBGL_POWER_PREFERENCE_HIGH_PERFORMANCE;
  const EMSCRIPTEN_WEBGL_CONTEXT_HANDLE context = emscripten_webgl_create_context(canvas, &attributes);
  if (context <= 0 || emscripten_webgl_make_context_current(context) != EMSCRIPTEN_RESULT_SUCCESS) return 0;
  client::ViewerOptions options;
  page.viewer = std::make_unique<client::Viewer>(options, std::make_unique<client::WebDecoder>());
  return 1;
}

EMSCRIPTEN_KEEPALIVE void setCamera(double px, double py, double pz, double dx, double dy, double dz, double ux,
                                    double uy, double uz, double fov, int width, int height) {
  page.camera.position = {px, py, pz};
  page.camera.direction = {dx, dy, dz};
  page.camera.up = {ux, uy, uz};
  page.camera.fov_y = fov;
  page.camera.width = width;
  page.camera.height = height;
}

EMSCRIPTEN_KEEPALIVE int frame(double now) {
  glBindFramebuffer(GL_FRAMEBUFFER, 0);
  auto drawn = page.viewer->draw(page.camera, now);
  if (!drawn) page.text = drawn.error().message;
  return drawn ? (page.viewer->stats().complete ? 2 : 1) : 0;
}

EMSCRIPTEN_KEEPALIVE const char* lastText() {
  return page.text.c_str();
}

// ---- the link ----

EMSCRIPTEN_KEEPALIVE void connected() {
  page.viewer->session().connected();
}
EMSCRIPTEN_KEEPALIVE void disconnected(const char* reason) {
  page.viewer->session().disconnected(reason);
}
EMSCRIPTEN_KEEPALIVE std::uint8_t* messageBuffer(std::size_t size) {
  page.incoming.resize(size);
  return page.incoming.data();
}
EMSCRIPTEN_KEEPALIVE int receiveMessage() {
  auto taken = page.viewer->session().receive(page.incoming);
  if (!taken) page.text = taken.error().message;
  return taken ? 1 : 0;
}
/// Bytes of the next message to send, 0 when there is none; messageToSend() is where they lie.
EMSCRIPTEN_KEEPALIVE std::size_t nextToSend() {
  auto next = page.viewer->session().nextToSend();
  page.outgoing = next ? std::move(*next) : base::Bytes();
  return page.outgoing.size();
}
EMSCRIPTEN_KEEPALIVE const std::uint8_t* messageToSend() {
  return page.outgoing.data();
}

}  // extern "C"
