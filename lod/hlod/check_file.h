#pragma once
// Checks a whole hlod.lgh.
#include <string>
#include <vector>

#include "lod/file_bytes.h"
#include "lod/hlod/format.h"

namespace lod::hlod {

/// Checks checksums, counts, that geometry lies in its node's box, that boxes and errors of parents contain those of
/// their children, and the header's figures. Returns a line for each of the first few faults, nothing for an intact
/// file. Memory: that of a node.
std::vector<std::string> checkFile(const FileBytes& file);

}  // namespace lod::hlod
