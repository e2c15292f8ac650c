#include "base/crc32c.h"

#include <gtest/gtest.h>

#include <random>
#include <string>
#include <vector>

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
  EXPECT_EQ(base::crc32cByTables(view("123456789")), 0xE3069283U);
  EXPECT_EQ(base::crc32cByTables(view(std::string(32, '\0'))), 0x8A9136AAU);
  EXPECT_EQ(base::crc32cByTables({}), 0U);
}

// Computes the CRC by its definition, bit by bit.
std::uint32_t crcByBits(base::ByteView bytes, std::uint32_t seed) {
  std::uint32_t crc = ~seed;
  for (const std::uint8_t byte : bytes) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ ((crc & 1U) != 0 ? 0x82F63B78U : 0U);
  }
  return ~crc;
}

// The instruction of this processor, the tables of others, and the definition give the same.
TEST(Crc32c, isTheSameByInstructionByTablesAndByBits) {
  std::mt19937 random(1);
  std::vector<std::uint8_t> bytes(3000);
  for (std::uint8_t& b : bytes) b = static_cast<std::uint8_t>(random());
  for (int run = 0; run < 2000; ++run) {
    const std::size_t begin = random() % 16;
    const std::size_t size = run < 64 ? static_cast<std::size_t>(run) : random() % (bytes.size() - begin);
    const base::ByteView part = base::ByteView(bytes).subspan(begin, size);
    const std::uint32_t seed = run % 3 == 0 ? 0U : static_cast<std::uint32_t>(random());
    const std::uint32_t expected = crcByBits(part, seed);
    ASSERT_EQ(base::crc32c(part, seed), expected) << size << " bytes at " << begin << ", seed " << seed;
    ASSERT_EQ(base::crc32cByTables(part, seed), expected) << size << " bytes at " << begin << ", seed " << seed;
  }
}

TEST(Crc32c, continuesOverPartsToThatOfTheWhole) {
  const std::string text = "the quick brown fox jumps over the lazy dog";
  for (std::size_t cut = 0; cut <= text.size(); ++cut)
    EXPECT_EQ(base::crc32c(view(text.substr(cut)), base::crc32c(view(text.substr(0, cut)))), base::crc32c(view(text)));
}

}  // namespace
