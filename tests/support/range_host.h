#pragma once
// A host of one file, for tests of clients that stream it, without a network; and a decoder for those that get no
// images.
#include <gtest/gtest.h>

#include <deque>
#include <string>
#include <utility>
#include <vector>

#include "client/source/fetch.h"
#include "client/viewer/decode.h"

namespace support {

class NoDecoder : public client::ImageDecoder {
 public:
  void submit(std::uint64_t, base::ByteView) override {}
  std::vector<DecodedImage> takeDecoded() override { return {}; }
  std::size_t pending() const override { return 0; }
};

/// Answers a fixed number of requests at each takeAnswers().
class RangeHost final : public client::RangeFetcher {
 public:
  RangeHost(std::string name, const base::Bytes& file) : name_(std::move(name)), file_(file) {}
  void submit(std::uint64_t id, const std::string& name, std::uint64_t offset, std::uint64_t length) override {
    EXPECT_EQ(name, name_);
    asked.push_back({id, offset, length});
  }
  std::vector<client::FetchAnswer> takeAnswers() override {
    std::vector<client::FetchAnswer> answers;
    for (std::size_t i = 0; i < at_a_time && !asked.empty(); ++i, asked.pop_front()) {
      const Range range = asked.front();
      client::FetchAnswer answer{range.id, outcome, {}, outcome == client::FetchOutcome::kBytes ? 206 : 0, ""};
      const auto begin = file_.begin() + static_cast<std::ptrdiff_t>(range.offset);
      if (outcome == client::FetchOutcome::kBytes)
        answer.bytes.assign(begin, begin + static_cast<std::ptrdiff_t>(range.length));
      answers.push_back(std::move(answer));
    }
    return answers;
  }
  void cancel(std::uint64_t) override {}

  struct Range {
    std::uint64_t id, offset, length;
  };
  std::deque<Range> asked;
  std::size_t at_a_time = 1;
  client::FetchOutcome outcome = client::FetchOutcome::kBytes;

 private:
  const std::string name_;
  const base::Bytes& file_;
};

}  // namespace support
