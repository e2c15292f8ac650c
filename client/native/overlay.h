#pragma once
// Draws the overlay of the native window with Dear ImGui, from the state of client::App: statistics, help, toasts, pins
// and their cards, measured values, the section plane's handle, progress and problems. Called between ImGui's NewFrame
// and Render.
#include "client/app/app.h"

namespace client {

struct OverlayLook {
  bool dark = true;
  float scale = 1.0F;  ///< scale of fonts and distances, from the monitor
};

/// Sets distances, and loads a font that has Latin, Greek and Cyrillic when the system has one of the usual ones.
/// Called once, after ImGui::CreateContext().
void setUpOverlay(const OverlayLook& look);
/// Sets the colours; called whenever `dark` changes.
void styleOverlay(const OverlayLook& look);
/// Returns the picture's colour where there is no model: RGBA, 0 … 1.
std::array<float, 4> overlayBackground(bool dark);
/// Draws the overlay. Clicks that open or close cards and help go to `app`.
void drawOverlay(App& app, const OverlayLook& look);

}  // namespace client
