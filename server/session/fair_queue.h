#pragma once
// Threads that work for many clients, none of whom can starve the others: the client that was given least time comes
// next, and its own jobs wait for each other.
#include <compare>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <set>
#include <thread>
#include <unordered_map>
#include <utility>
#include <vector>

namespace server {

/// Nothing here blocks but the end of the object. All calls are safe from any thread, from a job, too.
class FairQueue {
 public:
  using Job = std::function<void()>;

  /// `threads`: at least 1. `jobs_at_once`: of one client; others of its jobs wait, even if a thread is idle.
  explicit FairQueue(unsigned threads, unsigned jobs_at_once = 1);
  ~FairQueue() { stop(); }
  FairQueue(const FairQueue&) = delete;
  FairQueue& operator=(const FairQueue&) = delete;

  /// Adds a job behind the client's others. A client that had none for a while competes as if it had been given as much
  /// time as whoever was served last.
  void submit(std::uint64_t client, Job job);
  /// Drops the jobs that wait, and waits for those that run; not to be called from a job. Jobs that are submitted later
  /// are dropped, too.
  void stop();
  /// Drops the client's jobs that wait.
  void drop(std::uint64_t client);
  /// The same, and forgets the client, who would begin anew as one that was given nothing yet.
  void forget(std::uint64_t client);
  /// Jobs that no thread has begun.
  std::size_t waiting() const;
  /// Whether more clients wait for a thread than there are threads.
  bool isBehind() const;

 private:
  struct Client {
    std::deque<Job> jobs;
    unsigned running = 0;
    double used = 0.0;  // seconds of threads that it was given
    std::optional<std::uint64_t>
        turn;                   // its place in ready_ among those who were given as much; nothing: it is not there
    bool is_forgotten = false;  // goes when its last running job ends
  };
  /// The client that waits longest comes first of those who were given as much.
  struct Turn {
    double used;
    std::uint64_t number, client;
    friend auto operator<=>(const Turn&, const Turn&) = default;
  };

  void runThread();
  std::deque<Job> dropJobs(std::uint64_t number, Client& client);
  void setReady(std::uint64_t number, Client& client);
  void setUnready(std::uint64_t number, Client& client);
  void forgetIdleClients();
  void endJob(std::uint64_t number, double seconds);

  const unsigned jobs_at_once_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::unordered_map<std::uint64_t, Client> clients_;
  std::set<Turn> ready_;                             // clients that have a job to begin, the least served first
  static constexpr std::size_t kForgetAbove = 4096;  // 100 bytes each
  std::size_t forget_above_ = kForgetAbove;          // clients, from which on idle ones are forgotten
  std::uint64_t next_turn_ = 0;
  std::size_t waiting_ = 0;
  double served_ = 0.0;  // `used` of the client that was served last
  bool stopping_ = false;
  std::vector<std::jthread> threads_;
};

}  // namespace server
