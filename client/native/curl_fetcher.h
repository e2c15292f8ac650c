#pragma once
// The native RangeFetcher uses libcurl on a thread of its own, with kept connections and verified TLS.
#include <condition_variable>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <unordered_set>
#include <vector>

#include "base/http/http.h"
#include "client/native/host_access.h"
#include "client/native/link.h"
#include "client/source/fetch.h"

namespace client {

class CurlFetcher final : public RangeFetcher {
 public:
  /// `place`: "http://host:port/folder" or "https://…", without a slash at its end.
  explicit CurlFetcher(const std::string& place, const LinkLimit& limit = {}, const HostAccess& access = {});
  ~CurlFetcher() override;
  void submit(std::uint64_t id, const std::string& name, std::uint64_t offset, std::uint64_t length) override {
    push({id, name, offset, length, false});
  }
  /// Requests a whole object of at most `max_bytes`; a longer one ends with kServer and "too long".
  void submitWhole(std::uint64_t id, const std::string& name, std::uint64_t max_bytes) {
    push({id, name, 0, max_bytes, true});
  }
  std::vector<FetchAnswer> takeAnswers() override;
  void cancel(std::uint64_t id) override;
  /// Waits until takeAnswers() would return something, at most `seconds`.
  void wait(double seconds);

 private:
  struct RangeOrder {
    std::uint64_t id = 0;
    std::string name;
    std::uint64_t offset = 0, length = 0;
    bool whole = false;  // then `length` is the limit
  };
  struct Transfer;
  struct Delivery {
    FetchAnswer answer;
    LinkClock::Clock::time_point due;
  };
  void push(RangeOrder order);

  // These run on the thread.
  void run();
  void startOrders();
  void start(RangeOrder order);
  void end(CURL* handle);
  void collect();
  void checkVersion(const Transfer& transfer, FetchAnswer& answer);

  const std::string place_;
  const HostAccess access_;
  const base::CurlMulti multi_ = base::makeCurlMulti();
  std::map<CURL*, std::unique_ptr<Transfer>> transfers_;
  std::vector<base::CurlHandle> idle_;
  std::map<std::string, std::string> versions_;  // object -> its ETag or date

  // These are shared by both threads, under the mutex.
  std::mutex mutex_;
  std::condition_variable arrived_;
  bool ending_ = false;
  std::deque<RangeOrder> orders_;
  std::unordered_set<std::uint64_t> cancelled_;
  std::deque<Delivery> done_;
  LinkClock link_clock_;

  std::thread thread_;
};

}  // namespace client
