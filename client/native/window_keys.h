#pragma once
// Translates GLFW's keys to the viewer's. Private to client/native/window.cpp.
#include "client/app/input.h"

namespace client {

/// Translates GLFW's modifier bits.
Modifiers modifiersOf(int mods);
/// Translates a key by its place and its character (keyFromNames).
Key keyOf(int key, int scancode, int mods);

}  // namespace client
