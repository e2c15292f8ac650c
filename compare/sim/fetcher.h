#pragma once
// HTTP over a simulated link: reads ranges of objects over six connections, as browsers do with HTTP/1.1.
#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "client/source/fetch.h"
#include "compare/sim/link.h"

namespace compare {

/// Returns bytes offset … offset + length − 1 of an object on the host.
using ReadObject =
    std::function<base::Result<base::Bytes>(const std::string& name, std::uint64_t offset, std::uint64_t length)>;

class SimulatedFetcher final : public client::RangeFetcher {
 public:
  SimulatedFetcher(ReadObject read, const LinkProfile& link, std::uint32_t seed);

  /// Every call until the next happens at `now`, which never decreases.
  void advance(double now);
  /// Returns when advance() has something to do; kNever if only submit() changes anything.
  double nextEvent() const;
  std::uint64_t deliveredBytes() const { return delivered_; }
  std::uint64_t requests() const { return requests_; }

  void submit(std::uint64_t id, const std::string& name, std::uint64_t offset, std::uint64_t length) override;
  std::vector<client::FetchAnswer> takeAnswers() override;
  void cancel(std::uint64_t id) override;

 private:
  struct Request {
    std::uint64_t id = 0;
    std::string name;
    std::uint64_t offset = 0, length = 0;
    bool cancelled = false;
  };
  /// Carries one request at a time.
  struct Connection {
    Pipe up, down;
    std::optional<Request> request = {};
    double sends_at = kNever;  ///< the request waits for TCP's handshake until then
    bool open = false;
  };
  void start(Connection& connection);
  void act(Connection& connection);
  void answer(const Request& request);

  ReadObject read_;
  double round_trip_;
  double now_ = 0.0;
  std::deque<Request> waiting_;
  std::vector<Connection> connections_;
  std::vector<client::FetchAnswer> answers_;
  std::uint64_t delivered_ = 0, requests_ = 0;
};

}  // namespace compare
