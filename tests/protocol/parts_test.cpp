#include "protocol/parts.h"

#include <gtest/gtest.h>

#include <numeric>
#include <variant>

namespace protocol {
namespace {

base::Bytes counting(std::size_t size) {
  base::Bytes bytes(size);
  std::iota(bytes.begin(), bytes.end(), std::uint8_t{0});
  return bytes;
}

Part nextOf(PartSender& sender) {
  return std::get<Part>(*decodeServerMessage(sender.next(100)));
}

TEST(Parts, aMessageOfAnyLengthComesWhole) {
  for (const std::size_t size : {1U, 99U, 100U, 101U, 200U, 1234U}) {
    PartSender sender(Stream::kData);
    PartReceiver receiver;
    sender.begin(counting(size));
    std::size_t parts = 0;
    std::optional<base::Bytes> whole;
    for (; !sender.empty(); ++parts) {
      ASSERT_FALSE(whole) << "only the last part ends it";
      auto accepted = receiver.accept(nextOf(sender));
      ASSERT_TRUE(accepted);
      whole = *accepted;
    }
    EXPECT_EQ(parts, (size + 99) / 100);
    EXPECT_EQ(whole, counting(size));
  }
}

TEST(Parts, streamsAreApart) {
  PartSender data(Stream::kData), frames(Stream::kFrames);
  PartReceiver receiver;
  data.begin(counting(300));
  frames.begin(counting(150));
  EXPECT_FALSE(*receiver.accept(nextOf(data)));
  EXPECT_FALSE(*receiver.accept(nextOf(frames)));
  EXPECT_FALSE(*receiver.accept(nextOf(data)));
  EXPECT_EQ(**receiver.accept(nextOf(frames)), counting(150));
  EXPECT_EQ(**receiver.accept(nextOf(data)), counting(300));
}

TEST(Parts, aFirstPartGivesUpWhatWasBegun) {
  PartSender sender(Stream::kFrames);
  PartReceiver receiver;
  sender.begin(counting(300));
  ASSERT_TRUE(receiver.accept(nextOf(sender)));
  sender.giveUp();
  EXPECT_TRUE(sender.empty());
  sender.begin(counting(50));
  EXPECT_EQ(**receiver.accept(nextOf(sender)), counting(50));
}

TEST(Parts, partsWithoutAFirstOneAreRefused) {
  PartReceiver receiver;
  EXPECT_FALSE(receiver.accept({Stream::kData, false, true, {1}}));
  ASSERT_TRUE(receiver.accept({Stream::kData, true, false, {1}}));
  EXPECT_FALSE(receiver.accept({Stream::kFrames, false, false, {1}})) << "of another stream";
  EXPECT_TRUE(receiver.accept({Stream::kData, false, true, {2}}));
  EXPECT_FALSE(receiver.accept({Stream::kData, false, true, {3}})) << "after the last";
  ASSERT_TRUE(receiver.accept({Stream::kData, true, false, {1}}));
  receiver.clear();
  EXPECT_FALSE(receiver.accept({Stream::kData, false, true, {2}}));
}

TEST(Parts, togetherTheyAreNoLongerThanAMessage) {
  PartReceiver receiver;
  const base::Bytes half(kMaxServerMessage / 2, 7);
  ASSERT_TRUE(receiver.accept({Stream::kData, true, false, half}));
  ASSERT_TRUE(receiver.accept({Stream::kData, false, false, half}));
  EXPECT_FALSE(receiver.accept({Stream::kData, false, true, {1}}));
}

}  // namespace
}  // namespace protocol
