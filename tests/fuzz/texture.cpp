// Decodes any bytes as a texture, and asks it for means.
#include "mesh/texture.h"

#include "base/check.h"
#include "tests/fuzz/fuzz.h"

namespace fuzz {

std::vector<base::Bytes> seeds() {
  // The seeds are a grey PNG of 1 × 1 pixel and the beginning of a JPEG.
  return {{0x89, 'P',  'N',  'G',  13,  10,  26,  10,   0,    0,    0,    13,  'I',  'H',  'D',  'R',  0,
           0,    0,    1,    0,    0,   0,   1,   8,    0,    0,    0,    0,   0x3a, 0x7e, 0x9b, 0x55, 0,
           0,    0,    10,   'I',  'D', 'A', 'T', 0x78, 0x9c, 0x63, 0x60, 0,   0,    0,    2,    0,    1,
           0x48, 0xaf, 0xa4, 0x71, 0,   0,   0,   0,    'I',  'E',  'N',  'D', 0xae, 0x42, 0x60, 0x82},
          {0xff, 0xd8, 0xff, 0xe0, 0, 16, 'J', 'F', 'I', 'F', 0, 1, 1, 0, 0, 1, 0, 1, 0, 0, 0xff, 0xd9}};
}

void fuzzOne(base::ByteView bytes) {
  const auto texture = mesh::Texture::decode(bytes);
  if (!texture) return;
  LUMIGRID_CHECK(texture->width() > 0 && texture->height() > 0);
  for (const double texels : {0.0, 3.0, 1e9})
    LUMIGRID_CHECK_EQ(texture->mean({-0.3, 7.9}, texels).a, std::uint8_t{255});
}

}  // namespace fuzz
