#pragma once
// Threads that work for many clients, none of whom can starve the others: the client that was given least time comes
// next, and its own jobs wait for each other. Many clients of one address are served as a few would be.
//
// Clients may belong to groups, such as the viewers of one scene, whose jobs wait for the same disk. A job that goes on
// for long is taken for one that waits, and another thread works in its place: a disk that hangs keeps its own group
// alone.
#include <chrono>
#include <compare>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
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
  /// All clients of an address together are given at most the time of so many. A choice: an office behind one address
  /// has enough, and whoever opens hundreds of connections gains little.
  static constexpr unsigned kClientsOfAddress = 16;
  /// A job that has gone on for so long waits for something. A choice: a turn of a viewer takes some ten milliseconds,
  /// and on a machine with far too much to do some hundred.
  static constexpr std::chrono::milliseconds kStallTime{500};
  ~FairQueue() { stop(); }
  FairQueue(const FairQueue&) = delete;
  FairQueue& operator=(const FairQueue&) = delete;

  /// Adds a job behind the client's others. A client that had none for a while competes as if it had been given as much
  /// time as whoever was served last.
  void submit(std::uint64_t client, Job job);
  /// Counts the client among those of an address until it is forgotten. One without an address counts by itself.
  void setAddress(std::uint64_t client, const std::string& address);
  /// Counts the client among those of a group, until it is forgotten; to be called while it has no jobs. Clients are in
  /// group 0 before. As many jobs of a group run at once as there are threads, besides those of other groups once the
  /// former stall.
  void setGroup(std::uint64_t client, std::uint64_t group);
  /// Drops the jobs that wait, and waits for those that run; not to be called from a job. Jobs that are submitted later
  /// are dropped, too.
  void stop();
  /// Drops the client's jobs that wait.
  void drop(std::uint64_t client);
  /// The same, and forgets the client, who would begin anew as one that was given nothing yet.
  void forget(std::uint64_t client);
  /// Jobs that no thread has begun.
  std::size_t waiting() const;
  /// Whether more clients wait for a thread than there are threads. Groups that stall do not count.
  bool isBehind() const;
  /// Whether a job may do what is not needed yet: nobody waits for a thread, and where there are several, one has
  /// nothing to do besides that job's.
  bool hasFreeThread() const;

 private:
  /// The client that waits longest comes first of those who were given as much.
  struct Turn {
    double used;  // Client::used, or the share of it that its address was given, if that is more
    std::uint64_t number, client;
    friend auto operator<=>(const Turn&, const Turn&) = default;
  };
  struct Client {
    std::list<Job> jobs;
    unsigned running = 0;
    double used = 0.0;          // seconds of threads that it was given
    std::optional<Turn> turn;   // its place in ready_; nothing: it is not there
    bool is_forgotten = false;  // goes when its last running job ends
    std::string address;        // empty: none
    std::uint64_t group = 0;
  };
  struct Address {
    std::size_t clients = 0;
    double used = 0.0;  // seconds of threads that its clients were given
  };

  using Clock = std::chrono::steady_clock;
  struct Group {
    std::size_t clients = 0;  // of those that setGroup() put there
    std::set<Turn> ready;     // clients that have a job to begin, the least served first
    unsigned running = 0;     // jobs
    bool is_stalled = false;  // a job went on for kStallTime, and none has ended sooner since
  };
  struct Running {
    Clock::time_point start;
    std::uint64_t group;
    bool counts;  // among the jobs for which there are threads
  };

  void runThread();
  void startThread();
  std::size_t readyClients() const;
  std::optional<Turn> nextTurn() const;
  void waitForTurn(std::unique_lock<std::mutex>& lock);
  void replaceStalledJobs();
  void runJob(std::unique_lock<std::mutex>& lock, const Turn& turn);
  std::list<Job> dropJobs(Client& client);
  Address* addressOf(const Client& client);  ///< null: it has none
  void leaveAddress(const Client& client);
  void leaveGroup(std::uint64_t group);
  void eraseClient(std::uint64_t number);
  bool addJob(std::uint64_t client, Job job);
  bool setReady(std::uint64_t number, Client& client);
  void setUnready(Client& client);
  void forgetIdleClients();
  void endJob(std::uint64_t number, const Running& job, double worked);

  const unsigned jobs_at_once_, thread_count_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::unordered_map<std::uint64_t, Client> clients_;
  std::unordered_map<std::string, Address> addresses_;
  std::map<std::uint64_t, Group> groups_;
  std::list<Running> running_;                       // the oldest first
  unsigned counted_ = 0;                             // of them, those that count
  static constexpr std::size_t kForgetAbove = 4096;  // 100 bytes each
  std::size_t forget_above_ = kForgetAbove;          // clients, from which on idle ones are forgotten
  std::uint64_t next_turn_ = 0;
  std::size_t waiting_ = 0;
  double served_ = 0.0;      // Turn::used of the client that was served last
  bool is_watched_ = false;  // a thread waits for jobs that stall
  bool stopping_ = false;
  std::vector<std::jthread> threads_;
};

}  // namespace server
