// Checks a coded file of any bytes, as it is and with its header's checksum made right: checkTree, decoding and
// traversal return, and read only within the file. Decodes any bytes as a block, too.
#include "base/check.h"
#include "base/file.h"
#include "lod/qsplat/blocks.h"
#include "lod/qsplat/traverse.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/coded_splats.h"
#include "tests/support/splat_tree.h"
#include "tests/support/test_meshes.h"

namespace {
using namespace lod::qsplat;

void traverseAll(base::ByteView file) {
  const auto header = readHeader(file);
  if (!header || !header->coded() || header->storedBytes() != file.size()) return;
  const auto blocks = openBlocks(file, *header);
  if (!blocks) return;
  base::ViewCamera view;
  view.position =
      glm::dvec3(header->root.center) + glm::dvec3(0.4, 0.3, 1.5) * static_cast<double>(header->root.radius);
  view.direction = {-0.2, -0.1, -1.0};
  view.width = view.height = 100;
  TraverseRequest request;
  request.camera = base::cameraForScene(view, glm::dvec3(0.0), header->root);
  request.cutoff_px = 0.0F;
  (*blocks)->trackUse();
  const Traversal found = traverse(**blocks, request);
  LUMIGRID_CHECK(found.nodes <= header->nodes + 2048);
  (*blocks)->beginFrame(2);
  (*blocks)->trim(0);
  for (const std::string& fault : checkTree(file)) LUMIGRID_CHECK(fault.find('\n') == std::string::npos);
}

const base::Bytes& goodFile() {
  static const base::Bytes file = support::codedSplats(support::splatFile(support::torus(16, 8)));
  return file;
}

void decodeBlock(base::ByteView bytes) {
  static const Header header = *readHeader(goodFile());
  static const BlockCoder coder = *BlockCoder::fromHeader(goodFile(), header);
  base::Bytes plain(kBlockBytes);
  ChildBlocks children;
  const base::ByteView coded = bytes.first(std::min<std::size_t>(bytes.size(), kMaxCodedBytes));
  if (!coder.decode(1, coded, plain.data(), children)) return;
  LUMIGRID_CHECK(isIntactBlock(plain, 1));
  forEachChildBlock(children, [&](std::uint64_t number, const CodedPlace& place) {
    LUMIGRID_CHECK(number < header.blocks() && place.offset + place.bytes <= header.coded_bytes);
  });
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  const Header header = *readHeader(goodFile());
  const auto first = goodFile().begin() + header.header_bytes;
  return {goodFile(), support::codedSplats(support::splatFile(support::bumpySphere(12, 16), true)),
          *base::readFile(std::string(LUMIGRID_SOURCE_DIR) + "/tests/golden/qsplat_v2.lgq"),
          base::Bytes(first, first + header.first_block_bytes)};
}

void fuzzOne(base::ByteView bytes) {
  traverseAll(bytes);
  traverseAll(support::sealedHeader(bytes));
  decodeBlock(bytes);
}

}  // namespace fuzz
