#pragma once
// A GLES 3.0 context without window, display or surface (surfaceless Mesa, or an EGL device for a
// GPU). Shared by server, headless client and tests, hence in base (docs/architecture.md says why it left server/gl).
#include <memory>
#include <string>

#include "base/error.h"

namespace base {

class HeadlessContext {
 public:
  /// Makes a context and leaves it current on the calling thread. Tries EGL devices first (GPUs; only Mesa's software
  /// device when the environment has `LUMIGRID_GL=software`), then surfaceless Mesa. Several contexts may live at once,
  /// each current on one thread at a time. The error says what was tried and what to install.
  static Result<std::unique_ptr<HeadlessContext>> create();
  ~HeadlessContext();
  HeadlessContext(const HeadlessContext&) = delete;
  HeadlessContext& operator=(const HeadlessContext&) = delete;
  void makeCurrent();            ///< on the calling thread
  void release();                ///< from the calling thread
  std::string renderer() const;  ///< GL_RENDERER
  bool isSoftware() const;       ///< drawn by the CPU (Mesa's llvmpipe or softpipe, or SwiftShader)

 private:
  HeadlessContext() = default;
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace base
