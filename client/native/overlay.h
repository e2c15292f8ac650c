#pragma once
// What stands over the picture in the native window, drawn by Dear ImGui from what client::App says: statistics, help,
// toasts, pins and their cards, measured values, the section plane's handle, progress and problems. Between ImGui's
// NewFrame and Render.
#include "client/app/app.h"

namespace client {

struct OverlayLook {
  bool dark = true;
  float scale = 1.0F;  ///< of fonts and distances: the monitor's
};

/// Loads a font that has Latin, Greek and Cyrillic, when the system has one of the usual ones; sets distances. Once,
/// after ImGui::CreateContext().
void setUpOverlay(const OverlayLook& look);
/// Colours; whenever `dark` changes.
void styleOverlay(const OverlayLook& look);
/// The picture's colour where there is no model: RGBA, 0 … 1.
std::array<float, 4> overlayBackground(bool dark);
/// Opening and closing of cards and help goes to `app`.
void drawOverlay(App& app, const OverlayLook& look);

}  // namespace client
