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

}  // namespace
