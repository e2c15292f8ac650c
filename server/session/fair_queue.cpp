#include "server/session/fair_queue.h"

#include <algorithm>

#include "base/stopwatch.h"

namespace server {

FairQueue::FairQueue(unsigned threads, unsigned jobs_at_once) : jobs_at_once_(std::max(1U, jobs_at_once)) {
  for (unsigned i = 0; i < std::max(1U, threads); ++i) threads_.emplace_back([this] { runThread(); });
}

void FairQueue::stop() {
  std::vector<std::deque<Job>> dropped;  // they end after the lock, since a job's end may run other code
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    for (auto& [number, client] : clients_) {
      dropped.push_back(std::exchange(client.jobs, {}));
      setUnready(client);
    }
    waiting_ = 0;
  }
  changed_.notify_all();
  threads_.clear();
}

void FairQueue::submit(std::uint64_t client, Job job) {
  const std::lock_guard lock(mutex_);
  if (stopping_) return;
  if (clients_.size() > forget_above_) forgetIdleClients();
  Client& known = clients_[client];
  known.is_forgotten = false;
  // Nobody saves up time while idle.
  if (known.jobs.empty() && known.running == 0) known.used = std::max(known.used, served_);
  if (Address* const address = addressOf(known)) address->used = std::max(address->used, kClientsOfAddress * served_);
  known.jobs.push_back(std::move(job));
  ++waiting_;
  setReady(client, known);
}

void FairQueue::setAddress(std::uint64_t client, const std::string& address) {
  const std::lock_guard lock(mutex_);
  Client& known = clients_[client];
  leaveAddress(known);
  known.address = address;
  if (!address.empty()) ++addresses_[address].clients;
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
  std::deque<Job> dropped;  // ends after the lock, since a job's end may run other code
  const std::lock_guard lock(mutex_);
  if (const auto it = clients_.find(client); it != clients_.end()) dropped = dropJobs(it->second);
}

void FairQueue::forget(std::uint64_t client) {
  std::deque<Job> dropped;
  const std::lock_guard lock(mutex_);
  const auto it = clients_.find(client);
  if (it == clients_.end()) return;
  dropped = dropJobs(it->second);
  if (it->second.running == 0) {
    leaveAddress(it->second);
    clients_.erase(it);
  } else {
    it->second.is_forgotten = true;
  }
}

std::deque<FairQueue::Job> FairQueue::dropJobs(Client& client) {
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
  return ready_.size() > threads_.size();
}

void FairQueue::runThread() {
  std::unique_lock lock(mutex_);
  for (;;) {
    changed_.wait(lock, [this] { return stopping_ || !ready_.empty(); });
    if (stopping_) return;
    const auto [used, turn, number] = *ready_.begin();
    Client& client = clients_.at(number);
    setUnready(client);
    served_ = std::max(served_, used);
    Job job = std::move(client.jobs.front());
    client.jobs.pop_front();
    --waiting_;
    ++client.running;
    setReady(number, client);
    lock.unlock();
    const base::Stopwatch watch;
    job();
    job = nullptr;
    const double seconds = watch.seconds();
    lock.lock();
    endJob(number, seconds);
  }
}

void FairQueue::endJob(std::uint64_t number, double seconds) {
  Client& client = clients_.at(number);
  setUnready(client);
  --client.running;
  client.used += seconds;
  if (Address* const address = addressOf(client)) address->used += seconds;
  if (client.is_forgotten && client.running == 0) {
    leaveAddress(client);
    clients_.erase(number);
  } else {
    setReady(number, client);
  }
}

/// Puts the client into its place among those that can be served, if it has a job that may begin.
void FairQueue::setReady(std::uint64_t number, Client& client) {
  if (client.turn || client.jobs.empty() || client.running >= jobs_at_once_) return;
  double used = client.used;
  if (const Address* const address = addressOf(client)) used = std::max(used, address->used / kClientsOfAddress);
  client.turn = Turn{used, next_turn_++, number};
  ready_.insert(*client.turn);
  changed_.notify_one();
}

void FairQueue::setUnready(Client& client) {
  if (const auto turn = std::exchange(client.turn, std::nullopt)) ready_.erase(*turn);
}

/// Idle clients that were given no more than others start as unknown ones do.
void FairQueue::forgetIdleClients() {
  std::erase_if(clients_, [this](const auto& one) {
    const Client& client = one.second;
    return client.address.empty() && client.jobs.empty() && client.running == 0 && client.used <= served_;
  });
  forget_above_ = std::max(kForgetAbove, 2 * clients_.size());
}

}  // namespace server
