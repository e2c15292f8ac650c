// addGroup on any bytes, several groups in a row, and cuts through whatever has grown.
#include "base/check.h"
#include "lod/patch/traverse.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/synthetic_hierarchy.h"

namespace {

constexpr std::uint32_t kMaxGroups = 64;
constexpr std::uint32_t kMaxPatches = 256;

const lod::patch::Hierarchy& original() {
  static const lod::patch::Hierarchy made = support::syntheticHierarchy(4).hierarchy;
  return made;
}

base::Bytes messages(std::uint32_t first, std::uint32_t last) {
  base::ByteWriter out;
  for (std::uint32_t g = first; g <= last; ++g) lod::patch::encodeGroup(original(), g, out);
  return out.takeBytes();
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  const auto last = static_cast<std::uint32_t>(original().groups.size()) - 1;
  return {messages(0, 0), messages(0, last), messages(1, 3), messages(last, last)};
}

void fuzzOne(base::ByteView bytes) {
  lod::patch::Hierarchy growing;
  growing.lattice = original().lattice;
  base::ByteReader in(bytes);
  while (in.remaining() > 0) {
    const auto added = lod::patch::addGroup(in, growing, kMaxGroups, kMaxPatches);
    if (!added && !in.ok()) break;
    if (!added) continue;
    LUMIGRID_CHECK(growing.isKnown(*added));
  }
  LUMIGRID_CHECK_LE(growing.groups.size(), std::size_t{kMaxGroups});
  LUMIGRID_CHECK_LE(growing.patches.size(), std::size_t{kMaxPatches});

  // Whatever was let in, a cut ends and names only what is there.
  lod::patch::CutRequest request;
  request.tolerance_px = 0.0F;
  request.cull = false;
  for (const lod::patch::Cut& cut :
       {lod::patch::selectCut(growing, request), lod::patch::selectUniformCut(growing, 0.01F)}) {
    for (const std::uint32_t group : cut.expanded) LUMIGRID_CHECK(growing.isKnown(group));
    for (const std::uint32_t patch : cut.patches) LUMIGRID_CHECK_LT(patch, growing.patches.size());
  }
}

}  // namespace fuzz
