#pragma once
// The browser's range fetcher passes requests to the page's fetch() and gets bytes back (client/web/site/ranges.js).
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "client/source/fetch.h"
#include "client/web/only_one.h"

namespace client {

class WebFetcher final : public RangeFetcher, public OnlyOne<WebFetcher> {
 public:
  void submit(std::uint64_t id, const std::string& name, std::uint64_t offset, std::uint64_t length) override;
  std::vector<FetchAnswer> takeAnswers() override { return std::exchange(done_, {}); }
  void cancel(std::uint64_t id) override;

  // The page calls these with its answers.

  /// Returns room for the bytes of a finished request, valid until the next call of any of these.
  std::uint8_t* acceptBytes(std::uint64_t id, int status, std::size_t size);
  void acceptFailure(std::uint64_t id, FetchOutcome outcome, int status, const std::string& detail);

 private:
  std::vector<FetchAnswer> done_;
};

}  // namespace client
