#include "server/cli/method_digest.h"

#include <array>

#include "base/bytes.h"
#include "base/file.h"
#include "base/hash/sha256.h"

namespace server::cli {
namespace {

// All formats begin alike (docs/formats/patch.md, qsplat.md and pmr.md there): 8 bytes of magic, u32 version, u32
// length of the header, whose last field is its checksum.
constexpr std::size_t kVersionAt = 8;
constexpr std::size_t kLengthAt = 12;
constexpr std::size_t kFieldBytes = 4;

}  // namespace

base::Result<std::string> methodDigest(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, base::MappedFile::open(path));
  const base::ByteView bytes = file.bytes();
  base::ByteReader in(bytes.size() < kLengthAt ? base::ByteView() : bytes.subspan(kLengthAt));
  const std::size_t header = in.u32();
  if (!in.ok() || header < kLengthAt + 2 * kFieldBytes || header > bytes.size())
    return base::Error{base::ErrorCode::kInvalidInput, path + ": is shorter than its header says"};

  constexpr std::array<std::uint8_t, kFieldBytes> kZeros{};
  base::Sha256 hash;
  hash.add(bytes.first(kVersionAt));
  hash.add(kZeros);
  hash.add(bytes.subspan(kLengthAt, header - kFieldBytes - kLengthAt));
  hash.add(kZeros);
  hash.add(bytes.subspan(header));
  return base::hexOf(hash.finish());
}

}  // namespace server::cli
