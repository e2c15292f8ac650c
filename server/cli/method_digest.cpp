#include "server/cli/method_digest.h"

#include <array>

#include "base/bytes.h"
#include "base/file.h"
#include "base/hash/sha256.h"

namespace server::cli {
namespace {

// All formats begin alike: 8 bytes of magic, then u32 version; the header's last field is its checksum. Where headers
// differ in length (docs/formats/patch.md, docs/formats/qsplat.md) it follows, u32.
constexpr std::size_t kVersionAt = 8;
constexpr std::size_t kLengthAt = 12;
constexpr std::size_t kFieldBytes = 4;

}  // namespace

base::Result<std::string> methodDigest(const std::string& path, std::uint32_t header_bytes) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, base::MappedFile::open(path));
  const base::ByteView bytes = file.bytes();
  base::ByteReader in(bytes.size() < kLengthAt ? base::ByteView() : bytes.subspan(kLengthAt));
  const std::uint32_t told = in.u32();
  const std::size_t header = header_bytes != 0 ? header_bytes : told;
  if (!in.ok() || header < kLengthAt + 2 * kFieldBytes || header > bytes.size())
    return base::Error{base::ErrorCode::kInvalidInput, path + ": is shorter than its header"};

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
