// PatchFile::open and verify on any file: as it is, and with header's and tables' checksums (and the file's length)
// made right.
#include <unistd.h>

#include <cstdlib>
#include <string>

#include "base/check.h"
#include "base/crc32c.h"
#include "base/file.h"
#include "lod/patch/traverse.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/synthetic_hierarchy.h"

namespace {

// Removed as soon as it is open: nothing is left behind when a target dies.
const std::string& scratchPath() {
  static const std::string path = [] {
    const char* folder = std::getenv("TMPDIR");
    return std::string(folder != nullptr ? folder : "/tmp") + "/fuzz_patch_format_" + std::to_string(::getpid());
  }();
  return path;
}

// open() reads a path: the file is written plainly, without the fsync of a real one.
void fill(base::ByteView bytes) {
  std::FILE* file = std::fopen(scratchPath().c_str(), "wb");
  LUMIGRID_CHECK(file != nullptr);
  LUMIGRID_CHECK_EQ(std::fwrite(bytes.data(), 1, bytes.size(), file), bytes.size());
  std::fclose(file);
}

void openAndUse(base::ByteView bytes) {
  fill(bytes);
  const auto file = lod::patch::PatchFile::open(scratchPath());
  std::remove(scratchPath().c_str());
  if (!file) return;
  // A file that opens keeps everything that traversal relies on.
  static_cast<void>(file->verify());
  LUMIGRID_CHECK(!lod::patch::selectUniformCut(file->hierarchy(), 0.0F).patches.empty());
  lod::patch::CutRequest request;
  request.tolerance_px = 0.0F;
  request.cull = false;
  LUMIGRID_CHECK_EQ(lod::patch::selectCut(file->hierarchy(), request).expanded.size(), file->hierarchy().groups.size());
}

base::Bytes sealed(base::ByteView bytes) {
  base::Bytes out(bytes.begin(), bytes.end());
  const std::uint64_t length = out.size();
  std::memcpy(out.data() + 16, &length, sizeof(length));
  std::uint64_t blocks = 0;
  std::memcpy(&blocks, out.data() + 24, sizeof(blocks));
  if (blocks >= 96 && blocks <= out.size()) {
    const std::uint32_t tables = base::crc32c(base::ByteView(out).subspan(96, blocks - 96));
    std::memcpy(out.data() + 88, &tables, sizeof(tables));
  }
  const std::uint32_t header = base::crc32c(base::ByteView(out).first(92));
  std::memcpy(out.data() + 92, &header, sizeof(header));
  return out;
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  const auto written = support::writeSynthetic(support::syntheticHierarchy(4), scratchPath());
  LUMIGRID_CHECK(static_cast<bool>(written));
  const std::string golden = std::string(LUMIGRID_SOURCE_DIR) + "/tests/golden/";
  std::vector<base::Bytes> all{*base::readFile(scratchPath()), *base::readFile(golden + "patch_v2.lgp"),
                               *base::readFile(golden + "patch_v3.lgp")};
  std::remove(scratchPath().c_str());
  return all;
}

void fuzzOne(base::ByteView bytes) {
  openAndUse(bytes);
  if (bytes.size() >= 96) openAndUse(sealed(bytes));
}

}  // namespace fuzz
