#include "lod/patch/codec/header.h"

#include "base/crc32c.h"

namespace lod::patch::codec {

void writeHeader(base::ByteWriter& out, const PatchHeader& header) {
  out.u8(kCodecVersion);
  out.u8(header.flags);
  out.u16(static_cast<std::uint16_t>(header.vertices));
  out.u16(static_cast<std::uint16_t>(header.triangles));
  out.u8(header.facet_shift);
  out.u8(header.front_bits);
  out.write(header.first_position);
  out.u32(header.steps);
  out.u32(header.escape_bytes);
  out.u32(header.crc);
}

base::Result<PatchHeader> readHeader(base::ByteView bytes) {
  if (bytes.size() < kHeaderBytes) return brokenPatch("cut short: the header alone has 32 bytes");
  base::ByteReader in(bytes);
  if (const std::uint8_t version = in.u8(); version != kCodecVersion)
    return base::Error{base::ErrorCode::kVersion, "patch bytes: codec version " + std::to_string(version) +
                                                      ", this program reads " + std::to_string(kCodecVersion)};

  PatchHeader header;
  header.flags = in.u8();
  header.vertices = in.u16();
  header.triangles = in.u16();
  header.facet_shift = in.u8();
  header.front_bits = in.u8();
  header.first_position = in.read<glm::ivec3>();
  header.steps = in.u32();
  header.escape_bytes = in.u32();
  header.crc = in.u32();

  constexpr int kKnownFlags = kHasColors | kHasAlpha | kIsRough;
  if ((header.flags & ~kKnownFlags) != 0 || (header.hasAlpha() && !header.hasColors()))
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

base::Error brokenPatch(const std::string& what) {
  return {base::ErrorCode::kInvalidInput, "patch bytes: " + what};
}

}  // namespace lod::patch::codec
