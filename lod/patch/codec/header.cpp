#include "lod/patch/codec/header.h"

#include "base/crc32c.h"
#include "base/fields.h"

namespace lod::patch::codec {

namespace {

// The fields behind the version. Both counts have 16 bits in the file.
auto fieldsOf(auto& header, auto& vertices, auto& triangles) {
  return std::tie(header.flags, vertices, triangles, header.facet_shift, header.front_bits, header.first_position,
                  header.steps, header.escape_bytes, header.crc);
}

}  // namespace

void writeHeader(base::ByteWriter& out, const PatchHeader& header) {
  const auto vertices = static_cast<std::uint16_t>(header.vertices);
  const auto triangles = static_cast<std::uint16_t>(header.triangles);
  out.u8(header.lowBits() > 0 ? kCodecVersion : 1);
  base::writeFields(out, fieldsOf(header, vertices, triangles));
}

base::Result<PatchHeader> readHeader(base::ByteView bytes) {
  if (bytes.size() < kHeaderBytes) return brokenPatch("cut short: the header alone has 32 bytes");
  base::ByteReader in(bytes);
  const std::uint8_t version = in.u8();
  if (version < 1 || version > kCodecVersion)
    return base::Error{base::ErrorCode::kVersion, "patch bytes: codec version " + std::to_string(version) +
                                                      ", this program reads 1 to " + std::to_string(kCodecVersion)};

  PatchHeader header;
  std::uint16_t vertices = 0, triangles = 0;
  base::readFields(in, fieldsOf(header, vertices, triangles));
  header.vertices = vertices, header.triangles = triangles;

  if ((header.lowBits() > 0) != (version == 2) || (header.hasAlpha() && !header.hasColors()))
    return brokenPatch("unknown flags");
  if (header.vertices == 0 || header.triangles == 0) return brokenPatch("no triangles");
  if (header.facet_shift > kMaxFacetShift || header.front_bits > kMaxFrontBits)
    return brokenPatch("unknown parameters");
  const std::uint64_t stated = kHeaderBytes + header.stepBytes() + std::uint64_t{header.escape_bytes};
  if (stated > bytes.size())
    return brokenPatch("cut short: the header says more than " + std::to_string(stated) + " bytes");
  return header;
}

std::uint32_t checksum(base::ByteView bytes) {
  return base::crc32c(bytes.subspan(kHeaderBytes), base::crc32c(bytes.first(kCrcOffset)));
}

base::Error brokenPatch(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, "patch bytes: " + problem};
}

}  // namespace lod::patch::codec
