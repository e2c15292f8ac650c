#include "client/native/settings_panel.h"

#include <imgui/imgui.h>

#include <string>

namespace client {
namespace {

constexpr float kInputWidth = 150.0F;
constexpr ImGuiWindowFlags kFlags = ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_NoResize |
                                    ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoSavedSettings |
                                    ImGuiWindowFlags_NoMove;

/// Returns the choices as ImGui takes a list: "system\0light\0dark\0\0".
std::string listOf(const SettingField& field) {
  std::string list;
  for (int place = 0; place <= static_cast<int>(field.max); ++place)
    list.append(choiceName(field, place)).push_back('\0');
  return list;
}

/// Draws a flag or choice; returns true when it was changed, to `value`.
bool control(const SettingField& field, const std::string& id, double& value) {
  if (field.kind == SettingKind::kFlag) {
    bool on = value != 0.0;
    const bool changed = ImGui::Checkbox(id.c_str(), &on);
    value = on ? 1.0 : 0.0;
    return changed;
  }
  int place = static_cast<int>(value);
  const bool changed = ImGui::Combo(id.c_str(), &place, listOf(field).c_str());
  value = place;
  return changed;
}

}  // namespace

/// Draws a number. The typed text stays here until the field is left, since half a number may be out of range.
bool SettingsPanel::number(const SettingField& field, const std::string& id, double& value) {
  if (typing_ == field.name) value = typed_;
  ImGui::InputDouble(id.c_str(), &value, 0.0, 0.0, field.kind == SettingKind::kInteger ? "%.0f" : "%.6g");
  if (ImGui::IsItemActive()) {
    typing_ = field.name;
    typed_ = value;
  } else if (typing_ == field.name) {
    typing_ = {};
  }
  return ImGui::IsItemDeactivatedAfterEdit();
}

void SettingsPanel::row(App& app, const SettingField& field, float width) {
  ImGui::TableNextRow();
  ImGui::TableNextColumn();
  ImGui::AlignTextToFramePadding();
  ImGui::TextUnformatted(field.label.data(), field.label.data() + field.label.size());
  if (field.from_next_start) {
    ImGui::SameLine();
    ImGui::TextDisabled("(next start)");
  }
  ImGui::TableNextColumn();
  ImGui::SetNextItemWidth(width);
  const std::string id = "##" + std::string(field.name);
  const bool typed = field.kind == SettingKind::kNumber || field.kind == SettingKind::kInteger;
  double value = app.settings().*(field.value);
  if (!(typed ? number(field, id, value) : control(field, id, value))) return;
  if (auto changed = app.changeSetting(field.name, value); !changed) app.showToast(changed.error().message, true);
}

bool SettingsPanel::draw(App& app, const OverlayLook& look) {
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos({0.5F * size.x, 0.5F * size.y}, ImGuiCond_Always, {0.5F, 0.5F});
  ImGui::SetNextWindowSizeConstraints({0.0F, 0.0F}, {0.95F * size.x, 0.95F * size.y});
  bool open = true;
  if (ImGui::Begin("Settings", &open, kFlags) && ImGui::BeginTable("fields", 2, ImGuiTableFlags_SizingFixedFit)) {
    for (const SettingField& field : settingFields()) row(app, field, kInputWidth * look.scale);
    ImGui::EndTable();
  }
  ImGui::End();
  return open;
}

}  // namespace client
