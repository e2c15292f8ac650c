// A file that says whatever it likes, from a host that answers as it likes: the stream asks for no block twice at a
// time and for none beyond the file, keeps no more than its memory, and ends.
#include <algorithm>
#include <deque>

#include "base/check.h"
#include "base/crc32c.h"
#include "lod/qsplat/stream/stream.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/coded_splats.h"
#include "tests/support/splat_tree.h"
#include "tests/support/test_meshes.h"

namespace {
using namespace lod::qsplat;

constexpr int kTurns = 60;

/// Numbers that depend on the input alone.
class Dice {
 public:
  explicit Dice(base::ByteView bytes) : state_(base::crc32c(bytes) | 1U) {}
  std::uint32_t roll(std::uint32_t sides) {
    state_ = state_ * 1664525U + 1013904223U;  // Numerical Recipes
    return (state_ >> 8) % sides;
  }

 private:
  std::uint32_t state_;
};

base::Camera cameraFor(const base::Sphere& root, Dice& dice) {
  base::ViewCamera view;
  const double side = dice.roll(2) == 0 ? 1.0 : -1.0;
  view.position = glm::dvec3(root.center) + side * glm::dvec3(0.4, 0.3, 1.5) * static_cast<double>(root.radius);
  view.direction = side * glm::dvec3(-0.2, -0.1, -1.0);
  view.width = view.height = 100;
  return base::cameraForScene(view, glm::dvec3(0.0), root);
}

struct Host {
  base::ByteView file;
  bool coded;  ///< two blocks of such a file may name one place, and are requested there
  std::deque<ByteRange> asked;

  void acceptRequests(Stream& stream, double now) {
    for (const ByteRange& range : stream.nextRequests(now)) {
      LUMIGRID_CHECK(range.length > 0 && range.offset + range.length <= file.size());
      for (const ByteRange& other : asked)
        LUMIGRID_CHECK(coded || range.offset >= other.offset + other.length ||
                       other.offset >= range.offset + range.length);
      asked.push_back(range);
    }
  }
  void answer(Stream& stream, Dice& dice, double now) {
    if (asked.empty()) return;
    const ByteRange range = asked.front();
    asked.pop_front();
    base::ByteView bytes = file.subspan(static_cast<std::size_t>(range.offset), static_cast<std::size_t>(range.length));
    const std::uint32_t how = dice.roll(8);
    if (how == 0) return stream.acceptFailure(range.id, now);
    if (how == 1) bytes = bytes.first(bytes.size() / 2);
    if (how == 2) bytes = file.first(bytes.size());  // another range than was asked for
    stream.acceptAnswer(range.id, bytes, now);
  }
};

void streamAll(base::ByteView file) {
  Dice dice(file);
  StreamOptions options;
  options.memory_bytes = kMinStreamMemory;
  options.idle_bytes = dice.roll(2) * 4096;
  options.order = static_cast<StreamOrder>(dice.roll(5));
  Stream stream(file.size(), options);
  Host host{file, file.size() > 8 && file[8] == 2, {}};
  Traversal found;
  double now = 0.0;
  for (int turn = 0; turn < kTurns; ++turn) {
    host.acceptRequests(stream, now);
    host.answer(stream, dice, now += 0.3);
    if (stream.header() == nullptr) continue;
    TraverseRequest request;
    request.camera = cameraFor(stream.header()->root, dice);
    stream.traverse(request, std::nullopt, found);
    LUMIGRID_CHECK_LE((stream.stats().present - 1) * kBlockBytes, options.memory_bytes);
    LUMIGRID_CHECK_LE(stream.bytesWasted(), stream.stats().bytes_received);
  }
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  return {support::splatFile(support::bumpySphere(6, 8)), support::splatFile(support::torus(16, 8)),
          support::splatFile(support::torus(40, 30), true),
          support::codedSplats(support::splatFile(support::bumpySphere(20, 30)))};
}

void fuzzOne(base::ByteView bytes) {
  streamAll(bytes);
  if (bytes.size() > 8 && bytes[8] == 2) return streamAll(support::sealedHeader(bytes));
  base::Bytes sealed(bytes.begin(), bytes.end());
  sealed.resize(sealed.size() / kBlockBytes * kBlockBytes);
  if (sealed.empty()) return;
  const std::uint32_t crc = base::crc32c(base::ByteView(sealed).first(kPayloadBytes));
  std::memcpy(&sealed[kPayloadBytes], &crc, sizeof(crc));
  for (std::size_t b = 1; b < sealed.size() / kBlockBytes; ++b)
    sealBlock(&sealed[b * kBlockBytes], static_cast<std::uint32_t>(b));
  streamAll(sealed);
}

}  // namespace fuzz
