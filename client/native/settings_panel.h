#pragma once
// Shows the settings as a panel of Dear ImGui, with the same fields, ranges and labels as the page
// (client/app/settings.h). Called between ImGui's NewFrame and Render.
#include <string>
#include <string_view>

#include "client/app/app.h"
#include "client/native/overlay.h"

namespace client {

class SettingsPanel {
 public:
  /// Passes changes to `app` at once, numbers when their field is left. Returns false when the user closed the panel.
  bool draw(App& app, const OverlayLook& look);

 private:
  void row(App& app, const SettingField& field, float width);
  bool number(const SettingField& field, const std::string& id, double& value);

  std::string_view typing_;  ///< the field that is being typed into, or empty
  double typed_ = 0.0;
};

}  // namespace client
