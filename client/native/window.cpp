#include "client/native/window.h"

#include <GLES3/gl3.h>
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <imgui/backends/imgui_impl_glfw.h>
#include <imgui/backends/imgui_impl_opengl3.h>
#include <imgui/imgui.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/camera_path.h"
#include "base/file.h"
#include "base/format_text.h"
#include "base/gl/gl.h"
#include "base/json/annotations_file.h"
#include "base/json/camera_file.h"
#include "base/png/png.h"
#include "client/app/streamed_settings.h"
#include "client/native/answer_json.h"
#include "client/native/connection.h"
#include "client/native/http_get.h"
#include "client/native/local_scene.h"
#include "client/native/native_decoder.h"
#include "client/native/overlay.h"
#include "client/native/published_scene.h"
#include "client/native/settings_panel.h"
#include "client/native/units.h"
#include "client/native/user_files.h"

namespace client {
namespace {

constexpr int kFound = 200;             // HTTP
constexpr double kRecordedRate = 60.0;  // views a second

std::string lastGlfwError() {
  const char* text = nullptr;
  glfwGetError(&text);
  return text != nullptr ? text : "no reason given";
}

/// Returns the folder that a server with several scenes has for one: "/tower" for "/tower/" and "/tower/ws".
std::string folderOf(const std::string& target) {
  const std::string path = target.substr(0, target.find('?'));
  return path.substr(0, path.rfind('/'));
}

// ---- pictures ----

/// Names a picture after the scene and the time: "lumigrid-skull-20260504-153012.png". Characters that file names
/// cannot have become '-'.
std::string pictureName(const std::string& scene) {
  std::string name = "lumigrid-";
  for (const char c : scene.substr(0, 64)) {
    const bool plain =
        (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_';
    name += plain ? c : '-';
  }
  const std::time_t now = std::time(nullptr);
  std::tm local{};
  ::localtime_r(&now, &local);
  std::array<char, 32> time{};
  std::strftime(time.data(), time.size(), "-%Y%m%d-%H%M%S", &local);
  return name + time.data() + ".png";
}

/// Returns a path in the folder that does not exist yet.
std::string freePath(const std::string& directory, const std::string& name) {
  const std::filesystem::path folder(directory);
  const std::filesystem::path file(name);
  std::error_code error;
  std::filesystem::path path = folder / file;
  for (int i = 2; std::filesystem::exists(path, error) && i < 1000; ++i)
    path = folder / (file.stem().string() + "-" + std::to_string(i) + file.extension().string());
  return path.string();
}

/// Returns the path and query of the server's picture, in the window's size and on its background (RGBA, 0 … 1).
std::string renderTarget(const Request& request, const std::array<float, 4>& background) {
  const auto byte = [](float share) {
    return static_cast<unsigned>(std::lround(255.0F * std::clamp(share, 0.0F, 1.0F)));
  };
  return "/render?" + request.text +
         base::formatText("&width=%d&height=%d&background=%02x%02x%02x", request.camera.width, request.camera.height,
                          byte(background[0]), byte(background[1]), byte(background[2]));
}

// ---- keys ----

/// Returns the place of a key as a browser names it (KeyboardEvent.code).
std::string codeOf(int key) {
  if (key >= GLFW_KEY_A && key <= GLFW_KEY_Z) return std::string("Key") + static_cast<char>('A' + key - GLFW_KEY_A);
  if (key >= GLFW_KEY_0 && key <= GLFW_KEY_9) return "Digit" + std::to_string(key - GLFW_KEY_0);
  if (key >= GLFW_KEY_KP_0 && key <= GLFW_KEY_KP_9) return "Numpad" + std::to_string(key - GLFW_KEY_KP_0);
  // clang-format off
  static const std::map<int, const char*> kNames{
      {GLFW_KEY_UP, "ArrowUp"}, {GLFW_KEY_DOWN, "ArrowDown"}, {GLFW_KEY_LEFT, "ArrowLeft"},
      {GLFW_KEY_RIGHT, "ArrowRight"}, {GLFW_KEY_HOME, "Home"}, {GLFW_KEY_ESCAPE, "Escape"},
      {GLFW_KEY_PAGE_UP, "PageUp"}, {GLFW_KEY_PAGE_DOWN, "PageDown"}, {GLFW_KEY_DELETE, "Delete"},
      {GLFW_KEY_ENTER, "Enter"}, {GLFW_KEY_KP_ENTER, "NumpadEnter"}, {GLFW_KEY_BACKSPACE, "Backspace"},
      {GLFW_KEY_LEFT_SHIFT, "ShiftLeft"}, {GLFW_KEY_RIGHT_SHIFT, "ShiftRight"}, {GLFW_KEY_KP_ADD, "NumpadAdd"},
      {GLFW_KEY_KP_SUBTRACT, "NumpadSubtract"}, {GLFW_KEY_F1, "F1"}};
  // clang-format on
  const auto found = kNames.find(key);
  return found != kNames.end() ? found->second : "";
}

/// Translates GLFW's modifier bits.
Modifiers modifiersOf(int mods) {
  return {(mods & GLFW_MOD_SHIFT) != 0, (mods & (GLFW_MOD_CONTROL | GLFW_MOD_SUPER)) != 0, (mods & GLFW_MOD_ALT) != 0};
}

/// Translates a key by its place and its character (keyFromNames). GLFW reports characters as typed without shift, so
/// shift + '/' is taken for '?' and shift + '=' for '+'.
Key keyOf(int key, int scancode, int mods) {
  const char* printed = glfwGetKeyName(key, scancode);
  std::string text = printed != nullptr ? printed : "";
  if (text == "/" && (mods & GLFW_MOD_SHIFT) != 0) text = "?";
  if (text == "=" && (mods & GLFW_MOD_SHIFT) != 0) text = "+";
  return keyFromNames(codeOf(key), text);
}

// ---- the window ----

class Window {
 public:
  explicit Window(const WindowOptions& options) : options_(options) {}
  ~Window();
  Window(const Window&) = delete;
  Window& operator=(const Window&) = delete;
  base::Result<void> open();
  base::Result<void> run();

 private:
  base::Result<void> openScene(Method method);
  base::Result<void> changeMethod();
  bool createWindow(int context_api);
  void startOverlay();
  static Window& windowOf(GLFWwindow* window) { return *static_cast<Window*>(glfwGetWindowUserPointer(window)); }
  void applyTheme();
  void installCallbacks();
  void onButton(int button, int action, int mods);
  void onMove();
  void onWheel(double steps);
  void onKey(int key, int scancode, int action, int mods);
  void resized();
  glm::dvec2 cursor() const;
  PointerEvent pointer(PointerButton button, int mods) const;

  void startScene();
  void carryOutRequest(const Request& request);
  void savePicture(const Request& request);
  void writePicture(const base::Image& image);
  void keepBookmarks();
  void takeAnswers();
  void acceptNotes(const HttpGetter::Answer& answer);
  void readNotes();
  void acceptPick(std::uint32_t pick, const HttpGetter::Answer& answer);
  using AcceptAnswer = std::function<void(const HttpGetter::Answer&)>;
  void ask(const std::string& target, std::size_t max_bytes, double seconds, AcceptAnswer accept);
  void reportError(const base::Result<void>& done);

  base::Result<void> drawScene(double now);
  void drawOverlayWindow();
  bool closes() const;
  void recordView(double now);
  base::Result<void> writeRecord(double now);

  const WindowOptions& options_;
  GLFWwindow* window_ = nullptr;
  bool overlay_ready_ = false;
  OverlayLook look_;
  std::array<float, 4> background_{};
  std::optional<base::Rgb> scene_background_;
  bool theme_background_ = false;  // no background was given, so it is the scene's, or follows the theme
  bool settings_open_ = false;
  SettingsPanel settings_panel_;
  std::unique_ptr<App> app_;
  std::unique_ptr<Link> connection_;
  bool published_ = false;            // the scene has files but no server that answers questions
  std::string directory_;             // a scene on this machine; else empty
  std::unique_ptr<HttpGetter> http_;  // for files beside the scene, and a server's answers; null with a directory_
  std::map<std::uint64_t, AcceptAnswer> open_questions_;
  std::uint64_t next_question_ = 1;
  std::optional<std::string> scene_;  // bookmarkKey of the scene whose notes and bookmarks are loaded
  base::gl::RenderTarget picture_;    // the model without overlay; copied to the window
  glm::dvec2 cursor_at_{0.0};         // screen units
  int button_down_ = -1;
  bool picture_changed_ = true;
  bool method_changed_ = false;
  std::vector<base::SeenView> recorded_;  // for options_.record_file: each view that differs from the last
};

// ---- opening and closing ----

Window::~Window() {
  // GL objects must go while their context exists.
  connection_.reset();
  http_.reset();
  app_.reset();
  picture_ = {};
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
  LUMIGRID_TRY(checkUrl(options_.url));
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

  std::copy_n(options_.app.viewer.lumigraph.background, 4, background_.begin());
  theme_background_ = background_[3] == 0.0F;
  LUMIGRID_TRY(openScene(options_.app.viewer.method));
  directory_ = localSceneDirectory(options_.url).value_or("");
  published_ = !directory_.empty() || isPublishedScene(options_.url);
  if (!directory_.empty()) return {};
  if (published_)
    http_ = std::make_unique<HttpGetter>(placeOfScene(options_.url), options_.access);
  else if (auto server = parseServerUrl(options_.url))
    http_ = std::make_unique<HttpGetter>(server->httpPlace() + folderOf(server->target), options_.access);
  return {};
}

/// Makes the link for a method, and the App that shows the scene.
base::Result<void> Window::openScene(Method method) {
  const Settings settings = app_ ? app_->settings() : options_.app.settings;
  StreamedOptions streamed = options_.streamed;
  applyChanges(options_.app.settings, settings, streamed);
  auto link = isStreamed(method) ? openStreamedLink(options_.url, method, options_.link, streamed, options_.access)
                                 : openLink(options_.url, options_.link, options_.access);
  if (!link) return link.error();
  connection_ = std::move(*link);
  AppOptions options = options_.app;
  options.settings = settings;
  options.viewer.method = method;
  options.clock = [] { return glfwGetTime(); };
  app_ = std::make_unique<App>(options, std::make_unique<NativeDecoder>(std::max(1U, options_.decoder_threads)));
  applyTheme();
  if (!options_.view.empty()) LUMIGRID_TRY(app_->openPermalink(options_.view));
  if (options_.show_figures) app_->showStatistics(true);
  resized();
  return {};
}

/// Changes the method once when the scene has no data for the default one; nothing was shown until then.
base::Result<void> Window::changeMethod() {
  const auto instead = app_->session().methodInstead();
  if (!instead || !options_.method_is_default || std::exchange(method_changed_, true)) return {};
  return openScene(*instead);
}

/// Sets up Dear ImGui after our own callbacks, which it then calls before its own.
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
  look_.scale = scale * static_cast<float>(std::max(window_width, 1)) / static_cast<float>(std::max(pixel_width, 1));
  setUpOverlay(look_);
  ImGui_ImplGlfw_InitForOpenGL(window_, true);
  ImGui_ImplOpenGL3_Init("#version 300 es");
  overlay_ready_ = true;
}

/// Applies the theme of the settings. Desktops have no portable way to tell theirs, so "system" is dark.
void Window::applyTheme() {
  look_.dark = static_cast<Theme>(static_cast<int>(app_->settings().theme)) != Theme::kLight;
  styleOverlay(look_);
  if (theme_background_) background_ = scene_background_ ? opaque(*scene_background_) : overlayBackground(look_.dark);
  app_->setBackground(background_);
}

void Window::installCallbacks() {
  glfwSetWindowUserPointer(window_, this);
  glfwSetMouseButtonCallback(
      window_, [](GLFWwindow* w, int button, int action, int mods) { windowOf(w).onButton(button, action, mods); });
  glfwSetCursorPosCallback(window_, [](GLFWwindow* w, double x, double y) {
    windowOf(w).cursor_at_ = {x, y};
    windowOf(w).onMove();
  });
  glfwSetScrollCallback(window_, [](GLFWwindow* w, double, double steps) { windowOf(w).onWheel(steps); });
  glfwSetKeyCallback(window_, [](GLFWwindow* w, int key, int scancode, int action, int mods) {
    windowOf(w).onKey(key, scancode, action, mods);
  });
  glfwSetFramebufferSizeCallback(window_, [](GLFWwindow* w, int, int) { windowOf(w).resized(); });
  glfwSetWindowRefreshCallback(window_, [](GLFWwindow* w) { windowOf(w).picture_changed_ = true; });
  glfwSetWindowFocusCallback(window_, [](GLFWwindow* w, int focused) {
    if (focused == GLFW_FALSE) windowOf(w).app_->blur();
  });
  glfwSetWindowIconifyCallback(
      window_, [](GLFWwindow* w, int iconified) { windowOf(w).app_->setHidden(iconified == GLFW_TRUE); });
}

// ---- mouse and keys ----

void Window::resized() {
  int width = 0;
  int height = 0;
  float scale = 1.0F;
  glfwGetFramebufferSize(window_, &width, &height);
  glfwGetWindowContentScale(window_, &scale, nullptr);
  if (app_) app_->resize(width, height, static_cast<double>(scale));
  picture_changed_ = true;
}

/// Returns the cursor in framebuffer pixels as of the present event; glfwGetCursorPos would return a later place.
glm::dvec2 Window::cursor() const {
  int width = 1;
  int height = 1;
  int pixel_width = 1;
  int pixel_height = 1;
  glfwGetWindowSize(window_, &width, &height);
  glfwGetFramebufferSize(window_, &pixel_width, &pixel_height);
  return {cursor_at_.x * pixel_width / std::max(width, 1), cursor_at_.y * pixel_height / std::max(height, 1)};
}

PointerEvent Window::pointer(PointerButton button, int mods) const {
  const glm::dvec2 at = cursor();
  return {0, PointerKind::kMouse, button, modifiersOf(mods), at.x, at.y, glfwGetTime()};
}

/// Handles one button at a time; a second one is ignored while the first is down.
void Window::onButton(int button, int action, int mods) {
  picture_changed_ = true;
  const PointerButton ours = button == GLFW_MOUSE_BUTTON_LEFT     ? PointerButton::kLeft
                             : button == GLFW_MOUSE_BUTTON_MIDDLE ? PointerButton::kMiddle
                                                                  : PointerButton::kRight;
  if (action == GLFW_PRESS && button_down_ < 0 && !ImGui::GetIO().WantCaptureMouse) {
    button_down_ = button;
    app_->pointerDown(pointer(ours, mods));
  } else if (action == GLFW_RELEASE && button == button_down_) {
    button_down_ = -1;
    app_->pointerUp(pointer(ours, mods));
  }
}

void Window::onMove() {
  app_->pointerMove(pointer(PointerButton::kLeft, 0));
  picture_changed_ = true;  // pins show their names under the cursor
}

void Window::onWheel(double steps) {
  if (ImGui::GetIO().WantCaptureMouse) return;
  const glm::dvec2 at = cursor();
  app_->turnWheel(steps, at.x, at.y, glfwGetTime());
}

void Window::onKey(int key, int scancode, int action, int mods) {
  picture_changed_ = true;
  // Keys typed into a field are not ours; but a key released there may have been pressed here.
  if (action != GLFW_RELEASE && ImGui::GetIO().WantTextInput) return;
  const Key ours = keyOf(key, scancode, mods);
  if (ours == Key::kEscape && action == GLFW_PRESS && std::exchange(settings_open_, false)) return;
  if (ours != Key::kNone) app_->handleKey(ours, action != GLFW_RELEASE, modifiersOf(mods), glfwGetTime());
}

// ---- requests and answers ----

/// Loads notes and bookmarks of a scene that has just arrived, or of another one after a reconnect.
void Window::startScene() {
  const protocol::Welcome* welcome = app_->session().welcome();
  if (welcome == nullptr || app_->sceneName().empty()) return;
  const std::string key = bookmarkKey(*welcome);
  if (scene_ == key) return;
  scene_ = key;
  glfwSetWindowTitle(window_, ("Lumigrid: " + welcome->scene_name).c_str());
  scene_background_ = welcome->background;
  applyTheme();
  app_->showToast("H shows what mouse and keys do");

  const auto bookmarks = readBookmarks(options_.config_directory, key);
  if (!bookmarks) app_->showToast(bookmarks.error().message, true);
  for (int slot = 1; slot < kBookmarks; ++slot)
    reportError(app_->setBookmark(slot, bookmarks ? (*bookmarks)[static_cast<std::size_t>(slot)] : ""));

  app_->setAnnotations({});
  if (!directory_.empty()) return readNotes();
  constexpr double kSeconds = 20.0;
  ask(std::string("/") + base::kAnnotationsFile, base::kMaxAnnotationsBytes, kSeconds,
      [this](const HttpGetter::Answer& answer) { acceptNotes(answer); });
}

/// Shows the notes of a scene on this machine, which may have none.
void Window::readNotes() {
  const auto read = base::readAnnotations(directory_);
  if (!read) return app_->showToast(read.error().message, true);
  if (!*read) return;
  auto notes = base::parseAnnotations(base::viewOfText((*read)->text), base::kAnnotationsFile);
  if (notes) app_->setAnnotations(std::move(*notes));
}

void Window::reportError(const base::Result<void>& done) {
  if (!done) app_->showToast(done.error().message, true);
}

void Window::carryOutRequest(const Request& request) {
  switch (request.kind) {
    case RequestKind::kCopyLink:
      glfwSetClipboardString(window_, request.text.c_str());
      app_->showToast("Link copied; lumigrid-view --view opens it");
      break;
    case RequestKind::kLinkChanged:
      break;  // a window has no address to keep it in
    case RequestKind::kSavePicture:
      savePicture(request);
      break;
    case RequestKind::kKeepBookmarks:
      keepBookmarks();
      break;
    case RequestKind::kShowSettings:
      settings_open_ = !settings_open_;
      picture_changed_ = true;
      break;
    case RequestKind::kKeepSettings:
      applyTheme();
      if (!options_.config_directory.empty()) reportError(writeSettings(options_.config_directory, app_->settings()));
      break;
    case RequestKind::kPick:
      if (connection_->pick(request.id, request.origin, request.direction)) return;
      if (published_) return app_->answerPick(request.id, {});  // nobody can answer: the approximate point stays
      constexpr double kPickSeconds = 10.0;
      ask(pickTarget(request.origin, request.direction), kMaxPickAnswer, kPickSeconds,
          [this, id = request.id](const HttpGetter::Answer& answer) { acceptPick(id, answer); });
      break;
  }
}

void Window::keepBookmarks() {
  if (options_.config_directory.empty() || !scene_) return;
  Bookmarks bookmarks;
  for (int slot = 1; slot < kBookmarks; ++slot) bookmarks[static_cast<std::size_t>(slot)] = app_->bookmark(slot);
  reportError(writeBookmarks(options_.config_directory, *scene_, bookmarks));
}

/// Asks the server for the picture, which it draws at full resolution; without a server saves what the window shows.
void Window::savePicture(const Request& request) {
  if (published_ || isStreamed(app_->view().method) || app_->session().phase() != SessionPhase::kReady)
    return writePicture(readPicture(picture_, app_->viewer()));
  app_->showToast("The server draws the picture\u2026");
  constexpr std::size_t kMaxBytes = 256 * 1024 * 1024;
  constexpr double kSeconds = 300.0;
  ask(renderTarget(request, background_), kMaxBytes, kSeconds,
      [this, shown = readPicture(picture_, app_->viewer())](const HttpGetter::Answer& answer) {
        const auto image = answer.status == kFound ? base::decodePng(answer.body) : base::Result<base::Image>(shown);
        writePicture(image ? *image : shown);
      });
}

void Window::writePicture(const base::Image& image) {
  const std::string path = freePath(options_.picture_directory, pictureName(app_->sceneName()));
  const auto written = base::writePng(image, path);
  app_->showToast(written ? "Picture saved: " + path : written.error().message, !written);
}

void Window::ask(const std::string& target, std::size_t max_bytes, double seconds, AcceptAnswer accept) {
  open_questions_[next_question_] = std::move(accept);
  http_->get(next_question_++, target, max_bytes, seconds);
}

void Window::takeAnswers() {
  for (const AnsweredPick& pick : connection_->takePicks()) app_->answerPick(pick.id, pick.answer);
  if (!http_) return;
  for (const HttpGetter::Answer& answer : http_->takeAnswers()) {
    const auto asked = open_questions_.extract(answer.id);
    if (!asked.empty()) asked.mapped()(answer);
  }
}

/// Shows the notes; a server without any is no error.
void Window::acceptNotes(const HttpGetter::Answer& answer) {
  constexpr int kNotFound = 404;
  if (answer.status == kNotFound) return;
  if (answer.status != kFound)
    return app_->showToast(
        "The notes cannot be read: " +
            (answer.problem.empty() ? "the server answers " + std::to_string(answer.status) : answer.problem),
        true);
  auto notes = base::parseAnnotations(answer.body, base::kAnnotationsFile);
  if (!notes) return app_->showToast(notes.error().message, true);
  app_->setAnnotations(std::move(*notes));
}

void Window::acceptPick(std::uint32_t pick, const HttpGetter::Answer& answer) {
  constexpr int kNotImplemented = 501;  // a scene without patches has no surface to be found
  PickAnswer found;
  std::string problem = answer.problem;
  if (answer.status == kFound) {
    const auto parsed = parsePickAnswer(answer.body);
    if (parsed)
      found = *parsed;
    else
      problem = parsed.error().message;
  } else if (problem.empty() && answer.status != kNotImplemented) {
    problem = "the server answers " + std::to_string(answer.status);
  }
  if (!problem.empty()) app_->showToast("This point stays approximate: " + problem, true);
  app_->answerPick(pick, found);
}

// ---- drawing ----

base::Result<void> Window::drawScene(double now) {
  const base::ViewCamera camera = app_->camera();
  if (picture_.width() != camera.width || picture_.height() != camera.height) {
    LUMIGRID_ASSIGN_OR_RETURN(auto made, base::gl::RenderTarget::create(camera.width, camera.height));
    picture_ = std::move(made);
  }
  picture_.bind();
  return app_->drawFrame(now);
}

/// Draws the picture and the overlay into the window.
void Window::drawOverlayWindow() {
  int width = 0;
  int height = 0;
  glfwGetFramebufferSize(window_, &width, &height);
  glBindFramebuffer(GL_READ_FRAMEBUFFER, picture_.framebuffer());
  glBindFramebuffer(GL_DRAW_FRAMEBUFFER, 0);
  glBlitFramebuffer(0, 0, picture_.width(), picture_.height(), 0, 0, width, height, GL_COLOR_BUFFER_BIT, GL_NEAREST);
  glBindFramebuffer(GL_FRAMEBUFFER, 0);
  glViewport(0, 0, width, height);
  ImGui_ImplOpenGL3_NewFrame();
  ImGui_ImplGlfw_NewFrame();
  ImGui::NewFrame();
  drawOverlay(*app_, look_);
  if (settings_open_) settings_open_ = settings_panel_.draw(*app_, look_);
  ImGui::Render();
  ImGui_ImplOpenGL3_RenderDrawData(ImGui::GetDrawData());
  glfwSwapBuffers(window_);
}

bool Window::closes() const {
  return glfwWindowShouldClose(window_) == GLFW_TRUE || (options_.cancelled && options_.cancelled());
}

void Window::recordView(double now) {
  if (options_.record_file.empty() || !scene_ || app_->viewer().stats().accuracy == Accuracy::kNothing) return;
  const base::ViewCamera view = app_->camera();
  if (recorded_.empty() || recorded_.back().view != view) recorded_.push_back({now, view});
}

base::Result<void> Window::writeRecord(double now) {
  if (options_.record_file.empty()) return {};
  if (recorded_.empty())
    return base::Error{base::ErrorCode::kNotFound, options_.record_file + ": not written, as no scene was shown"};
  recorded_.push_back({now, recorded_.back().view});  // how long the last view rested
  const std::string text = base::formatCameraPath(base::pathOf(recorded_, kRecordedRate));
  return base::writeFileAtomically(options_.record_file, base::viewOfText(text));
}

base::Result<void> Window::run() {
  // With nothing to draw, the loop wakes for input at once, and for the network within this time.
  constexpr double kIdleSeconds = 0.02;
  // The overlay is drawn again this often while it shows statistics.
  constexpr double kFiguresSeconds = 0.25;
  // Dear ImGui hides a new window until it has measured it once, so a changed overlay is drawn this often.
  constexpr int kOverlayFrames = 3;
  std::uint64_t shown_overlay = 0;
  double shown_at = 0.0;
  int overlay_frames_left = 0;
  while (!closes()) {
    glfwPollEvents();
    connection_->pump(app_->session());
    if (auto view = connection_->streamed()) app_->viewer().setStreamed(std::move(view));
    LUMIGRID_TRY(changeMethod());
    takeAnswers();
    const double now = glfwGetTime();
    app_->advance(now);
    startScene();
    for (const Request& request : app_->takeRequests()) carryOutRequest(request);

    // A picture that would look the same is not drawn again; the overlay alone needs no new picture.
    const bool frame = app_->wantsFrame();
    const bool figures = app_->view().statistics && now - shown_at >= kFiguresSeconds;
    if (frame) LUMIGRID_TRY(drawScene(now));
    recordView(now);
    if (frame || picture_changed_ || figures || app_->overlayVersion() != shown_overlay)
      overlay_frames_left = kOverlayFrames;
    if (settings_open_)
      overlay_frames_left = std::max(overlay_frames_left, 1);  // its fields blink and react to the mouse
    if (overlay_frames_left == 0 || picture_.width() == 0) {
      glfwWaitEventsTimeout(kIdleSeconds);
      continue;
    }
    drawOverlayWindow();
    --overlay_frames_left;
    picture_changed_ = false;
    shown_overlay = app_->overlayVersion();
    shown_at = now;
  }
  return writeRecord(glfwGetTime());
}

}  // namespace

base::Result<void> runWindow(const WindowOptions& options) {
  Window window(options);
  LUMIGRID_TRY(window.open());
  return window.run();
}

}  // namespace client
