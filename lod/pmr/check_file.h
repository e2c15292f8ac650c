#pragma once
// Checks a whole pmr.lgm.
#include <string>
#include <vector>

#include "lod/file_bytes.h"
#include "lod/pmr/format.h"

namespace lod::pmr {

/// Checks checksums, counts, that each own point lies in its leaf's cell, each foreign point is an own point of another
/// leaf, boxes contain what they should, each level's mean radius, and the header's figures. Returns a line for each of
/// the first few faults, nothing for an intact file. Memory: that of a leaf and its neighbours' points.
std::vector<std::string> checkFile(const FileBytes& file);

}  // namespace lod::pmr
