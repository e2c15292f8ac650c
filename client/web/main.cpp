// The functions of the thin client that JavaScript calls (client/web/site/core.js). Everything runs on the page's one
// thread; nothing here waits.
//
// Numbers are passed as arguments. Tables are passed to the page as text (client/web/text_rows.h): one row a line,
// fields separated by tabs. JavaScript shows the text and never hands it to an HTML parser.
#include <GLES3/gl3.h>
#include <emscripten/emscripten.h>
#include <emscripten/html5.h>

#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "base/geometry.h"
#include "base/text.h"
#include "client/app/app.h"
#include "client/web/page.h"
#include "client/web/text_rows.h"
#include "client/web/web_decoder.h"

namespace client::web {

Page page;

namespace {

glm::dvec3 vectorAt(const double* numbers) {
  return {numbers[0], numbers[1], numbers[2]};
}

}  // namespace

protocol::Welcome welcomeOf(const std::string& name, const std::string& units, const std::string& start_view,
                            const std::string& attribution, const double* numbers) {
  protocol::Welcome welcome;
  welcome.scene_name = name;
  welcome.units = units == "unknown" ? "" : units;
  welcome.origin = vectorAt(numbers);
  welcome.box_min = glm::vec3(vectorAt(numbers + 3) - welcome.origin);
  welcome.box_max = glm::vec3(vectorAt(numbers + 6) - welcome.origin);
  welcome.up = glm::vec3(vectorAt(numbers + 9));
  welcome.unlit = numbers[12] == 1.0;
  welcome.shadows = numbers[12] == 2.0;
  welcome.light_direction = glm::vec3(vectorAt(numbers + 13));
  welcome.start_direction = glm::vec3(vectorAt(numbers + 16));
  welcome.start_view = start_view;
  welcome.attribution = attribution;
  if (numbers[19] >= 0.0) {
    const auto color = static_cast<std::uint32_t>(numbers[19]);
    welcome.background = base::Rgb{static_cast<std::uint8_t>(color >> 16), static_cast<std::uint8_t>(color >> 8),
                                   static_cast<std::uint8_t>(color)};
  }
  if (!std::isnan(numbers[20])) welcome.north = glm::vec3(base::northDirection(vectorAt(numbers + 9), numbers[20]));
  for (int i = 0; i < numbers[21]; ++i) welcome.hull.emplace_back(vectorAt(numbers + kHullAt + 3 * i) - welcome.origin);
  return welcome;
}

const char* handOut(std::string text) {
  page.text = std::move(text);
  return page.text.c_str();
}

}  // namespace client::web

namespace {

using client::web::handOut;
using client::web::page;

/// Returns the empty text on success, else the error.
template <class T>
const char* handOutError(const base::Result<T>& result) {
  return handOut(result ? std::string() : result.error().message);
}

client::Modifiers modifiersOf(int bits) {
  return {(bits & 1) != 0, (bits & 2) != 0, (bits & 4) != 0};
}

}  // namespace

extern "C" {

// ---- start ----

/// Takes one setting from storage, before start(). Returns errors as text.
EMSCRIPTEN_KEEPALIVE const char* initialSetting(const char* name, double value) {
  return handOutError(client::setSetting(page.options.settings, name, value));
}

/// Starts the client; returns 0 when there is no WebGL2. `method` is a name; one that this module cannot show is
/// ignored.
EMSCRIPTEN_KEEPALIVE int start(const char* canvas, const char* method) {
  EmscriptenWebGLContextAttributes attributes;
  emscripten_webgl_init_context_attributes(&attributes);
  attributes.majorVersion = 2;
  attributes.alpha = true;  // the page's own background shows where nothing is drawn
  attributes.antialias = false;
  attributes.powerPreference = EM_WEBGL_POWER_PREFERENCE_HIGH_PERFORMANCE;
  page.context = emscripten_webgl_create_context(canvas, &attributes);
  if (page.context <= 0 || emscripten_webgl_make_context_current(page.context) != EMSCRIPTEN_RESULT_SUCCESS) return 0;
  emscripten_webgl_enable_extension(page.context, "WEBGL_debug_renderer_info");  // for base::gl::drawsInSoftware()
  page.options.viewer.method = client::web::kPageMethod;
  if (!client::isStreamed(client::web::kPageMethod) && client::methodFromName(method) == client::Method::kPatches)
    page.options.viewer.method = client::Method::kPatches;
  page.options.clock = [] { return emscripten_get_now() / 1000.0; };
  page.app = std::make_unique<client::App>(page.options, std::make_unique<client::WebDecoder>());
  return 1;
}

EMSCRIPTEN_KEEPALIVE void loseContext() {
  page.app->contextLost();
}
EMSCRIPTEN_KEEPALIVE const char* restoreContext() {
  return handOutError(page.app->contextRestored());
}

// ---- events ----

EMSCRIPTEN_KEEPALIVE void resize(int width, int height, double pixel_ratio) {
  page.app->resize(width, height, pixel_ratio);
}

/// Handles a pointer event. `action`: 0 down, 1 move, 2 up, 3 cancelled. `kind`: 0 mouse, 1 touch, 2 pen. `button`: 0
/// left, 1 middle, 2 right. `modifiers`: 1 shift, 2 control, 4 alt.
EMSCRIPTEN_KEEPALIVE void pointer(int action, int id, int kind, int button, int modifiers, double x, double y,
                                  double now) {
  const client::PointerEvent event{id,
                                   static_cast<client::PointerKind>(kind),
                                   static_cast<client::PointerButton>(button),
                                   modifiersOf(modifiers),
                                   x,
                                   y,
                                   now};
  if (action == 0) page.app->pointerDown(event);
  if (action == 1) page.app->pointerMove(event);
  if (action == 2) page.app->pointerUp(event);
  if (action == 3) page.app->pointerCancel(id);
}

EMSCRIPTEN_KEEPALIVE void wheel(double steps, double x, double y, double now) {
  page.app->turnWheel(steps, x, y, now);
}

EMSCRIPTEN_KEEPALIVE int key(const char* code, const char* name, int down, int modifiers, double now) {
  return page.app->handleKey(client::keyFromNames(code, name), down != 0, modifiersOf(modifiers), now) ? 1 : 0;
}

EMSCRIPTEN_KEEPALIVE void blur() {
  page.app->blur();
}
EMSCRIPTEN_KEEPALIVE void setHidden(int hidden) {
  page.app->setHidden(hidden != 0);
}
EMSCRIPTEN_KEEPALIVE void setReducedMotion(int wanted) {
  page.app->setReducedMotion(wanted != 0);
}

// ---- the loop ----

/// Advances the client; returns 1 when frame() would draw something new.
EMSCRIPTEN_KEEPALIVE int advance(double now) {
  page.app->advance(now);
  return page.app->wantsFrame() ? 1 : 0;
}

EMSCRIPTEN_KEEPALIVE const char* frame(double now) {
  glBindFramebuffer(GL_FRAMEBUFFER, 0);
  return handOutError(page.app->drawFrame(now));
}

// ---- requests ----

/// Casts picks of a published scene here, and returns the other requests for the page as rows: kind, id, text, origin,
/// direction.
EMSCRIPTEN_KEEPALIVE const char* takeRequests() {
  client::TextRows rows;
  for (const client::Request& request : page.app->takeRequests()) {
    if (page.pick != nullptr && request.kind == client::RequestKind::kPick) {
      page.pick(request);
      continue;
    }
    rows.addRow(request.kind, request.id, request.text, request.origin, request.direction);
  }
  return handOut(rows.takeText());
}

/// Answers a pick. `kind`: 0 hit, 1 none, 2 unknown.
EMSCRIPTEN_KEEPALIVE void answerPick(std::uint32_t id, int kind, double px, double py, double pz, double nx, double ny,
                                     double nz, double accuracy) {
  client::PickAnswer answer;
  answer.kind = static_cast<client::PickAnswer::Kind>(kind);
  answer.point = {px, py, pz};
  answer.normal = {nx, ny, nz};
  answer.accuracy = accuracy;
  page.app->answerPick(id, answer);
}

EMSCRIPTEN_KEEPALIVE void showToast(const char* text, int error) {
  page.app->showToast(text, error != 0);
}

// ---- state that comes from the page and goes there ----

EMSCRIPTEN_KEEPALIVE const char* method() {
  return client::nameOf(page.app->view().method).data();
}
EMSCRIPTEN_KEEPALIVE const char* permalink() {
  return handOut(page.app->permalink());
}
EMSCRIPTEN_KEEPALIVE const char* openPermalink(const char* text) {
  return handOutError(page.app->openPermalink(text));
}
EMSCRIPTEN_KEEPALIVE const char* bookmark(int slot) {
  return handOut(page.app->bookmark(slot));
}
EMSCRIPTEN_KEEPALIVE const char* setBookmark(int slot, const char* link) {
  return handOutError(page.app->setBookmark(slot, link));
}

/// Returns rows: name, label, kind, minimum, maximum, value, default, choices, from the next start on.
EMSCRIPTEN_KEEPALIVE const char* settings() {
  client::TextRows rows;
  const client::Settings& now = page.app ? page.app->settings() : page.options.settings;
  const client::Settings defaults;
  for (const client::SettingField& field : client::settingFields()) {
    rows.addRow(field.name, field.label, field.kind, field.min, field.max, now.*field.value, defaults.*field.value,
                field.choices, field.from_next_start);
  }
  return handOut(rows.takeText());
}
EMSCRIPTEN_KEEPALIVE const char* changeSetting(const char* name, double value) {
  return handOutError(page.app->changeSetting(name, value));
}

EMSCRIPTEN_KEEPALIVE void dropAnnotations() {
  page.annotations.clear();
}
/// Adds one annotation to the list that setAnnotations() then shows. Returns errors as text; then it is not on the
/// list.
EMSCRIPTEN_KEEPALIVE const char* addAnnotation(const char* title, const char* text, double px, double py, double pz,
                                               double nx, double ny, double nz) {
  client::Annotation annotation;
  annotation.position = {px, py, pz};
  annotation.normal = {nx, ny, nz};
  annotation.title = title;
  annotation.text = text;
  if (page.annotations.size() >= base::kMaxAnnotations) return handOut("is one more than a scene may have");
  auto checked = base::checkedAnnotation(std::move(annotation));
  if (checked) page.annotations.push_back(std::move(*checked));
  return handOutError(checked);
}
/// Sets the camera of the annotation that was added last.
EMSCRIPTEN_KEEPALIVE const char* addAnnotationCamera(double px, double py, double pz, double dx, double dy, double dz,
                                                     double ux, double uy, double uz, double fov) {
  if (page.annotations.empty()) return handOut({});
  client::Annotation annotation = page.annotations.back();
  annotation.camera.emplace();
  annotation.camera->position = {px, py, pz};
  annotation.camera->direction = {dx, dy, dz};
  annotation.camera->up = {ux, uy, uz};
  annotation.camera->fov_y = fov;
  auto checked = base::checkedAnnotation(std::move(annotation));
  if (checked) page.annotations.back() = std::move(*checked);
  return handOutError(checked);
}
EMSCRIPTEN_KEEPALIVE void setAnnotations() {
  page.app->setAnnotations(std::exchange(page.annotations, {}));
}

// ---- the overlay ----

EMSCRIPTEN_KEEPALIVE double overlayVersion() {
  return static_cast<double>(page.app->overlayVersion());
}

/// Returns the overlay as rows that begin with their kind:
///   scene name unit attribution background north | status kind text advice | progress active share
///   mode mode hint | help shown | view statistics colours orthographic section, lens or light
///   toast id error text | annotation index
///   label kind index x y visible approximate open text | line x0 y0 x1 y1 approximate
EMSCRIPTEN_KEEPALIVE const char* overlay() {
  const client::App& app = *page.app;
  client::TextRows rows;
  const auto background = app.sceneBackground();
  rows.add("scene").add(app.sceneName()).add(app.unit()).add(app.attribution());
  rows.add(background ? base::formatRgb(*background) : std::string());
  if (const auto north = app.northTurn()) rows.add(*north);
  rows.end();
  const client::Status status = app.status();
  rows.addRow("status", status.kind, status.text, status.advice);
  const client::Progress progress = app.progress();
  rows.addRow("progress", progress.active, progress.share);
  rows.addRow("mode", app.mode(), app.modeHint());
  rows.addRow("help", app.helpShown());
  const client::ViewState& view = app.view();
  rows.addRow("view", view.statistics, view.colors_by_resolution, view.orthographic, view.section.on,
              app.lensShown() || view.light.on);
  for (const client::Toast& toast : app.toasts()) rows.addRow("toast", toast.id, toast.error, toast.text);
  if (auto open = app.openAnnotation()) rows.addRow("annotation", *open);
  for (const client::Label& label : app.labels())
    rows.addRow("label", label.kind, label.index, label.x, label.y, label.visible, label.approximate, label.open,
                label.text);
  for (const client::LabelLine& line : app.lines())
    rows.addRow("line", line.x0, line.y0, line.x1, line.y1, line.approximate);
  return handOut(rows.takeText());
}

/// Returns the statistics for people, as rows: name, value.
EMSCRIPTEN_KEEPALIVE const char* statistics() {
  client::TextRows rows;
  for (const client::StatisticsLine& line : client::statisticsLines(page.app->statistics()))
    rows.addRow(line.name, line.value);
  return handOut(rows.takeText());
}

/// Returns the statistics for programs, as rows: name, number.
EMSCRIPTEN_KEEPALIVE const char* figures() {
  const client::Statistics s = page.app->statistics();
  const client::ViewerStats& viewer = s.viewer;
  client::TextRows rows;
  rows.addRow("framesPerSecond", s.frames_per_second);
  rows.addRow("frameMilliseconds", s.frame_milliseconds);
  rows.addRow("imagesInUse", viewer.lumigraph.samples_used);
  rows.addRow("imagesResident", viewer.lumigraph.samples_resident);
  rows.addRow("imagesRequested", viewer.images_requested);
  rows.addRow("patches", viewer.lumigraph.patches);
  rows.addRow("triangles", viewer.lumigraph.triangles);
  rows.addRow("memoryBytes", viewer.memory.total());
  rows.addRow("memoryBudget", viewer.memory_budget);
  rows.addRow("gpuBytes", viewer.memory.gpu());
  rows.addRow("receivedBytes", viewer.session.bytes_received);
  rows.addRow("receivedImageBytes", viewer.session.bytes_faces);
  rows.addRow("receivedPatchBytes", viewer.session.bytes_patches);
  rows.addRow("receivedFrameBytes", viewer.session.bytes_frames);
  rows.addRow("errorPixels", viewer.error_px);
  rows.addRow("drawn", viewer.streamed.drawn);
  rows.addRow("present", viewer.streamed.present);
  rows.addRow("accuracy", viewer.accuracy);
  rows.addRow("complete", viewer.complete);
  rows.addRow("broken", viewer.broken);
  return handOut(rows.takeText());
}

/// Returns the help as rows: input, effect.
EMSCRIPTEN_KEEPALIVE const char* help() {
  client::TextRows rows;
  for (const client::HelpRow& row : client::helpRows()) rows.addRow(row.input, row.effect);
  return handOut(rows.takeText());
}

/// Returns the legend as rows: upper bound in pixels, red, green, blue; the last step has no bound.
EMSCRIPTEN_KEEPALIVE const char* legend() {
  client::TextRows rows;
  for (const lod::draw::ResolutionStep& step : lod::draw::kResolutionLegend)
    rows.addRow(step.up_to_px, step.color[0], step.color[1], step.color[2]);
  return handOut(rows.takeText());
}

EMSCRIPTEN_KEEPALIVE void showHelp(int shown) {
  page.app->showHelp(shown != 0);
}
/// Shows an annotation's card; −1 closes it.
EMSCRIPTEN_KEEPALIVE void showAnnotation(int index) {
  page.app->showAnnotation(index < 0 ? std::nullopt : std::optional<std::size_t>(static_cast<std::size_t>(index)));
}

/// Returns one row: position, direction, up, vertical angle, orthographic height, width, height, and the normal and
/// offset of the section: zeros without one.
EMSCRIPTEN_KEEPALIVE const char* camera() {
  client::TextRows rows;
  const base::ViewCamera view = page.app->camera();
  const base::SectionPlane section = view.section.value_or(base::SectionPlane{glm::dvec3(0.0), 0.0});
  rows.addRow(view.position, view.direction, view.up, view.fov_y, view.ortho_height, view.width, view.height,
              section.normal, section.offset);
  return handOut(rows.takeText());
}

// ---- the link to a server ----

EMSCRIPTEN_KEEPALIVE void connected() {
  page.app->session().connected();
}
EMSCRIPTEN_KEEPALIVE void disconnected(const char* reason) {
  page.app->session().disconnected(reason);
}
EMSCRIPTEN_KEEPALIVE int refused() {
  return page.app->session().phase() == client::SessionPhase::kRefused ? 1 : 0;
}
/// Returns the method that shows a scene whose server refused this one; mostly empty.
EMSCRIPTEN_KEEPALIVE const char* methodInstead() {
  const auto other = page.app->session().methodInstead();
  return other ? client::nameOf(*other).data() : "";
}
/// Returns room for one message of the server, to be filled before receiveMessage().
EMSCRIPTEN_KEEPALIVE std::uint8_t* messageBuffer(std::size_t size) {
  page.incoming.resize(size);
  return page.incoming.data();
}
/// Takes in the message. Returns an error as text; then the connection is to be closed.
EMSCRIPTEN_KEEPALIVE const char* receiveMessage() {
  return handOutError(page.app->session().receive(page.incoming));
}
/// Returns the length of the next message to send, which lies at messageToSend(); 0 when there is none.
EMSCRIPTEN_KEEPALIVE std::size_t nextToSend() {
  auto next = page.app->session().nextToSend();
  page.outgoing = next ? std::move(*next) : base::Bytes();
  return page.outgoing.size();
}
EMSCRIPTEN_KEEPALIVE const std::uint8_t* messageToSend() {
  return page.outgoing.data();
}

}  // extern "C"
