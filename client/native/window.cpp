#include "client/native/window.h"

#define GLFW_INCLUDE_NONE
#include <GLES3/gl3.h>
#include <GLFW/glfw3.h>
#include <imgui/backends/imgui_impl_glfw.h>
#include <imgui/backends/imgui_impl_opengl3.h>
#include <imgui/imgui.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <memory>
#include <optional>

#include "base/json/camera_file.h"
#include "client/native/jpeg_decoder.h"
#include "client/orbit_control.h"

namespace client {
namespace {

/// Two presses within this time and distance are a double click.
constexpr double kDoubleClickSeconds = 0.35;
constexpr double kDoubleClickPixels = 6.0;
/// With nothing to draw, input wakes the loop at once and the network within this time.
constexpr double kIdleSeconds = 0.02;
/// Pivot distances per second.
constexpr double kFlySpeed = 0.6;

constexpr const char* kHelp =
    "left drag orbit | right or shift drag pan | wheel zoom | double click pivot | W A S D Q E fly | R reset | "
    "F2 copy camera | F1 figures";

std::string lastGlfwError() {
  const char* text = nullptr;
  glfwGetError(&text);
  return text != nullptr ? text : "no reason given";
}

std::string describeBytes(std::uint64_t bytes) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.2f MB", 1e-6 * static_cast<double>(bytes));
  return text;
}

class Window {
 public:
  explicit Window(const WindowOptions& options) : options_(options) {}
  ~Window();
  Window(const Window&) = delete;
  Window& operator=(const Window&) = delete;
  base::Result<void> open();
  base::Result<void> run();

 private:
  enum class Drag { kNone, kOrbit, kPan };

  bool createWindow(int context_api);
  void startOverlay();
  static Window& of(GLFWwindow* window) { return *static_cast<Window*>(glfwGetWindowUserPointer(window)); }
  void installCallbacks();
  void onButton(int button, int action, int mods);
  void onMove(double x, double y);
  void onWheel(double steps);
  void onKey(int key, int action);
  void fly(double seconds);
  void frameNewScene();
  bool overlayWantsMouse() const { return ImGui::GetIO().WantCaptureMouse; }
  glm::dvec2 cursor() const;
  std::optional<glm::dvec3> surfaceUnder(const glm::dvec2& at) {
    return viewer_->surfaceAt(control_.camera(), at.x, at.y);
  }

  base::Result<void> drawFrame(double now);
  void drawFigures(const ViewerStats& stats);
  void drawState();

  const WindowOptions& options_;
  GLFWwindow* window_ = nullptr;
  bool overlay_ready_ = false;
  std::unique_ptr<Viewer> viewer_;
  std::unique_ptr<Link> connection_;
  OrbitControl control_;
  std::optional<protocol::Welcome> framed_;  // the scene that the first view was chosen for
  Drag drag_ = Drag::kNone;
  glm::dvec2 last_cursor_{0.0};
  double last_press_ = -1.0;
  glm::dvec2 last_press_at_{0.0};
  bool input_ = true;  // something happened that asks for a new picture
  bool show_figures_ = false;
  double frame_seconds_ = 0.0;  // smoothed
  double draw_seconds_ = 0.0;
};

// ---- opening and closing ----

Window::~Window() {
  // GL objects go while their context is there.
  connection_.reset();
  viewer_.reset();
  if (overlay_ready_) {
    ImGui_ImplOpenGL3_Shutdown();
    ImGui_ImplGlfw_Shutdown();
    ImGui::DestroyContext();
  }
  if (window_ != nullptr) glfwDestroyWindow(window_);
  glfwTerminate();
}

bool Window::createWindow(int context_api) {
  glfwDefaultWindowHints();
  glfwWindowHint(GLFW_CLIENT_API, GLFW_OPENGL_ES_API);
  glfwWindowHint(GLFW_CONTEXT_CREATION_API, context_api);
  glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 3);
  glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 0);
  glfwWindowHint(GLFW_DEPTH_BITS, 24);
  glfwWindowHint(GLFW_SCALE_TO_MONITOR, GLFW_TRUE);
  window_ = glfwCreateWindow(options_.width, options_.height, "Lumigrid", nullptr, nullptr);
  return window_ != nullptr;
}

base::Result<void> Window::open() {
  auto link = openLink(options_.url, options_.link);
  if (!link) return link.error();
  connection_ = std::move(*link);
  if (glfwInit() != GLFW_TRUE)
    return base::Error{base::ErrorCode::kUnsupported,
                       "cannot open a window (" + lastGlfwError() + "); without a display use --headless"};
  if (!createWindow(GLFW_EGL_CONTEXT_API) && !createWindow(GLFW_NATIVE_CONTEXT_API))
    return base::Error{base::ErrorCode::kUnsupported, "cannot make an OpenGL ES 3.0 context (" + lastGlfwError() +
                                                          "); update the graphics driver or use --headless"};
  glfwMakeContextCurrent(window_);
  glfwSwapInterval(1);
  installCallbacks();
  startOverlay();
  show_figures_ = options_.show_figures;

  viewer_ =
      std::make_unique<Viewer>(options_.viewer, std::make_unique<JpegDecoder>(std::max(1U, options_.decoder_threads)));
  return {};
}

/// After our own callbacks, which Dear ImGui then calls before its own.
void Window::startOverlay() {
  IMGUI_CHECKVERSION();
  ImGui::CreateContext();
  ImGui::GetIO().IniFilename = nullptr;
  float scale = 1.0F;
  glfwGetWindowContentScale(window_, &scale, nullptr);
  int window_width = 1;
  int pixel_width = 1;
  glfwGetWindowSize(window_, &window_width, nullptr);
  glfwGetFramebufferSize(window_, &pixel_width, nullptr);
  ImGui::GetIO().FontGlobalScale =
      scale * static_cast<float>(std::max(window_width, 1)) / static_cast<float>(std::max(pixel_width, 1));
  ImGui_ImplGlfw_InitForOpenGL(window_, true);
  ImGui_ImplOpenGL3_Init("#version 300 es");
  overlay_ready_ = true;
}

void Window::installCallbacks() {
  glfwSetWindowUserPointer(window_, this);
  glfwSetMouseButtonCallback(
      window_, [](GLFWwindow* w, int button, int action, int mods) { of(w).onButton(button, action, mods); });
  glfwSetCursorPosCallback(window_, [](GLFWwindow* w, double, double) {
    const glm::dvec2 at = of(w).cursor();
    of(w).onMove(at.x, at.y);
  });
  glfwSetScrollCallback(window_, [](GLFWwindow* w, double, double steps) { of(w).onWheel(steps); });
  glfwSetKeyCallback(window_, [](GLFWwindow* w, int key, int, int action, int) { of(w).onKey(key, action); });
  glfwSetFramebufferSizeCallback(window_, [](GLFWwindow* w, int, int) { of(w).input_ = true; });
  glfwSetWindowRefreshCallback(window_, [](GLFWwindow* w) { of(w).input_ = true; });
}

// ---- mouse and keys ----

/// The cursor in framebuffer pixels.
glm::dvec2 Window::cursor() const {
  double x = 0.0;
  double y = 0.0;
  int width = 1;
  int height = 1;
  glfwGetCursorPos(window_, &x, &y);
  glfwGetWindowSize(window_, &width, &height);
  return {x * control_.camera().width / std::max(width, 1), y * control_.camera().height / std::max(height, 1)};
}

void Window::onButton(int button, int action, int mods) {
  input_ = true;
  if (action == GLFW_RELEASE) {
    drag_ = Drag::kNone;
    return;
  }
  if (overlayWantsMouse()) return;
  const glm::dvec2 at = cursor();
  last_cursor_ = at;

  // A second press at once sets the pivot.
  const double now = glfwGetTime();
  const bool twice = button == GLFW_MOUSE_BUTTON_LEFT && now - last_press_ < kDoubleClickSeconds &&
                     glm::length(at - last_press_at_) < kDoubleClickPixels;
  last_press_ = now;
  last_press_at_ = at;
  if (twice) {
    if (const auto surface = surfaceUnder(at)) control_.setPivot(*surface);
    return;
  }

  const bool pan = button != GLFW_MOUSE_BUTTON_LEFT || (mods & GLFW_MOD_SHIFT) != 0;
  drag_ = pan ? Drag::kPan : Drag::kOrbit;
  if (pan) control_.grab(at.x, at.y, surfaceUnder(at));
}

void Window::onMove(double x, double y) {
  const glm::dvec2 at(x, y);
  if (drag_ == Drag::kOrbit) control_.orbit(at.x - last_cursor_.x, at.y - last_cursor_.y);
  if (drag_ == Drag::kPan) control_.dragTo(at.x, at.y);
  last_cursor_ = at;
  input_ = true;
}

void Window::onWheel(double steps) {
  if (overlayWantsMouse()) return;
  const glm::dvec2 at = cursor();
  control_.zoom(steps, at.x, at.y, surfaceUnder(at));
  input_ = true;
}

void Window::onKey(int key, int action) {
  input_ = true;
  if (action != GLFW_PRESS) return;
  if (key == GLFW_KEY_F1) show_figures_ = !show_figures_;
  if (key == GLFW_KEY_F2) glfwSetClipboardString(window_, base::formatCameraPath({control_.camera()}).c_str());
  if (key == GLFW_KEY_R) control_.reset();
}

void Window::fly(double seconds) {
  struct Key {
    int key;
    glm::dvec3 direction;
  };
  static constexpr std::array<Key, 6> kKeys{{{GLFW_KEY_D, glm::dvec3(1.0, 0.0, 0.0)},
                                             {GLFW_KEY_A, glm::dvec3(-1.0, 0.0, 0.0)},
                                             {GLFW_KEY_E, glm::dvec3(0.0, 1.0, 0.0)},
                                             {GLFW_KEY_Q, glm::dvec3(0.0, -1.0, 0.0)},
                                             {GLFW_KEY_W, glm::dvec3(0.0, 0.0, 1.0)},
                                             {GLFW_KEY_S, glm::dvec3(0.0, 0.0, -1.0)}}};
  glm::dvec3 direction(0.0);
  for (const Key& one : kKeys)
    if (glfwGetKey(window_, one.key) == GLFW_PRESS) direction += one.direction;
  if (direction == glm::dvec3(0.0)) return;
  control_.fly(kFlySpeed * std::min(seconds, 0.1) * direction);
  input_ = true;
}

/// The first view of a scene, and of another one that took its place after a reconnect.
void Window::frameNewScene() {
  const protocol::Welcome* welcome = viewer_->session().welcome();
  if (welcome == nullptr) return;
  if (framed_ && framed_->scene_name == welcome->scene_name && framed_->origin == welcome->origin &&
      framed_->box_min == welcome->box_min && framed_->box_max == welcome->box_max)
    return;
  framed_ = *welcome;
  control_.frameBox(welcome->origin + glm::dvec3(welcome->box_min), welcome->origin + glm::dvec3(welcome->box_max),
                    glm::dvec3(welcome->up));
  glfwSetWindowTitle(window_, ("Lumigrid: " + welcome->scene_name).c_str());
  input_ = true;
}

// ---- drawing ----

void Window::drawFigures(const ViewerStats& stats) {
  const Session& session = viewer_->session();
  const LumigraphStats& drawn = stats.lumigraph;
  ImGui::SetNextWindowPos(ImVec2(8.0F, 8.0F));
  ImGui::SetNextWindowBgAlpha(0.6F);
  ImGui::Begin("figures", nullptr,
               ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoInputs |
                   ImGuiWindowFlags_NoNav);
  ImGui::Text("%5.1f frames/s, %.1f ms to draw", frame_seconds_ > 0.0 ? 1.0 / frame_seconds_ : 0.0,
              1e3 * draw_seconds_);
  ImGui::Text("images    %u used, %u on the GPU, %u depth maps", drawn.samples_used, drawn.samples_resident,
              drawn.depth_maps_drawn);
  ImGui::Text("patches   %u with %llu triangles, error %.2f px", drawn.patches,
              static_cast<unsigned long long>(drawn.triangles), static_cast<double>(stats.error_px));
  ImGui::Text("received  %s: images %s, patches %s, frames %s", describeBytes(stats.session.bytes_received).c_str(),
              describeBytes(stats.session.bytes_faces).c_str(), describeBytes(stats.session.bytes_patches).c_str(),
              describeBytes(stats.session.bytes_frames).c_str());
  ImGui::Text("cache     %s of %s, GPU %s", describeBytes(stats.session.cache_bytes).c_str(),
              describeBytes(session.options().cache_bytes).c_str(), describeBytes(drawn.gpu_bytes).c_str());
  ImGui::Text("view      %s", stats.complete ? "complete" : "on its way");
  if (stats.broken > 0) ImGui::Text("broken    %u, latest: %s", stats.broken, stats.last_fault.c_str());
  ImGui::Separator();
  ImGui::TextUnformatted(kHelp);
  ImGui::End();
}

/// What the user has to know when all is not well, at the foot of the window.
void Window::drawState() {
  const Session& session = viewer_->session();
  if (session.state() == SessionState::kReady) return;
  const std::string text = session.problem().empty() ? "connecting to " + options_.url + " ..." : session.problem();
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos(ImVec2(0.5F * size.x, size.y - 12.0F), ImGuiCond_Always, ImVec2(0.5F, 1.0F));
  ImGui::SetNextWindowBgAlpha(0.8F);
  ImGui::Begin("state", nullptr,
               ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoInputs |
                   ImGuiWindowFlags_NoNav);
  ImGui::TextUnformatted(text.c_str());
  if (!session.problem().empty()) ImGui::TextUnformatted("trying again; what is here can be looked at meanwhile");
  ImGui::End();
}

base::Result<void> Window::drawFrame(double now) {
  // The scene.
  const double begin = glfwGetTime();
  glBindFramebuffer(GL_FRAMEBUFFER, 0);
  glViewport(0, 0, control_.camera().width, control_.camera().height);
  if (framed_) {
    LUMIGRID_TRY(viewer_->draw(control_.camera(), now));
  } else {
    const float* color = options_.viewer.lumigraph.background;
    glClearColor(color[0], color[1], color[2], color[3]);
    glClear(GL_COLOR_BUFFER_BIT);
  }
  draw_seconds_ += 0.1 * (glfwGetTime() - begin - draw_seconds_);

  // Words on top of it.
  glBindFramebuffer(GL_FRAMEBUFFER, 0);
  ImGui_ImplOpenGL3_NewFrame();
  ImGui_ImplGlfw_NewFrame();
  ImGui::NewFrame();
  if (show_figures_) drawFigures(viewer_->stats());
  drawState();
  ImGui::Render();
  ImGui_ImplOpenGL3_RenderDrawData(ImGui::GetDrawData());
  glfwSwapBuffers(window_);
  return {};
}

base::Result<void> Window::run() {
  double last = glfwGetTime();
  SessionState last_state = SessionState::kDisconnected;
  while (glfwWindowShouldClose(window_) == GLFW_FALSE) {
    glfwPollEvents();
    const double now = glfwGetTime();
    fly(now - last);
    frame_seconds_ += 0.1 * (now - last - frame_seconds_);
    last = now;

    // A minimised window has no pixels.
    int width = 0;
    int height = 0;
    glfwGetFramebufferSize(window_, &width, &height);
    const bool arrived = connection_->pump(viewer_->session());
    if (width == 0 || height == 0) {
      glfwWaitEventsTimeout(kIdleSeconds);
      continue;
    }
    control_.setViewport(width, height);
    frameNewScene();

    // A picture that would look the same is not drawn again.
    const SessionState state = viewer_->session().state();
    const bool changed = input_ || arrived || state != last_state || viewer_->stats().busy;
    last_state = state;
    if (!changed) {
      glfwWaitEventsTimeout(kIdleSeconds);
      continue;
    }
    input_ = false;
    LUMIGRID_TRY(drawFrame(now));
  }
  return {};
}

}  // namespace

base::Result<void> runWindow(const WindowOptions& options) {
  Window window(options);
  LUMIGRID_TRY(window.open());
  return window.run();
}

}  // namespace client
