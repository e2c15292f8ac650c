// A traversal over whatever a qsplat.lgq may say: it ends, draws no more than the file has nodes, and asks only for
// blocks that it could have.
#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "base/crc32c.h"
#include "lod/qsplat/traverse.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/splat_tree.h"
#include "tests/support/test_meshes.h"

namespace {
using namespace lod::qsplat;

base::Camera cameraFor(const base::Sphere& root, bool parallel) {
  base::ViewCamera view;
  view.position = glm::dvec3(root.center) + glm::dvec3(0.4, 0.3, 1.5) * static_cast<double>(root.radius);
  view.direction = {-0.2, -0.1, -1.0};
  view.width = view.height = 200;
  if (parallel) view.ortho_height = static_cast<double>(root.radius);
  return base::cameraForScene(view, glm::dvec3(0.0), root);
}

void check(const Traversal& found, const Header& header) {
  LUMIGRID_CHECK_LE(found.splats.size(), std::max<std::uint64_t>(header.nodes, 1) + kMaxChildren * 1024);
  for (const Splat& splat : found.splats) LUMIGRID_CHECK_LT(splat.normal & 0x3FFF, 1 << kNormalBits);
  for (std::size_t i = 0; i < found.wanted.size(); ++i) {
    LUMIGRID_CHECK_LT(found.wanted[i].block, header.blocks());
    LUMIGRID_CHECK(!std::isnan(found.wanted[i].priority));
    LUMIGRID_CHECK(i == 0 || found.wanted[i - 1].priority >= found.wanted[i].priority);
  }
}

void traverseAll(base::ByteView file, const Header& header) {
  MemoryBlocks whole(file, header);
  GrowingBlocks half(header);
  for (std::uint64_t b = 1; b < header.blocks(); b += 2) half.put(b, &file[b * kBlockBytes]);
  for (Blocks* blocks : {static_cast<Blocks*>(&whole), static_cast<Blocks*>(&half)})
    for (const bool parallel : {false, true}) {
      TraverseRequest request;
      request.camera = cameraFor(header.root, parallel);
      request.cull = request.cull_back_faces = parallel;
      request.cutoff_px = parallel ? 3.0F : 0.0F;
      check(traverse(*blocks, request), header);
    }
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  return {support::splatFile(support::bumpySphere(6, 8)), support::splatFile(support::torus(16, 8)),
          support::splatFile(support::torus(12, 6), true)};
}

void fuzzOne(base::ByteView bytes) {
  // As it is, and with the checksums made right again.
  base::Bytes sealed(bytes.begin(), bytes.end());
  sealed.resize(sealed.size() / kBlockBytes * kBlockBytes);
  if (!sealed.empty()) {
    const std::uint32_t crc = base::crc32c(base::ByteView(sealed).first(kPayloadBytes));
    std::memcpy(&sealed[kPayloadBytes], &crc, sizeof(crc));
  }
  for (std::size_t b = 1; b < sealed.size() / kBlockBytes; ++b)
    sealBlock(&sealed[b * kBlockBytes], static_cast<std::uint32_t>(b));
  for (const base::ByteView file : {bytes, base::ByteView(sealed)}) {
    const auto header = readHeader(file);
    if (header && header->file_bytes == file.size()) traverseAll(file, *header);
  }
}

}  // namespace fuzz
