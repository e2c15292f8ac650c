#pragma once
// An App for scripted events, without GL: the surface is a plane that the test knows.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <vector>

#include "client/app/app.h"
#include "tests/client/source/scripted_server.h"
#include "tests/support/range_host.h"

namespace client {

class AppTest : public ::testing::Test {
 protected:
  void SetUp() override { open({}); }

  void open(const Settings& settings, Method method = Method::kLumigraph) {
    AppOptions options;
    options.settings = settings;
    options.viewer.method = method;
    options.surface = [this](const base::ViewCamera& camera, double x, double y) { return plane(camera, x, y); };
    app = std::make_unique<App>(options, std::make_unique<support::NoDecoder>());
    app->resize(800, 600, 1.0);
    now = 0.0;
    app->advance(now);
  }
  void welcome() {
    app->session().connected();
    ASSERT_TRUE(bool(app->session().receive(server.sayWelcome())));
    pass(0.1);
  }
  void pass(double seconds) {
    for (double left = seconds; left > 1e-9; left -= 0.05) app->advance(now += std::min(left, 0.05));
  }

  /// Intersects the ray of a pixel with the horizontal plane through the middle of the model.
  std::optional<glm::dvec3> plane(const base::ViewCamera& camera, double x, double y) const {
    ++surface_asked;
    const glm::dvec3 right = glm::normalize(glm::cross(camera.direction, camera.up));
    const glm::dvec3 up = glm::cross(right, camera.direction);
    const double scale = 2.0 * std::tan(0.5 * camera.fov_y) / camera.height;
    const glm::dvec3 ray =
        camera.direction + (x - 0.5 * camera.width) * scale * right + (0.5 * camera.height - y) * scale * up;
    const double t = (middle().z + lift - camera.position.z) / ray.z;
    if (t <= 0.0 || background) return std::nullopt;
    return camera.position + t * ray;
  }
  glm::dvec3 middle() const {
    return server.welcome.origin + glm::dvec3(0.5F * (server.welcome.box_min + server.welcome.box_max));
  }
  glm::dvec3 extent() const { return glm::dvec3(server.welcome.box_max - server.welcome.box_min); }

  PointerEvent mouse(double x, double y, PointerButton button = PointerButton::kLeft, Modifiers modifiers = {}) {
    return {0, PointerKind::kMouse, button, modifiers, x, y, now};
  }
  void drag(const PointerEvent& from, double dx, double dy) {
    app->pointerDown(from);
    PointerEvent event = from;
    for (int i = 1; i <= 10; ++i) {
      event.x = from.x + 0.1 * i * dx;
      event.y = from.y + 0.1 * i * dy;
      event.now = now += 0.02;
      app->pointerMove(event);
    }
    app->pointerUp(event);
    app->advance(now);
  }
  void click(double x, double y) {
    app->pointerDown(mouse(x, y));
    now += 0.05;
    app->pointerUp(mouse(x, y));
    app->advance(now);
  }
  bool press(Key key, Modifiers modifiers = {}) {
    const bool taken = app->handleKey(key, true, modifiers, now);
    app->handleKey(key, false, modifiers, now);
    app->advance(now += 0.02);
    return taken;
  }
  void hold(Key key, double seconds, Modifiers modifiers = {}) {
    app->handleKey(key, true, modifiers, now);
    pass(seconds);
    app->handleKey(key, false, modifiers, now);
    app->advance(now);
  }
  std::vector<Request> requests(RequestKind kind) {
    std::vector<Request> found;
    for (Request& request : app->takeRequests())
      if (request.kind == kind) found.push_back(std::move(request));
    return found;
  }
  std::vector<Label> labels(LabelKind kind) const {
    std::vector<Label> found;
    for (const Label& label : app->labels())
      if (label.kind == kind) found.push_back(label);
    return found;
  }
  glm::dvec3 position() const { return app->view().position; }
  glm::dvec3 pivot() const { return position() + app->view().pivot_distance * app->view().direction; }
  static Annotation note(const glm::dvec3& at, const glm::dvec3& normal = {}) {
    Annotation annotation;
    annotation.position = at;
    annotation.normal = normal;
    annotation.title = "a note";
    return annotation;
  }

  ScriptedServer server;
  std::unique_ptr<App> app;
  double now = 0.0;
  double lift = 0.0;
  bool background = false;
  mutable int surface_asked = 0;
};

}  // namespace client
