#pragma once
// Who comes next where something is dealt out piece by piece, such as the pixels that a renderer draws: whoever was
// given least so far. Many clients of one address are served as a few would be, as by FairQueue.
#include <cstddef>
#include <cstdint>
#include <string>
#include <unordered_map>

#include "server/session/fair_queue.h"

namespace server {

class FairShares {
 public:
  /// Amounts that a client was given, or the share of them that its address was, if that is more. Whoever has the
  /// smallest comes next. A client that is new, or was idle, has as much as the one that came last.
  /// `address`: empty for none.
  double usedBy(std::uint64_t client, const std::string& address) const;
  /// The client comes, and is given so much.
  void charge(std::uint64_t client, const std::string& address, double amount);
  /// The client has gone. Its address still has been given what it was.
  void forget(std::uint64_t client) { clients_.erase(client); }

 private:
  static constexpr std::size_t kForgetAbove = 4096;
  std::size_t forget_above_ = kForgetAbove;  // addresses, from which on those are forgotten that were given no more
  static constexpr double kClientsOfAddress = FairQueue::kClientsOfAddress;
  std::unordered_map<std::uint64_t, double> clients_;
  std::unordered_map<std::string, double> addresses_;
  double served_ = 0.0;  // usedBy() of the client that came last
};

}  // namespace server
