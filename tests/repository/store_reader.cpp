// Reads a store while other processes write it, or after they were killed, and decodes every value. When it sees a
// value for the first time it prints the key's code and the value's CRC-32C on a line: printed values were committed.
//
//   store_reader DIRECTORY          again and again until SIGTERM; waits for the store to appear
//   store_reader DIRECTORY --once   every value once
//
// Exit status 1 and a line on standard error at the first value that is not whole, or that changes.
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <map>
#include <memory>
#include <string>
#include <thread>

#include "base/crc32c.h"
#include "base/jpeg/jpeg.h"
#include "repository/faces/coverage.h"
#include "repository/faces/face_value.h"
#include "repository/store.h"

namespace {

constexpr auto kPause = std::chrono::milliseconds(1);

volatile std::sig_atomic_t stop_requested = 0;

class Reader {
 public:
  /// Returns false at the first fault.
  bool pass(const repository::Store& store) {
    bool sound = true;
    const auto walked = store.forEach([&](const repository::FaceKey& key, base::ByteView value) {
      sound = checkValue(key, value);
      return sound && stop_requested == 0;
    });
    if (!walked) std::fprintf(stderr, "%s\n", walked.error().message.c_str());
    return walked && sound;
  }

 private:
  bool checkValue(const repository::FaceKey& key, base::ByteView bytes) {
    const std::uint32_t crc = base::crc32c(bytes);
    const auto [it, is_new] = seen_.emplace(key.code(), crc);
    if (!is_new) return it->second == crc || fault(key, "changed");
    const auto value = repository::decodeFaceValue(bytes);
    if (!value) return fault(key, value.error().message);
    if (!value->empty) {
      const auto image = base::decodeJpeg(value->picture, 16384);
      if (!image) return fault(key, image.error().message);
      if (const auto mask = repository::decodeCoverage(value->coverage, image->width, image->height); !mask)
        return fault(key, mask.error().message);
    }
    const std::string line = std::to_string(key.code()) + " " + std::to_string(crc) + "\n";
    return ::write(STDOUT_FILENO, line.data(), line.size()) == static_cast<ssize_t>(line.size());
  }
  static bool fault(const repository::FaceKey& key, const std::string& what) {
    std::fprintf(stderr, "face (%u, %u, %u, %u): %s\n", key.x, key.y, key.z, key.d, what.c_str());
    return false;
  }

  std::map<std::uint64_t, std::uint32_t> seen_;
};

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) return 2;
  const bool once = argc > 2 && std::strcmp(argv[2], "--once") == 0;
  std::signal(SIGTERM, [](int) { stop_requested = 1; });
  std::unique_ptr<repository::Store> store;
  while (!store && stop_requested == 0) {
    auto opened = repository::openLmdbStore(argv[1], repository::StoreMode::kRead);
    if (opened) {
      store = std::move(*opened);
    } else if (once || opened.error().code != base::ErrorCode::kNotFound) {
      std::fprintf(stderr, "%s\n", opened.error().message.c_str());
      return 1;
    } else {
      std::this_thread::sleep_for(kPause);  // the writer has not begun, or just begins
    }
  }
  Reader reader;
  while (stop_requested == 0) {
    if (!reader.pass(*store)) return 1;
    if (once) break;
    std::this_thread::sleep_for(kPause);
  }
  return 0;
}
