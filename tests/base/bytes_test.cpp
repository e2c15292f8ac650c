#include "base/bytes.h"

#include <gtest/gtest.h>

namespace {

TEST(Bytes, writtenValuesReadBack) {
  base::ByteWriter out;
  out.u8(7);
  out.u16(0x1234);
  out.u32(0xdeadbeef);
  out.u64(0x0123456789abcdefULL);
  out.f32(1.5F);
  out.f64(-2.25);
  out.string16("survey");
  const base::Bytes bytes = out.takeBytes();
  EXPECT_EQ(bytes[1], 0x34) << "little-endian";
  base::ByteReader in(bytes);
  EXPECT_EQ(in.u8(), 7);
  EXPECT_EQ(in.u16(), 0x1234);
  EXPECT_EQ(in.u32(), 0xdeadbeef);
  EXPECT_EQ(in.u64(), 0x0123456789abcdefULL);
  EXPECT_EQ(in.f32(), 1.5F);
  EXPECT_EQ(in.f64(), -2.25);
  EXPECT_EQ(in.string16(), "survey");
  EXPECT_TRUE(in.atEnd());
}

TEST(Bytes, readingPastTheEndFailsForGood) {
  const base::Bytes bytes{1, 2, 3};
  base::ByteReader in(bytes);
  EXPECT_EQ(in.u32(), 0U);
  EXPECT_FALSE(in.ok());
  EXPECT_EQ(in.u8(), 0U) << "bytes are left, but the reader is bad";
  EXPECT_TRUE(in.bytes(1).empty());
  EXPECT_FALSE(in.atEnd());
}

TEST(Bytes, lengthNearTheLimitOfSizeDoesNotWrap) {
  const base::Bytes bytes{1, 2, 3};
  base::ByteReader in(bytes);
  in.u8();
  EXPECT_TRUE(in.bytes(static_cast<std::size_t>(-1)).empty());
  EXPECT_FALSE(in.ok());
}

TEST(Bytes, varintsHaveOneForm) {
  for (const std::uint64_t number : {std::uint64_t{0}, std::uint64_t{127}, std::uint64_t{128}, std::uint64_t{300},
                                     std::uint64_t{1} << 63, ~std::uint64_t{0}}) {
    base::ByteWriter out;
    out.varint(number);
    base::ByteReader in(out.view());
    EXPECT_EQ(in.varint(), number);
    EXPECT_TRUE(in.atEnd());
    base::ByteReader cut(base::ByteView(out.view()).first(out.size() - 1));
    cut.varint();
    EXPECT_FALSE(cut.ok()) << number;
  }
  const base::Bytes padded{0x80, 0x00};
  const base::Bytes too_large{0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x02};
  const base::Bytes endless(11, 0x80);
  for (const base::Bytes& bytes : {padded, too_large, endless}) {
    base::ByteReader in(bytes);
    in.varint();
    EXPECT_FALSE(in.ok());
  }
}

}  // namespace
