#pragma once
// The queue decides which byte ranges are requested next. It sends the most urgent wishes first, joins neighbours into
// one request, keeps only a few requests under way, and never requests the same range twice at a time. The caller
// states its current wishes again and again; a wish that it no longer names is forgotten unless its request is under
// way.
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "client/source/fetch.h"
#include "client/source/fetch_window.h"

namespace client {

/// The byte range that holds one item (a block, a table page, a face). Equal (kind, key) means equal ranges.
struct RangeWish {
  std::uint32_t kind = 0;  ///< chosen by the caller; kind and key together identify the item
  std::uint64_t key = 0;
  std::string object;
  std::uint64_t offset = 0, length = 1;
  bool alone = false;  ///< is requested alone, so that no neighbour delays it
  /// It is small and tells what else to ask for, as a page of a table does. Others under way do not hold it back.
  bool leads = false;
};

struct RangeArrival {
  RangeWish wish;
  FetchAnswer answer;  ///< cut down to the wish's own bytes
};

struct RangeQueueOptions {
  std::size_t max_requests = 6;          ///< under way at a time; 6 is what browsers allow for one host over HTTP/1.1
  std::uint64_t max_bytes = 128 * 1024;  ///< longest request that joins neighbours
  std::uint64_t max_gap =
      64;  ///< bytes read in vain between two neighbours; blocks are padded to 16, so 64 skips padding only
};

class RangeQueue {
 public:
  RangeQueue(RangeFetcher& fetcher, const RangeQueueOptions& options) : fetcher_(fetcher), options_(options) {}
  ~RangeQueue();
  RangeQueue(const RangeQueue&) = delete;
  RangeQueue& operator=(const RangeQueue&) = delete;

  /// Tells the time, in seconds from any zero. The queue learns from it how much to have under way (FetchWindow);
  /// without it that stays as at first.
  void setTime(double now) { now_ = now; }
  /// Sends requests for these wishes, most urgent first, until `limit` requests are under way (at most max_requests),
  /// or as many bytes as keep the link busy.
  void request(const std::vector<RangeWish>& wishes, std::size_t limit);
  void request(const std::vector<RangeWish>& wishes) { request(wishes, options_.max_requests); }
  /// Returns what has arrived since the last call, one entry for each wish.
  std::vector<RangeArrival> takeArrivals();
  bool underWay(std::uint32_t kind, std::uint64_t key) const { return under_way_.count({kind, key}) != 0; }
  /// Bytes a second that came at most lately, where times are told; 0 before any did.
  double rate() const { return window_.rate(); }
  /// As FetchWindow has it.
  double rateOnceBegun() const { return window_.rateOnceBegun(); }
  std::size_t requestsUnderWay() const { return requests_.size(); }
  std::uint64_t requestsSent() const { return sent_; }
  std::uint64_t bytesReceived() const { return bytes_; }  ///< bytes between neighbours included

 private:
  struct Request {
    std::uint64_t offset = 0, length = 0;
    FetchWindow::Mark sent;
    std::vector<RangeWish> wishes;  // all of them lead, or none
    bool leads() const { return wishes.front().leads; }
  };
  bool mayAsk(bool leads) const;
  std::vector<std::size_t> neighboursOf(const std::vector<RangeWish>& wishes, std::size_t first) const;
  void send(std::vector<RangeWish> wishes);

  RangeFetcher& fetcher_;
  RangeQueueOptions options_;
  std::map<std::uint64_t, Request> requests_;
  std::map<std::pair<std::uint32_t, std::uint64_t>, std::uint64_t> under_way_;  // wish -> id of its request
  std::uint64_t sent_ = 0, bytes_ = 0;
  FetchWindow window_;
  double now_ = 0.0;
};

}  // namespace client
