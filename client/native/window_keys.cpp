#include "client/native/window_keys.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include <map>
#include <string>

namespace client {
namespace {

/// Returns the place of a key as a browser names it (KeyboardEvent.code).
std::string codeOf(int key) {
  if (key >= GLFW_KEY_A && key <= GLFW_KEY_Z) return std::string("Key") + static_cast<char>('A' + key - GLFW_KEY_A);
  if (key >= GLFW_KEY_0 && key <= GLFW_KEY_9) return "Digit" + std::to_string(key - GLFW_KEY_0);
  if (key >= GLFW_KEY_KP_0 && key <= GLFW_KEY_KP_9) return "Numpad" + std::to_string(key - GLFW_KEY_KP_0);
  // clang-format off
  static const std::map<int, const char*> kNames{
      {GLFW_KEY_UP, "ArrowUp"}, {GLFW_KEY_DOWN, "ArrowDown"}, {GLFW_KEY_LEFT, "ArrowLeft"},
      {GLFW_KEY_RIGHT, "ArrowRight"}, {GLFW_KEY_HOME, "Home"}, {GLFW_KEY_ESCAPE, "Escape"},
      {GLFW_KEY_PAGE_UP, "PageUp"}, {GLFW_KEY_PAGE_DOWN, "PageDown"}, {GLFW_KEY_DELETE, "Delete"},
      {GLFW_KEY_ENTER, "Enter"}, {GLFW_KEY_KP_ENTER, "NumpadEnter"}, {GLFW_KEY_BACKSPACE, "Backspace"},
      {GLFW_KEY_LEFT_SHIFT, "ShiftLeft"}, {GLFW_KEY_RIGHT_SHIFT, "ShiftRight"}, {GLFW_KEY_KP_ADD, "NumpadAdd"},
      {GLFW_KEY_KP_SUBTRACT, "NumpadSubtract"}, {GLFW_KEY_F1, "F1"}};
  // clang-format on
  const auto found = kNames.find(key);
  return found != kNames.end() ? found->second : "";
}

}  // namespace

Modifiers modifiersOf(int mods) {
  return {(mods & GLFW_MOD_SHIFT) != 0, (mods & (GLFW_MOD_CONTROL | GLFW_MOD_SUPER)) != 0, (mods & GLFW_MOD_ALT) != 0};
}

/// GLFW reports characters as typed without shift, so shift + '/' is taken for '?' and shift + '=' for '+'.
Key keyOf(int key, int scancode, int mods) {
  const char* printed = glfwGetKeyName(key, scancode);
  std::string text = printed != nullptr ? printed : "";
  if (text == "/" && (mods & GLFW_MOD_SHIFT) != 0) text = "?";
  if (text == "=" && (mods & GLFW_MOD_SHIFT) != 0) text = "+";
  return keyFromNames(codeOf(key), text);
}

}  // namespace client
