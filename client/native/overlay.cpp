#include "client/native/overlay.h"

#include <imgui/imgui.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

namespace client {
namespace {

constexpr ImGuiWindowFlags kPanel = ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_AlwaysAutoResize |
                                    ImGuiWindowFlags_NoNav | ImGuiWindowFlags_NoFocusOnAppearing |
                                    ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoMove;
constexpr ImGuiWindowFlags kWords = kPanel | ImGuiWindowFlags_NoInputs;

// The overlay's sizes, in screen units: choices of design.
constexpr float kFontPixels = 15.0F;
constexpr float kMargin = 12.0F;
constexpr float kPinRadius = 6.0F;
constexpr float kPointRadius = 4.0F;
constexpr float kHandleRadius = 9.0F;
constexpr float kCardWidth = 320.0F;
constexpr float kProgressHeight = 3.0F;
constexpr float kCreditWidth = 480.0F;
constexpr float kCompassRadius = 20.0F;

/// Places where distributions put fonts that read well.
constexpr const char* kFonts[] = {
    "/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf", "/usr/share/fonts/dejavu-sans-fonts/DejaVuSans.ttf",
    "/usr/share/fonts/TTF/DejaVuSans.ttf", "/usr/share/fonts/truetype/liberation/LiberationSans-Regular.ttf",
    "/usr/share/fonts/noto/NotoSans-Regular.ttf"};
/// Unicode ranges of Latin, Greek and Cyrillic letters, punctuation and signs.
constexpr ImWchar kGlyphs[] = {0x0020, 0x024F, 0x0370, 0x052F, 0x2000, 0x206F, 0x20A0, 0x20BF, 0x2190, 0x21FF, 0};

struct Colors {
  ImVec4 panel, text, quiet, accent, error, edge;
};
Colors colorsOf(bool dark) {
  if (dark)
    return {{0.09F, 0.10F, 0.12F, 0.94F}, {0.93F, 0.94F, 0.96F, 1.0F}, {0.64F, 0.67F, 0.72F, 1.0F},
            {0.42F, 0.68F, 1.00F, 1.0F},  {1.00F, 0.56F, 0.50F, 1.0F}, {0.0F, 0.0F, 0.0F, 0.85F}};
  return {{1.00F, 1.00F, 1.00F, 0.95F}, {0.10F, 0.12F, 0.15F, 1.0F}, {0.36F, 0.39F, 0.44F, 1.0F},
          {0.05F, 0.37F, 0.78F, 1.0F},  {0.72F, 0.11F, 0.09F, 1.0F}, {1.0F, 1.0F, 1.0F, 0.9F}};
}

ImU32 packed(const ImVec4& color) {
  return ImGui::ColorConvertFloat4ToU32(color);
}

/// Draws the overlay of one frame.
class Painter {
 public:
  Painter(App& app, const OverlayLook& look)
      : app_(app),
        scale_(look.scale),
        colors_(colorsOf(look.dark)),
        size_(ImGui::GetIO().DisplaySize),
        pixel_(1.0F / std::max(ImGui::GetIO().DisplayFramebufferScale.x, 1e-3F)) {}

  void drawAll() {
    drawMarks();
    drawProgress();
    if (app_.view().statistics) drawStatistics();
    if (app_.view().colors_by_resolution) drawLegend();
    drawMessages();
    drawCredits();
    if (app_.helpShown()) drawHelp();
    if (app_.openAnnotation()) drawCard();
  }

 private:
  ImVec2 at(double x, double y) const { return {pixel_ * static_cast<float>(x), pixel_ * static_cast<float>(y)}; }

  /// Draws a line with an edge around it, so that it is visible on any ground.
  void line(ImDrawList& list, const ImVec2& a, const ImVec2& b, const ImVec4& color) const {
    list.AddLine(a, b, packed(colors_.edge), 3.5F * scale_);
    list.AddLine(a, b, packed(color), 1.5F * scale_);
  }
  void dot(ImDrawList& list, const ImVec2& center, float radius, const ImVec4& color, bool filled) const {
    list.AddCircleFilled(center, radius + 1.5F * scale_, packed(colors_.edge));
    if (filled)
      list.AddCircleFilled(center, radius, packed(color));
    else
      list.AddCircle(center, radius - 0.5F * scale_, packed(color), 0, 1.5F * scale_);
  }
  /// Draws a text on a small plate; `center` is the middle of its lower edge.
  void plate(ImDrawList& list, const ImVec2& center, const std::string& text) const {
    const ImVec2 size = ImGui::CalcTextSize(text.c_str());
    const float pad = 5.0F * scale_;
    const ImVec2 corner(std::round(center.x - 0.5F * size.x), std::round(center.y - size.y - pad));
    list.AddRectFilled({corner.x - pad, corner.y - 0.5F * pad},
                       {corner.x + size.x + pad, corner.y + size.y + 0.5F * pad}, packed(colors_.panel), 4.0F * scale_);
    list.AddText(corner, packed(colors_.text), text.c_str());
  }

  void drawMarks() const {
    ImDrawList& list = *ImGui::GetBackgroundDrawList();
    for (const LabelLine& one : app_.lines()) line(list, at(one.x0, one.y0), at(one.x1, one.y1), colors_.accent);
    for (const Label& label : app_.labels()) {
      if (!label.visible) continue;
      const ImVec2 place = at(label.x, label.y);
      switch (label.kind) {
        case LabelKind::kPin:
          dot(list, place, scale_ * kPinRadius, colors_.accent, true);
          if (near(place) || label.open) plate(list, {place.x, place.y - scale_ * (kPinRadius + 6.0F)}, label.text);
          break;
        case LabelKind::kPoint:
          dot(list, place, scale_ * kPointRadius, colors_.accent, !label.approximate);
          break;
        case LabelKind::kValue:
          plate(list, {place.x, place.y - scale_ * 8.0F}, label.text);
          break;
        case LabelKind::kSectionHandle:
          dot(list, place, scale_ * kHandleRadius, colors_.accent, false);
          dot(list, place, scale_ * 2.5F, colors_.accent, true);
          break;
      }
    }
  }
  bool near(const ImVec2& place) const {
    const ImVec2 mouse = ImGui::GetIO().MousePos;
    return std::hypot(mouse.x - place.x, mouse.y - place.y) < 14.0F * scale_;
  }

  void drawProgress() const {
    const Progress progress = app_.progress();
    if (!progress.active) return;
    ImDrawList& list = *ImGui::GetForegroundDrawList();
    const float width = size_.x * static_cast<float>(std::max(progress.share, 0.02));
    list.AddRectFilled({0.0F, 0.0F}, {width, kProgressHeight * scale_}, packed(colors_.accent));
  }

  void begin(const char* name, float x, float y, float pivot_x, float pivot_y, ImGuiWindowFlags flags) const {
    ImGui::SetNextWindowPos({x, y}, ImGuiCond_Always, {pivot_x, pivot_y});
    ImGui::Begin(name, nullptr, flags);
  }

  /// Draws names and values in two columns, as wide as they need.
  template <class Rows>
  void table(const char* name, const Rows& rows) const {
    if (!ImGui::BeginTable(name, 2, ImGuiTableFlags_SizingFixedFit)) return;
    for (const auto& [left, right] : rows) {
      ImGui::TableNextRow();
      ImGui::TableNextColumn();
      ImGui::TextColored(colors_.quiet, "%s", std::string(left).c_str());
      ImGui::TableNextColumn();
      ImGui::TextUnformatted(std::string(right).c_str());
    }
    ImGui::EndTable();
  }

  void drawStatistics() const {
    begin("statistics", kMargin * scale_, kMargin * scale_, 0.0F, 0.0F, kWords);
    table("figures", statisticsLines(app_.statistics()));
    ImGui::End();
  }

  /// Draws the legend of the tints at the lower left.
  void drawLegend() const {
    begin("legend", kMargin * scale_, size_.y - kMargin * scale_, 0.0F, 1.0F, kWords);
    ImGui::TextColored(colors_.quiet, "Pixels that the detail spans");
    for (const lod::draw::ResolutionStep& step : lod::draw::kResolutionLegend) {
      const ImVec4 color(step.color[0] / 255.0F, step.color[1] / 255.0F, step.color[2] / 255.0F, 1.0F);
      const float side = ImGui::GetTextLineHeight();
      ImGui::ColorButton("step", color, ImGuiColorEditFlags_NoTooltip, {side, side});
      ImGui::SameLine();
      if (&step == &lod::draw::kResolutionLegend.back())
        ImGui::TextUnformatted("more");
      else
        ImGui::Text("up to %.0f", static_cast<double>(step.up_to_px));
    }
    if (isStreamed(app_.view().method)) ImGui::TextUnformatted("hatched: finer is to come");
    ImGui::End();
  }

  /// Draws, from the bottom up, the problem of the connection, the mode's hint, and the toasts.
  void drawMessages() const {
    float bottom = size_.y - kMargin * scale_;
    const auto show = [&](const std::string& name, const ImVec4& color, const std::string& text,
                          const std::string& advice = "") {
      if (text.empty()) return;
      begin(name.c_str(), 0.5F * size_.x, bottom, 0.5F, 1.0F, kWords);
      ImGui::PushTextWrapPos(0.8F * size_.x);
      ImGui::TextColored(color, "%s", text.c_str());
      if (!advice.empty()) ImGui::TextColored(colors_.quiet, "%s", advice.c_str());
      ImGui::PopTextWrapPos();
      bottom -= ImGui::GetWindowHeight() + 0.5F * kMargin * scale_;
      ImGui::End();
    };
    const Status status = app_.status();
    const bool wrong = status.kind == Status::Kind::kLost || status.kind == Status::Kind::kRefused;
    const bool connecting = status.kind == Status::Kind::kConnecting && app_.sceneName().empty();
    show("status", wrong ? colors_.error : colors_.text, connecting ? "Connecting\u2026" : status.text, status.advice);
    show("hint", colors_.text, app_.modeHint());
    for (auto toast = app_.toasts().rbegin(); toast != app_.toasts().rend(); ++toast)
      show("toast" + std::to_string(toast->id), toast->error ? colors_.error : colors_.text, toast->text);
  }

  /// Draws, at the lower right, the scan's authors and above them where north is.
  void drawCredits() const {
    ImDrawList& list = *ImGui::GetBackgroundDrawList();
    float bottom = size_.y - kMargin * scale_;
    if (const std::string text = app_.attribution(); !text.empty()) {
      const float wrap = std::min(kCreditWidth * scale_, 0.6F * size_.x);
      const ImVec2 size = ImGui::CalcTextSize(text.c_str(), nullptr, false, wrap);
      const ImVec2 corner(size_.x - kMargin * scale_ - size.x, bottom - size.y);
      const float pad = 5.0F * scale_;
      list.AddRectFilled({corner.x - pad, corner.y - 0.5F * pad},
                         {corner.x + size.x + pad, corner.y + size.y + 0.5F * pad}, packed(colors_.panel),
                         4.0F * scale_);
      list.AddText(nullptr, 0.0F, corner, packed(colors_.text), text.c_str(), nullptr, wrap);
      bottom = corner.y - kMargin * scale_;
    }
    if (const auto turn = app_.northTurn()) {
      const float radius = kCompassRadius * scale_;
      drawCompass(list, {size_.x - kMargin * scale_ - radius, bottom - radius}, radius, static_cast<float>(*turn));
    }
  }
  void drawCompass(ImDrawList& list, const ImVec2& center, float radius, float turn) const {
    // `along` towards north, `across` to its right.
    const auto at = [&](float along, float across) -> ImVec2 {
      return {center.x + radius * (along * std::sin(turn) + across * std::cos(turn)),
              center.y + radius * (across * std::sin(turn) - along * std::cos(turn))};
    };
    list.AddCircleFilled(center, radius, packed(colors_.panel));
    list.AddTriangleFilled(at(1.0F, 0.0F), at(0.5F, -0.35F), at(0.5F, 0.35F), packed(colors_.accent));
    const ImVec2 letter = ImGui::CalcTextSize("N");
    list.AddText({center.x - 0.5F * letter.x, center.y - 0.5F * letter.y}, packed(colors_.text), "N");
  }

  void drawHelp() const {
    ImGui::SetNextWindowSizeConstraints({0.0F, 0.0F}, {0.95F * size_.x, 0.95F * size_.y});
    begin("help", 0.5F * size_.x, 0.5F * size_.y, 0.5F, 0.5F, kPanel & ~ImGuiWindowFlags_NoScrollbar);
    table("rows", helpRows());
    ImGui::Spacing();
    if (ImGui::Button("Close")) app_.showHelp(false);
    ImGui::End();
  }

  void drawCard() const {
    const Annotation& note = app_.annotations()[*app_.openAnnotation()];
    const float width = std::min(kCardWidth * scale_, size_.x - 2.0F * kMargin * scale_);
    ImGui::SetNextWindowSizeConstraints({width, 0.0F}, {width, 0.8F * size_.y});
    begin("card", size_.x - kMargin * scale_, kMargin * scale_, 1.0F, 0.0F, kPanel & ~ImGuiWindowFlags_NoScrollbar);
    ImGui::PushTextWrapPos(0.0F);
    ImGui::TextColored(colors_.accent, "%s", note.title.c_str());
    if (!note.text.empty()) {
      ImGui::Spacing();
      ImGui::TextUnformatted(note.text.c_str());
    }
    ImGui::PopTextWrapPos();
    ImGui::Spacing();
    if (ImGui::Button("Close")) app_.showAnnotation(std::nullopt);
    ImGui::End();
  }

  App& app_;
  float scale_;
  Colors colors_;
  ImVec2 size_;  // size of the window, ImGui's units
  float pixel_;  // ImGui's units per framebuffer pixel
};

}  // namespace

void setUpOverlay(const OverlayLook& look) {
  ImGuiIO& io = ImGui::GetIO();
  for (const char* path : kFonts) {
    std::error_code error;
    if (!std::filesystem::exists(path, error)) continue;
    io.Fonts->AddFontFromFileTTF(path, std::round(kFontPixels * look.scale), nullptr, kGlyphs);
    break;
  }
  if (io.Fonts->Fonts.empty()) io.FontGlobalScale = look.scale;

  ImGuiStyle& style = ImGui::GetStyle();
  style.WindowRounding = 6.0F;
  style.FrameRounding = 4.0F;
  style.FrameBorderSize = 1.0F;
  style.WindowPadding = {12.0F, 10.0F};
  style.FramePadding = {10.0F, 4.0F};
  style.CellPadding = {8.0F, 2.0F};
  style.ScaleAllSizes(look.scale);
}

void styleOverlay(const OverlayLook& look) {
  const Colors colors = colorsOf(look.dark);
  ImGuiStyle& style = ImGui::GetStyle();
  if (look.dark)
    ImGui::StyleColorsDark(&style);
  else
    ImGui::StyleColorsLight(&style);
  style.Colors[ImGuiCol_WindowBg] = colors.panel;
  style.Colors[ImGuiCol_Text] = colors.text;
  style.Colors[ImGuiCol_Border] = {0.5F, 0.5F, 0.5F, 0.25F};
}

std::array<float, 4> overlayBackground(bool dark) {
  return dark ? std::array<float, 4>{0.13F, 0.14F, 0.16F, 1.0F} : std::array<float, 4>{0.93F, 0.94F, 0.95F, 1.0F};
}

void drawOverlay(App& app, const OverlayLook& look) {
  Painter(app, look).drawAll();
}

}  // namespace client
