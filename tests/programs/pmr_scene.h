#pragma once
// Writes a scene of points and umbrellas.
#include <string>

#include "tests/programs/streamed_scene.h"
#include "tests/support/made_pmr.h"

namespace programs {

/// Puts a torus of points into the folder. Returns what is in its file.
inline support::MadePmr writePmrScene(const std::string& directory) {
  support::MadePmr made = support::madePmr();
  writeStreamedScene(directory, base::kUmbrellaMethod, made.file, 1.5);
  return made;
}

}  // namespace programs
