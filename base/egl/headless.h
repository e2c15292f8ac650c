#pragma once
// A GLES 3.0 context without window, display or surface, on surfaceless Mesa or on a GPU's EGL device, for the server,
// the headless client and tests.
#include <memory>
#include <string>

#include "base/error.h"

namespace base {

class HeadlessContext {
 public:
  /// Creates a context and leaves it current on the calling thread. Tries EGL devices first (GPUs; only Mesa's software
  /// device if the environment has `LUMIGRID_GL=software`), then surfaceless Mesa. Several contexts may live at once,
  /// each current on one thread at a time. The error lists what was tried and what to install.
  static Result<std::unique_ptr<HeadlessContext>> create();
  ~HeadlessContext();
  HeadlessContext(const HeadlessContext&) = delete;
  HeadlessContext& operator=(const HeadlessContext&) = delete;
  void makeCurrent();            ///< on the calling thread
  void release();                ///< from the calling thread
  std::string renderer() const;  ///< GL_RENDERER
  bool isSoftware() const;       ///< whether the CPU draws (Mesa's llvmpipe or softpipe, or SwiftShader)

 private:
  HeadlessContext() = default;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace base
