#pragma once
// The viewer in a window: GLFW and Dear ImGui around client::App, which has all behaviour. Here are its requests
// carried out: pictures and clipboard, settings and bookmarks in the user's directory, picks and notes over HTTP.
#include <string>

#include "base/error.h"
#include "client/app/app.h"
#include "client/native/link.h"

namespace client {

struct WindowOptions {
  std::string url;
  AppOptions app;  ///< its clock is set here
  bool method_is_default =
      false;  ///< nobody asked for the viewer's method: where the scene lacks its data, another is shown
  LinkLimit link;
  SplatOptions splats;  ///< with ViewerOptions::method kQsplat
  int width = 1280;     ///< window size at the start, screen units
  int height = 720;
  unsigned decoder_threads = 2;
  bool show_figures = false;     ///< begins with the statistics that I shows
  std::string view;              ///< a permalink to begin with; empty: the whole scene
  std::string config_directory;  ///< of settings and bookmarks; empty: nothing is kept
  std::string picture_directory = ".";
};

/// Runs until the window is closed. Errors: no display, no GLES 3 context, GL out of order, a view that is no
/// permalink. A lost server is no error: the window goes on showing what it has, says so, and reconnects.
base::Result<void> runWindow(const WindowOptions& options);

}  // namespace client
