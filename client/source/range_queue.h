#pragma once
// Which byte ranges are asked for next: the most urgent wishes first, neighbours in one request, a few requests under
// way, nothing twice. The caller says again and again what it wants now; what it no longer names is forgotten unless it
// is under way.
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "client/source/fetch.h"

namespace client {

/// A range that one value lies in. Equal names mean equal ranges.
struct RangeWish {
  std::uint32_t kind = 0;  ///< the caller's; with `key` its name
  std::uint64_t key = 0;
  std::string object;
  std::uint64_t offset = 0, length = 1;
  bool alone = false;  ///< never waits for neighbours in the same request
};

struct RangeArrival {
  RangeWish wish;
  FetchAnswer answer;  ///< its bytes are the wish's own
};

struct RangeQueueOptions {
  std::size_t max_requests = 6;          ///< under way; what browsers allow for one host over HTTP/1.1
  std::uint64_t max_bytes = 128 * 1024;  ///< of a request with neighbours in it
  std::uint64_t max_gap = 64;            ///< bytes between neighbours that are read in vain: blocks are padded to 16
};

class RangeQueue {
 public:
  RangeQueue(RangeFetcher& fetcher, const RangeQueueOptions& options) : fetcher_(fetcher), options_(options) {}
  ~RangeQueue();
  RangeQueue(const RangeQueue&) = delete;
  RangeQueue& operator=(const RangeQueue&) = delete;

  /// Sends what may be sent of these, most urgent first, until `limit` requests are under way (at most max_requests).
  void request(const std::vector<RangeWish>& wishes, std::size_t limit);
  void request(const std::vector<RangeWish>& wishes) { request(wishes, options_.max_requests); }
  /// What came, wish by wish.
  std::vector<RangeArrival> takeArrivals();
  bool underWay(std::uint32_t kind, std::uint64_t key) const { return under_way_.count({kind, key}) != 0; }
  std::size_t requestsUnderWay() const { return requests_.size(); }
  std::uint64_t requestsSent() const { return sent_; }
  std::uint64_t bytesReceived() const { return bytes_; }  ///< gaps included

 private:
  struct Request {
    std::uint64_t offset = 0;
    std::vector<RangeWish> wishes;
  };
  std::vector<std::size_t> neighboursOf(const std::vector<RangeWish>& wishes, std::size_t first) const;
  void send(std::vector<RangeWish> wishes);

  RangeFetcher& fetcher_;
  RangeQueueOptions options_;
  std::map<std::uint64_t, Request> requests_;
  std::map<std::pair<std::uint32_t, std::uint64_t>, std::uint64_t> under_way_;  // wish to request
  std::uint64_t sent_ = 0, bytes_ = 0;
};

}  // namespace client
