#pragma once
// Converts a qsplat.lgq in memory from the plain to the coded form and back.
#include <algorithm>
#include <cstring>

#include "base/check.h"
#include "base/crc32c.h"
#include "lod/qsplat/blocks.h"
#include "lod/qsplat/builder/code_file.h"

namespace support {

inline base::Bytes codedSplats(base::ByteView plain, unsigned threads = 1) {
  base::Bytes coded;
  const auto header = lod::qsplat::builder::codeFile(
      [&](std::uint64_t offset, std::span<std::uint8_t> out) {
        std::copy_n(plain.begin() + static_cast<std::ptrdiff_t>(offset), out.size(), out.begin());
        return base::Result<void>();
      },
      [&](base::ByteView bytes) {
        coded.insert(coded.end(), bytes.begin(), bytes.end());
        return base::Result<void>();
      },
      threads);
  LUMIGRID_CHECK(static_cast<bool>(header));
  return coded;
}

/// Converts back: all blocks decoded, behind a plain header.
inline base::Bytes plainSplats(base::ByteView coded) {
  lod::qsplat::Header header = *lod::qsplat::readHeader(coded);
  const auto blocks = lod::qsplat::openBlocks(coded, header);
  LUMIGRID_CHECK(static_cast<bool>(blocks));
  header.coded_bytes = 0;
  base::Bytes plain = lod::qsplat::headerBytes(header);
  for (std::uint64_t b = 1; b < header.blocks(); ++b) {
    const std::uint8_t* block = (*blocks)->find(b);
    LUMIGRID_CHECK(block != nullptr);
    plain.insert(plain.end(), block, block + lod::qsplat::kBlockBytes);
  }
  return plain;
}

/// Makes a file of any bytes: sets the header's checksum, and with `length_too` also the length of the file in it.
inline base::Bytes sealedHeader(base::ByteView bytes, bool length_too = true) {
  base::Bytes sealed(bytes.begin(), bytes.end());
  if (sealed.size() < 24) return sealed;
  const std::uint64_t file_bytes = sealed.size();
  if (length_too) std::memcpy(&sealed[16], &file_bytes, sizeof(file_bytes));
  std::uint32_t length = 0;
  std::memcpy(&length, &sealed[12], sizeof(length));
  if (length < 24 || length > sealed.size()) return sealed;
  const std::uint32_t crc = base::crc32c(base::ByteView(sealed).first(length - 4));
  std::memcpy(&sealed[length - 4], &crc, sizeof(crc));
  return sealed;
}

}  // namespace support
