#include "base/hash/sha256.h"

#include <gtest/gtest.h>

namespace {

// The examples stand in the appendix of FIPS 180-4.
TEST(Sha256, equalsTheStandardsExamples) {
  const base::Bytes abc{'a', 'b', 'c'};
  EXPECT_EQ(base::hexOf(base::sha256(abc)), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(base::hexOf(base::sha256({})), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
}

TEST(Sha256, piecesGiveTheDigestOfTheWhole) {
  const base::Bytes million(1000000, 'a');
  base::Sha256 hash;
  for (std::size_t at = 0; at < million.size(); at += 999) {
    const std::size_t left = million.size() - at;
    hash.add(base::ByteView(million).subspan(at, left < 999 ? left : 999));
  }
  EXPECT_EQ(base::hexOf(hash.finish()), "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

// RFC 4231, test cases 2 and 6 (a key that is longer than a block).
TEST(HmacSha256, equalsTheStandardsExamples) {
  EXPECT_EQ(base::hexOf(base::hmacSha256(base::viewOfText("Jefe"), "what do ya want for nothing?")),
            "5bdcc146bf60754e6a042426089575c75a003f089d2739839dec58b964ec3843");
  EXPECT_EQ(
      base::hexOf(base::hmacSha256(base::Bytes(131, 0xAA), "Test Using Larger Than Block-Size Key - Hash Key First")),
      "60e431591ee0b67f0d8a26aacbf5b77f8e0bc6213728c5140546040f0ee37f54");
}

TEST(Sha256, digestsAreEqualInAllBytesOnly) {
  const base::Sha256Digest digest = base::sha256(base::viewOfText("abc"));
  EXPECT_TRUE(base::areEqual(digest, base::sha256(base::viewOfText("abc"))));
  for (const std::size_t at : {std::size_t{0}, std::size_t{15}, std::size_t{31}}) {
    base::Sha256Digest other = digest;
    other[at] ^= 1;
    EXPECT_FALSE(base::areEqual(digest, other));
  }
}

}  // namespace
