// A spool file returns the appended bytes in their order.
#include "lod/ingest/spool.h"

#include <gtest/gtest.h>

#include "tests/support/temporary_directory.h"

namespace {

using namespace lod::ingest;

TEST(SpoolFile, keepsPiecesOfAnySizeInTheirOrder) {
  const support::TemporaryDirectory directory;
  auto file = SpoolFile::create(directory / "pieces");
  ASSERT_TRUE(file);
  // The sizes lie around the buffer's size of 1 MB and the eighth of it above which pieces are not copied.
  base::Bytes all;
  std::uint8_t mark = 0;
  for (const std::size_t size : {16, 600'000, 100'000, 530'000, 1, 2'000'000, 0, 500'000, 500'000, 500'000}) {
    const base::Bytes piece(size, ++mark);
    ASSERT_TRUE(file->append(piece));
    all.insert(all.end(), piece.begin(), piece.end());
    EXPECT_EQ(file->size(), all.size());
  }
  ASSERT_TRUE(file->flush());
  base::Bytes read(all.size());
  ASSERT_TRUE(file->readAt(0, read));
  EXPECT_TRUE(read == all);
}

}  // namespace
