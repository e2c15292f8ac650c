#include "lod/pmr/range_coder.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace lod::pmr {
namespace {

TEST(RangeCoderTest, bitsAndNumbersReturn) {
  std::mt19937_64 random(4);
  for (int round = 0; round < 50; ++round) {
    struct Item {
      std::uint32_t kind;
      std::uint64_t value;
    };
    std::vector<Item> items(random() % 400);
    for (Item& item : items) {
      item.kind = static_cast<std::uint32_t>(random() % 6);
      const unsigned length = static_cast<unsigned>(random() % 62);
      item.value = random() >> (63 - length) >> 1;
    }
    const auto code = [&](auto& coder) {
      BitModel bit;
      SymbolModel<5> symbol;
      NumberModel number;
      LongNumberModel long_number;
      SignedModel signed_number;
      std::vector<std::uint64_t> values;
      for (const auto& [kind, value] : items) {
        const auto low = static_cast<std::uint32_t>(value);
        const auto wide = static_cast<std::int32_t>(low & 0x7FFFFFFF);
        switch (kind) {
          case 0:
            values.push_back(coder.bit(bit, low % 7 == 0 ? 1 : 0));
            break;
          case 1:
            values.push_back(symbol.code(coder, low & 31));
            break;
          case 2:
            values.push_back(number.code(coder, low & 0x7FFFFFFF));
            break;
          case 3:
            values.push_back(long_number.code(coder, value));
            break;
          case 4:
            values.push_back(static_cast<std::uint64_t>(signed_number.code(coder, value % 2 == 0 ? wide : -wide)));
            break;
          default:
            values.push_back(codeRaw(coder, 40, value & ((std::uint64_t{1} << 40) - 1)));
        }
      }
      return values;
    };
    RangeEncoder encoder;
    const auto written = code(encoder);
    const base::Bytes bytes = encoder.finish();
    RangeDecoder decoder(bytes);
    EXPECT_EQ(code(decoder), written) << "round " << round;
  }
}

TEST(RangeCoderTest, manyOnesCarryThroughAllBytes) {
  // Raw bits of 1 keep the low end at the top of its range, so a late carry goes far.
  for (int tail = 0; tail < 200; ++tail) {
    RangeEncoder encoder;
    BitModel model;
    std::vector<std::uint32_t> bits;
    for (int i = 0; i < 100; ++i) encoder.raw(16, 0xFFFF);
    for (int i = 0; i < tail; ++i) bits.push_back(encoder.bit(model, i % 5 != 0 ? 1 : 0));
    const base::Bytes bytes = encoder.finish();
    RangeDecoder decoder(bytes);
    BitModel again;
    for (int i = 0; i < 100; ++i) ASSERT_EQ(decoder.raw(16), 0xFFFFU);
    for (const std::uint32_t bit : bits) ASSERT_EQ(decoder.bit(again), bit);
  }
}

TEST(RangeCoderTest, rareBitsCostLittle) {
  RangeEncoder encoder;
  BitModel model;
  for (int i = 0; i < 100'000; ++i) encoder.bit(model, i % 1000 == 0 ? 1 : 0);
  EXPECT_LT(encoder.finish().size(), 500U);  // the entropy is 143 bytes
}

TEST(RangeCoderTest, anyBytesDecode) {
  std::mt19937 random(1);
  for (std::size_t length = 0; length < 60; ++length) {
    base::Bytes bytes(length);
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
    RangeDecoder decoder(bytes);
    SignedModel number;
    for (int i = 0; i < 1000; ++i) number.code(decoder, 0);
    EXPECT_LT(decoder.raw(16), 65'536U);
  }
}

}  // namespace
}  // namespace lod::pmr
