#pragma once
// The settings as a panel of Dear ImGui: the same fields, ranges and words as the page's (client/settings.h). Between
// ImGui's NewFrame and Render.
#include <string>
#include <string_view>

#include "client/app/app.h"
#include "client/native/overlay.h"

namespace client {

class SettingsPanel {
 public:
  /// Changes go to `app` at once, which asks for their keeping; numbers when their field is left. False: the visitor
  /// closed it.
  bool draw(App& app, const OverlayLook& look);

 private:
  void row(App& app, const SettingField& field, float width);
  bool number(const SettingField& field, const std::string& id, double& value);

  std::string_view typing_;  ///< the field that is being typed into, or empty
  double typed_ = 0.0;
};

}  // namespace client
