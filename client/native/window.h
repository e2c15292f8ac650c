#pragma once
// The viewer in a window: GLFW, mouse and keys, Dear ImGui for the figures (F1) and for problems in plain words.
#include <string>

#include "base/error.h"
#include "client/native/link.h"
#include "client/viewer.h"

namespace client {

struct WindowOptions {
  std::string url;
  ViewerOptions viewer;
  LinkLimit link;
  int width = 1280;  ///< window size at the start, screen units
  int height = 720;
  unsigned decoder_threads = 2;
  bool show_figures = false;  ///< the overlay that F1 turns on and off
};

/// Runs until the window is closed. Errors: no display, no GLES 3 context, GL out of order. A lost server is no error:
/// the window goes on showing what it has, says so, and reconnects.
base::Result<void> runWindow(const WindowOptions& options);

}  // namespace client
