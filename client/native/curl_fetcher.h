#pragma once
// The native RangeFetcher uses libcurl on a thread of its own, with kept connections and verified TLS.
#include <memory>
#include <string>

#include "client/native/link.h"
#include "client/source/fetch.h"

namespace client {

class CurlFetcher final : public RangeFetcher {
 public:
  /// `place`: "http://host:port/folder" or "https://…", without a slash at its end.
  explicit CurlFetcher(const std::string& place, const LinkLimit& limit = {});
  ~CurlFetcher() override;
  void submit(std::uint64_t id, const std::string& name, std::uint64_t offset, std::uint64_t length) override;
  /// Requests a whole object of at most `max_bytes`; a longer one ends with kServer and "too long".
  void submitWhole(std::uint64_t id, const std::string& name, std::uint64_t max_bytes);
  std::vector<FetchAnswer> takeAnswers() override;
  void cancel(std::uint64_t id) override;
  /// Waits until takeAnswers() would return something, at most `seconds`.
  void wait(double seconds);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace client
