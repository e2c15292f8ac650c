#include "server/session/fair_queue.h"

#include <time.h>

#include <algorithm>
#include <system_error>

namespace server {
namespace {

/// Seconds of a processor that this thread was given.
double processorSeconds() {
  timespec time{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

}  // namespace

FairQueue::FairQueue(unsigned threads, unsigned jobs_at_once)
    : jobs_at_once_(std::max(1U, jobs_at_once)), thread_count_(std::max(1U, threads)) {
  groups_[0].clients = 1;  // the group of those that are in no other stays
  for (unsigned i = 0; i < thread_count_; ++i) threads_.emplace_back([this] { runThread(); });
}

void FairQueue::stop() {
  std::vector<std::list<Job>> dropped;  // they end after the lock, since a job's end may run other code
  std::vector<std::jthread> threads;
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    for (auto& [number, client] : clients_) {
      dropped.push_back(std::exchange(client.jobs, {}));
      setUnready(client);
    }
    waiting_ = 0;
    threads.swap(threads_);  // none is started from here on
  }
  changed_.notify_all();
  threads.clear();
}

void FairQueue::submit(std::uint64_t client, Job job) {
  // A thread that is woken before the lock is free would wait again at once.
  if (addJob(client, std::move(job))) changed_.notify_one();
}

/// Returns whether a thread is to be woken.
bool FairQueue::addJob(std::uint64_t client, Job job) {
  const std::lock_guard lock(mutex_);
  if (stopping_) return false;
  if (clients_.size() > forget_above_) forgetIdleClients();
  Client& known = clients_[client];
  known.is_forgotten = false;
  // Nobody saves up time while idle.
  if (known.jobs.empty() && known.running == 0) known.used = std::max(known.used, served_);
  if (Address* const address = addressOf(known)) address->used = std::max(address->used, kClientsOfAddress * served_);
  known.jobs.push_back(std::move(job));
  ++waiting_;
  return setReady(client, known);
}

void FairQueue::setAddress(std::uint64_t client, const std::string& address) {
  const std::lock_guard lock(mutex_);
  Client& known = clients_[client];
  if (known.address == address) return;
  leaveAddress(known);
  known.address = address;
  if (!address.empty()) ++addresses_[address].clients;
}

void FairQueue::setGroup(std::uint64_t client, std::uint64_t group) {
  const std::lock_guard lock(mutex_);
  Client& known = clients_[client];
  ++groups_[group].clients;
  if (known.group != 0) leaveGroup(known.group);
  known.group = group;
  if (threads_.size() == thread_count_) startThread();
}

void FairQueue::leaveGroup(std::uint64_t group) {
  const auto it = groups_.find(group);
  if (--it->second.clients == 0) groups_.erase(it);
}

/// None of its jobs runs.
void FairQueue::eraseClient(std::uint64_t number) {
  const auto it = clients_.find(number);
  leaveAddress(it->second);
  if (it->second.group != 0) leaveGroup(it->second.group);
  clients_.erase(it);
}

FairQueue::Address* FairQueue::addressOf(const Client& client) {
  const auto it = addresses_.find(client.address);
  return it != addresses_.end() ? &it->second : nullptr;
}

void FairQueue::leaveAddress(const Client& client) {
  Address* const address = addressOf(client);
  if (address != nullptr && --address->clients == 0) addresses_.erase(client.address);
}

void FairQueue::drop(std::uint64_t client) {
  std::list<Job> dropped;  // ends after the lock, since a job's end may run other code
  const std::lock_guard lock(mutex_);
  if (const auto it = clients_.find(client); it != clients_.end()) dropped = dropJobs(it->second);
}

void FairQueue::forget(std::uint64_t client) {
  std::list<Job> dropped;
  const std::lock_guard lock(mutex_);
  const auto it = clients_.find(client);
  if (it == clients_.end()) return;
  dropped = dropJobs(it->second);
  if (it->second.running == 0) {
    eraseClient(client);
  } else {
    it->second.is_forgotten = true;
  }
}

std::list<FairQueue::Job> FairQueue::dropJobs(Client& client) {
  waiting_ -= client.jobs.size();
  setUnready(client);
  return std::exchange(client.jobs, {});
}

std::size_t FairQueue::waiting() const {
  const std::lock_guard lock(mutex_);
  return waiting_;
}

bool FairQueue::isBehind() const {
  const std::lock_guard lock(mutex_);
  return readyClients() > thread_count_;
}

bool FairQueue::hasFreeThread() const {
  const std::lock_guard lock(mutex_);
  return readyClients() == 0 && counted_ < std::max(2U, thread_count_);
}

/// Clients that wait for a thread. The lock is held.
std::size_t FairQueue::readyClients() const {
  std::size_t ready = 0;
  for (const auto& [number, group] : groups_)
    if (!group.is_stalled) ready += group.ready.size();
  return ready;
}

// ---- The threads

void FairQueue::runThread() {
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    if (const auto turn = nextTurn())
      runJob(lock, *turn);
    else
      waitForTurn(lock);
  }
}

/// The lock is held. A thread that the system does not give is missed only while some group stalls.
void FairQueue::startThread() {
  if (stopping_) return;
  try {
    threads_.emplace_back([this] { runThread(); });
  } catch (const std::system_error&) {
  }
}

/// The turn that a thread may begin now: the first of those of the groups.
std::optional<FairQueue::Turn> FairQueue::nextTurn() const {
  std::optional<Turn> next;
  for (const auto& [number, group] : groups_) {
    const bool has_thread = group.is_stalled || counted_ < thread_count_;
    if (group.ready.empty() || group.running >= thread_count_ || !has_thread) continue;
    if (!next || *group.ready.begin() < *next) next = *group.ready.begin();
  }
  return next;
}

/// Jobs that count keep others waiting for kStallTime at most.
void FairQueue::waitForTurn(std::unique_lock<std::mutex>& lock) {
  const auto oldest = std::find_if(running_.begin(), running_.end(), [](const Running& job) { return job.counts; });
  if (waiting_ == 0 || oldest == running_.end() || counted_ < thread_count_) return changed_.wait(lock);
  is_watched_ = true;
  changed_.wait_until(lock, oldest->start + kStallTime);
  is_watched_ = false;
  replaceStalledJobs();
}

/// The threads of jobs that stall are lent to others, whose number stays as it is.
void FairQueue::replaceStalledJobs() {
  const Clock::time_point since = Clock::now() - kStallTime;
  for (Running& job : running_) {
    if (job.start > since) return;
    if (!std::exchange(job.counts, false)) continue;
    --counted_;
    groups_.at(job.group).is_stalled = true;
  }
}

void FairQueue::runJob(std::unique_lock<std::mutex>& lock, const Turn& turn) {
  Client& client = clients_.at(turn.client);
  Group& group = groups_.at(client.group);
  setUnready(client);
  served_ = std::max(served_, turn.used);
  Job job = std::move(client.jobs.front());
  client.jobs.pop_front();
  --waiting_;
  ++client.running;
  ++group.running;
  const auto running = running_.insert(running_.end(), {Clock::now(), client.group, !group.is_stalled});
  if (running->counts) ++counted_;
  if (setReady(turn.client, client)) changed_.notify_one();
  // Somebody is left to see whether this one stalls.
  if (threads_.size() == running_.size() && groups_.size() > 1) startThread();
  lock.unlock();
  const double before = processorSeconds();
  job();
  job = nullptr;
  const double worked = processorSeconds() - before;
  lock.lock();
  const Running ended = *running;
  running_.erase(running);
  endJob(turn.client, ended, worked);
}

/// A client is charged for the time that its job kept others waiting, and no more where it hung for hours.
void FairQueue::endJob(std::uint64_t number, const Running& job, double worked) {
  const double seconds = std::chrono::duration<double>(Clock::now() - job.start).count();
  const double stall_seconds = std::chrono::duration<double>(kStallTime).count();
  const double charged = std::min(seconds, std::max(worked, stall_seconds));
  Group& group = groups_.at(job.group);
  --group.running;
  if (job.counts) --counted_;
  if (seconds < stall_seconds) group.is_stalled = false;
  Client& client = clients_.at(number);
  setUnready(client);
  --client.running;
  client.used += charged;
  if (Address* const address = addressOf(client)) address->used += charged;
  if (client.is_forgotten && client.running == 0)
    eraseClient(number);
  else if (setReady(number, client))
    changed_.notify_one();
}

/// Puts the client into its place among those that can be served, if it has a job that may begin. Returns whether a
/// thread is to be woken.
bool FairQueue::setReady(std::uint64_t number, Client& client) {
  if (client.turn || client.jobs.empty() || client.running >= jobs_at_once_) return false;
  double used = client.used;
  if (const Address* const address = addressOf(client)) used = std::max(used, address->used / kClientsOfAddress);
  client.turn = Turn{used, next_turn_++, number};
  Group& group = groups_.at(client.group);
  group.ready.insert(*client.turn);
  // Where all threads are busy, one that ends its job looks by itself.
  return group.is_stalled || counted_ < thread_count_ || !is_watched_;
}

void FairQueue::setUnready(Client& client) {
  if (const auto turn = std::exchange(client.turn, std::nullopt)) groups_.at(client.group).ready.erase(*turn);
}

/// Idle clients that were given no more than others start as unknown ones do.
void FairQueue::forgetIdleClients() {
  std::erase_if(clients_, [this](const auto& one) {
    const Client& client = one.second;
    const bool is_known = !client.address.empty() || client.group != 0;
    return !is_known && client.jobs.empty() && client.running == 0 && client.used <= served_;
  });
  forget_above_ = std::max(kForgetAbove, 2 * clients_.size());
}

}  // namespace server
