#include "client/app/input.h"

#include <array>
#include <utility>

namespace client {
namespace {

using NamedKey = std::pair<std::string_view, Key>;

/// Keys that go by place (KeyboardEvent.code).
// clang-format off
constexpr std::array<NamedKey, 23> kPlaces{{
    {"KeyW", Key::kW}, {"KeyA", Key::kA}, {"KeyS", Key::kS}, {"KeyD", Key::kD}, {"KeyQ", Key::kQ}, {"KeyE", Key::kE},
    {"ArrowUp", Key::kUp}, {"ArrowDown", Key::kDown}, {"ArrowLeft", Key::kLeft}, {"ArrowRight", Key::kRight},
    {"Home", Key::kHome}, {"PageUp", Key::kPageUp}, {"PageDown", Key::kPageDown}, {"Escape", Key::kEscape},
    {"Enter", Key::kEnter}, {"NumpadEnter", Key::kEnter}, {"Backspace", Key::kBackspace}, {"Delete", Key::kBackspace},
    {"ShiftLeft", Key::kShift}, {"ShiftRight", Key::kShift}, {"NumpadAdd", Key::kPlus}, {"NumpadSubtract", Key::kMinus},
    {"F1", Key::kH},
}};

/// Keys that go by their character in lower case (KeyboardEvent.key).
using PrintedKey = std::pair<char, Key>;
constexpr std::array<PrintedKey, 13> kLetters{{
    {'f', Key::kF}, {'r', Key::kR}, {'i', Key::kI}, {'c', Key::kC}, {'m', Key::kM}, {'n', Key::kN}, {'x', Key::kX},
    {'o', Key::kO}, {'p', Key::kP}, {'v', Key::kV}, {'h', Key::kH}, {'l', Key::kL}, {'g', Key::kG},
}};
constexpr std::array<PrintedKey, 5> kSigns{{
    {'?', Key::kH}, {'+', Key::kPlus}, {'-', Key::kMinus}, {'.', Key::kPageUp}, {',', Key::kPageDown},
}};
// clang-format on

constexpr std::array<HelpRow, 29> kHelp{{
    {"left drag, one finger", "turn around the pivot"},
    {"right or shift drag, two fingers", "move sideways"},
    {"wheel, pinch, + -", "zoom to the cursor"},
    {"double click, double tap, Enter", "set the pivot there"},
    {"W A S D, arrows", "fly; shift: faster"},
    {"Q E", "fly down, up"},
    {"ctrl + arrows", "turn around the pivot"},
    {"F", "show the whole model"},
    {"R, Home", "back to the first view"},
    {"1 to 9", "go to a bookmark; 0: the first view"},
    {"shift + 1 to 9", "set a bookmark (ctrl works, too)"},
    {"I", "statistics"},
    {"C", "colours by resolution"},
    {"L", "a light of your own: drag the sun; with splats shift + L"},
    {"L with splats", "magnifying glass: what it shows comes first and is finer; drag it"},
    {"M", "measure distances, then angles, then nothing"},
    {"Backspace", "take the last measured point back"},
    {"X", "section plane across up, then the other axes, then none"},
    {"shift + X", "cut the other side off"},
    {"Page up, page down", "move the section plane; shift: faster"},
    {"O", "orthographic or perspective"},
    {"N, shift + N", "next and previous note"},
    {"P", "save a picture"},
    {"V", "copy a link to this view"},
    {"G", "settings"},
    {"H, ?", "this help"},
    {"Escape", "leave a mode, close what is open"},
    {"click on a pin", "read a note"},
    {"drag the plane's handle", "move the section plane"},
}};

bool isDigit(char c) {
  return c >= '0' && c <= '9';
}

}  // namespace

Key keyFromNames(std::string_view code, std::string_view key) {
  const char printed = key.size() != 1                  ? '\0'
                       : key[0] >= 'A' && key[0] <= 'Z' ? static_cast<char>(key[0] + 32)
                                                        : key[0];

  // Letters come first: on other layouts they lie elsewhere. Where a letter took the place of W A S D, the arrows still
  // fly.
  for (const PrintedKey& letter : kLetters)
    if (letter.first == printed) return letter.second;
  for (const auto& [place, found] : kPlaces)
    if (place == code) return found;
  for (const std::string_view prefix : {std::string_view("Digit"), std::string_view("Numpad")})
    if (code.size() == prefix.size() + 1 && code.substr(0, prefix.size()) == prefix && isDigit(code.back()))
      return static_cast<Key>(static_cast<int>(Key::k0) + (code.back() - '0'));

  // Signs come last: the keys that type them differ from layout to layout, and digits matter more.
  for (const PrintedKey& sign : kSigns)
    if (sign.first == printed) return sign.second;
  return Key::kNone;
}

std::span<const HelpRow> helpRows() {
  return kHelp;
}

}  // namespace client
