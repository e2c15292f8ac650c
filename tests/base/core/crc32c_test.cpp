#include "base/crc32c.h"

#include <gtest/gtest.h>

#include <string>

namespace {

base::ByteView view(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

// RFC 3720, appendix B.4, and the customary check value.
TEST(Crc32c, givesThePublishedValues) {
  EXPECT_EQ(base::crc32c(view("123456789")), 0xE3069283U);
  EXPECT_EQ(base::crc32c(view(std::string(32, '\0'))), 0x8A9136AAU);
  EXPECT_EQ(base::crc32c(view(std::string(32, '\xff'))), 0x62A8AB43U);
  EXPECT_EQ(base::crc32c({}), 0U);
}

TEST(Crc32c, ofPartsEqualsOfTheWhole) {
  const std::string text = "the quick brown fox jumps over the lazy dog";
  for (std::size_t cut = 0; cut <= text.size(); ++cut)
    EXPECT_EQ(base::crc32c(view(text.substr(cut)), base::crc32c(view(text.substr(0, cut)))), base::crc32c(view(text)));
}

}  // namespace
