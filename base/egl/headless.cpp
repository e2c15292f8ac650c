#include "base/egl/headless.h"

#include <EGL/egl.h>
#include <EGL/eglext.h>
#include <GLES3/gl3.h>

#include <array>
#include <cstdlib>
#include <string_view>
#include <vector>

#include "base/format_text.h"

namespace base {
namespace {

// EGL displays belong to the process: requesting the same one twice returns the same handle, and eglTerminate would end
// every context on it, those of other threads included. So displays are initialised, which is idempotent, and never
// terminated.

constexpr const char* kInstallHint =
    "install libegl-mesa0 and libgl1-mesa-dri (software rendering) or the GPU vendor's EGL library";

bool hasExtension(const char* list, std::string_view wanted) {
  // Names stand between spaces.
  return list != nullptr && (" " + std::string(list) + " ").find(" " + std::string(wanted) + " ") != std::string::npos;
}

std::string eglErrorText() {
  return formatText("0x%04x", static_cast<unsigned>(eglGetError()));
}

template <class Function>
Function load(const char* name) {
  return reinterpret_cast<Function>(eglGetProcAddress(name));
}

/// Returns the EGL devices that are (or are not) software rasterisers; none if EGL can't list devices.
std::vector<EGLDeviceEXT> devices(const char* client_extensions, bool software) {
  const bool listable = hasExtension(client_extensions, "EGL_EXT_platform_device") &&
                        (hasExtension(client_extensions, "EGL_EXT_device_base") ||
                         hasExtension(client_extensions, "EGL_EXT_device_enumeration"));
  const auto query_devices = load<PFNEGLQUERYDEVICESEXTPROC>("eglQueryDevicesEXT");
  const auto query_string = load<PFNEGLQUERYDEVICESTRINGEXTPROC>("eglQueryDeviceStringEXT");
  if (!listable || query_devices == nullptr || query_string == nullptr) return {};

  std::array<EGLDeviceEXT, 32> all{};
  EGLint count = 0;
  if (query_devices(static_cast<EGLint>(all.size()), all.data(), &count) != EGL_TRUE) return {};
  std::vector<EGLDeviceEXT> chosen;
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i)
    if (hasExtension(query_string(all[i], EGL_EXTENSIONS), "EGL_MESA_device_software") == software)
      chosen.push_back(all[i]);
  return chosen;
}

/// Creates a GLES 3 context on the display and makes it current on this thread without a surface.
Result<EGLContext> contextOn(EGLDisplay display) {
  EGLint major = 0;
  EGLint minor = 0;
  if (display == EGL_NO_DISPLAY || eglInitialize(display, &major, &minor) != EGL_TRUE)
    return Error{ErrorCode::kUnsupported, "display does not start, EGL error " + eglErrorText()};
  const char* extensions = eglQueryString(display, EGL_EXTENSIONS);
  const bool configless =
      hasExtension(extensions, "EGL_KHR_no_config_context") || hasExtension(extensions, "EGL_MESA_configless_context");
  if (!configless || !hasExtension(extensions, "EGL_KHR_surfaceless_context"))
    return Error{ErrorCode::kUnsupported, "display lacks EGL_KHR_no_config_context or EGL_KHR_surfaceless_context"};

  eglBindAPI(EGL_OPENGL_ES_API);
  const std::array<EGLint, 5> attributes{EGL_CONTEXT_MAJOR_VERSION, 3, EGL_CONTEXT_MINOR_VERSION, 0, EGL_NONE};
  EGLContext context = eglCreateContext(display, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, attributes.data());
  if (context == EGL_NO_CONTEXT) return Error{ErrorCode::kUnsupported, "no OpenGL ES 3.0, EGL error " + eglErrorText()};
  if (eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context) != EGL_TRUE) {
    const std::string code = eglErrorText();
    eglDestroyContext(display, context);
    return Error{ErrorCode::kUnsupported, "context does not become current, EGL error " + code};
  }
  return context;
}

struct Candidate {
  std::string name;
  EGLenum platform;
  void* native;
};

/// Returns the displays to try, best first.
std::vector<Candidate> candidates(const char* client_extensions, bool software) {
  std::vector<Candidate> found;
  for (EGLDeviceEXT device : devices(client_extensions, software))
    found.push_back({"EGL device " + std::to_string(found.size()), EGL_PLATFORM_DEVICE_EXT, device});
  if (hasExtension(client_extensions, "EGL_MESA_platform_surfaceless"))
    found.push_back({"EGL surfaceless platform", EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY});
  return found;
}

}  // namespace

struct HeadlessContext::Impl {
  EGLDisplay display = EGL_NO_DISPLAY;
  EGLContext context = EGL_NO_CONTEXT;
  std::string renderer;
};

Result<std::unique_ptr<HeadlessContext>> HeadlessContext::create() {
  // These extensions are known before any display is open.
  const char* client_extensions = eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS);
  const auto platform_display = load<PFNEGLGETPLATFORMDISPLAYEXTPROC>("eglGetPlatformDisplayEXT");
  if (client_extensions == nullptr || platform_display == nullptr)
    return Error{ErrorCode::kUnsupported, std::string("no EGL on this machine: ") + kInstallHint};

  // Try GPUs first, unless the user asks for software; then surfaceless Mesa.
  const char* wanted = std::getenv("LUMIGRID_GL");
  const bool software = wanted != nullptr && std::string_view(wanted) == "software";
  std::string tried;
  for (const Candidate& candidate : candidates(client_extensions, software)) {
    EGLDisplay display = platform_display(candidate.platform, candidate.native, nullptr);
    auto context = contextOn(display);
    if (!context) {
      tried += (tried.empty() ? "" : "; ") + candidate.name + ": " + context.error().message;
      continue;
    }
    std::unique_ptr<HeadlessContext> created(new HeadlessContext());
    created->impl_ = std::make_unique<Impl>(Impl{display, *context, {}});
    const GLubyte* name = glGetString(GL_RENDERER);
    if (name != nullptr) created->impl_->renderer = reinterpret_cast<const char*>(name);
    return created;
  }
  if (tried.empty()) tried = "EGL offers neither devices nor EGL_MESA_platform_surfaceless";
  return Error{ErrorCode::kUnsupported, "no OpenGL ES 3.0 without a window (" + tried + "): " + kInstallHint};
}

HeadlessContext::~HeadlessContext() {
  if (impl_ == nullptr) return;
  release();
  eglDestroyContext(impl_->display, impl_->context);
}

void HeadlessContext::makeCurrent() {
  eglBindAPI(EGL_OPENGL_ES_API);
  eglMakeCurrent(impl_->display, EGL_NO_SURFACE, EGL_NO_SURFACE, impl_->context);
}

void HeadlessContext::release() {
  if (eglGetCurrentContext() != impl_->context) return;
  eglMakeCurrent(impl_->display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
}

std::string HeadlessContext::renderer() const {
  return impl_->renderer;
}

bool HeadlessContext::isSoftware() const {
  for (const char* name : {"llvmpipe", "softpipe", "SwiftShader"})
    if (impl_->renderer.find(name) != std::string::npos) return true;
  return false;
}

}  // namespace base
