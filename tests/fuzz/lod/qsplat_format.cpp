// Runs checkTree on any bytes, as they are and with all checksums (and the header's length of the file) made right. A
// file in which it finds no fault must decode to finite spheres, node by node.
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <string>

#include "base/check.h"
#include "base/crc32c.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/random_splats.h"

namespace {

using namespace lod::qsplat;

void checkAndUse(base::ByteView bytes) {
  if (!checkTree(bytes).empty()) return;
  const auto nodes = support::decodeSplats(bytes);
  LUMIGRID_CHECK_EQ(nodes.size(), readHeader(bytes)->nodes);
  for (const support::DecodedNode& node : nodes) {
    LUMIGRID_CHECK(node.among_leaves ? node.node.hasCodes() : node.node.valid());
    LUMIGRID_CHECK(node.sphere.radius >= 0.0F);
  }
}

base::Bytes sealed(base::ByteView bytes) {
  base::Bytes out(bytes.begin(), bytes.end());
  out.resize(out.size() / kBlockBytes * kBlockBytes);
  const std::uint64_t length = out.size();
  std::memcpy(out.data() + 16, &length, sizeof(length));
  const std::uint32_t crc = base::crc32c(base::ByteView(out).first(kPayloadBytes));
  std::memcpy(out.data() + kPayloadBytes, &crc, sizeof(crc));
  for (std::size_t at = kBlockBytes; at < out.size(); at += kBlockBytes)
    sealBlock(out.data() + at, static_cast<std::uint32_t>(at / kBlockBytes));
  return out;
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  const char* folder = std::getenv("TMPDIR");
  const std::string scratch =
      std::string(folder != nullptr ? folder : "/tmp") + "/fuzz_qsplat_format_" + std::to_string(::getpid());
  std::vector<base::Bytes> all;
  all.push_back(*base::readFile(std::string(LUMIGRID_SOURCE_DIR) + "/tests/golden/qsplat_v1.lgq"));
  for (const bool colors : {false, true})
    for (const bool wide : {false, true}) all.push_back(support::randomSplats(9, colors, wide, scratch, 5));
  return all;
}

void fuzzOne(base::ByteView bytes) {
  checkAndUse(bytes);
  if (bytes.size() >= kBlockBytes) checkAndUse(sealed(bytes));
}

}  // namespace fuzz
