#include "server/cli/method_digest.h"

#include <gtest/gtest.h>

#include "base/bytes.h"
#include "base/file.h"
#include "tests/support/temporary_directory.h"

namespace server::cli {
namespace {

class MethodDigestTest : public testing::Test {
 protected:
  // Returns a header of 24 bytes (magic, version, length, a field, checksum) and 5 bytes of content.
  static base::Bytes file() {
    base::ByteWriter out;
    out.bytes(base::Bytes{'L', 'G', 'P', 'A', 'T', 'C', 'H', '\n'});
    for (const std::uint32_t field : {1U, 24U, 77U, 0xABCDEFU}) out.u32(field);
    out.bytes(base::Bytes{1, 2, 3, 4, 5});
    return out.takeBytes();
  }
  base::Result<std::string> digestOf(const base::Bytes& bytes) {
    EXPECT_TRUE(base::writeFileAtomically(directory_ / "file", bytes));
    return methodDigest(directory_ / "file");
  }
  const support::TemporaryDirectory directory_;
};

TEST_F(MethodDigestTest, versionAndHeadersChecksumDoNotCountAndAllElseDoes) {
  const auto whole = digestOf(file());
  ASSERT_TRUE(whole) << whole.error().message;
  EXPECT_EQ(whole->size(), 64U);
  for (std::size_t i = 0; i < file().size(); ++i) {
    if (i >= 12 && i < 16) continue;  // the length says where the checksum is
    base::Bytes changed = file();
    changed[i] ^= 1;
    const bool counts = !(i >= 8 && i < 12) && !(i >= 20 && i < 24);
    EXPECT_EQ(*digestOf(changed) != *whole, counts) << i;
  }
}

TEST_F(MethodDigestTest, aFileThatIsCutIsAnError) {
  for (std::size_t size = 0; size < 24; ++size) {
    base::Bytes cut = file();
    cut.resize(size);
    const auto digest = digestOf(cut);
    ASSERT_FALSE(digest) << size;
    EXPECT_EQ(digest.error().code, base::ErrorCode::kInvalidInput);
  }
}

}  // namespace
}  // namespace server::cli
