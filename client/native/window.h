#pragma once
// The viewer in a window: GLFW and Dear ImGui around client::App, which has all behaviour. The window carries out its
// requests: pictures and clipboard, settings and bookmarks in the user's folder, picks and notes over HTTP.
#include <functional>
#include <string>

#include "base/error.h"
#include "client/app/app.h"
#include "client/native/link.h"

namespace client {

struct WindowOptions {
  std::string url;
  AppOptions app;  ///< the window sets its clock
  bool method_is_default =
      false;  ///< the user named no method: where the scene lacks the data for the viewer's method, another is shown
  LinkLimit link;
  HostAccess access;
  StreamedOptions streamed;  ///< for methods for which isStreamed()
  int width = 1280;          ///< initial window size, screen units
  int height = 720;
  unsigned decoder_threads = 2;
  bool show_figures = false;     ///< shows the statistics (key I) at the start
  std::string view;              ///< permalink of the first view; empty: the whole scene
  std::string config_directory;  ///< folder for settings and bookmarks; empty: nothing is kept
  std::string picture_directory = ".";
  std::string record_file;          ///< gets the way of the camera, a path in time, when the window closes; empty: none
  std::function<bool()> cancelled;  ///< asked often; true closes the window. May be null
};

/// Runs until the window is closed. Errors: no display, no GLES 3 context, GL does not work, an invalid permalink, a
/// record_file that cannot be written. A
/// lost server is no error: the window keeps showing what it has, says so, and reconnects.
base::Result<void> runWindow(const WindowOptions& options);

}  // namespace client
