#include "server/session/fair_shares.h"

#include <algorithm>

namespace server {

double FairShares::usedBy(std::uint64_t client, const std::string& address) const {
  double used = served_;
  if (const auto it = clients_.find(client); it != clients_.end()) used = it->second;
  if (const auto it = addresses_.find(address); it != addresses_.end())
    used = std::max(used, it->second / kClientsOfAddress);
  return used;
}

void FairShares::charge(std::uint64_t client, const std::string& address, double amount) {
  served_ = std::max(served_, usedBy(client, address));
  if (addresses_.size() > forget_above_) {
    std::erase_if(addresses_, [this](const auto& one) { return one.second <= kClientsOfAddress * served_; });
    forget_above_ = std::max(kForgetAbove, 2 * addresses_.size());
  }
  // Nobody saves up while idle.
  double& of_client = clients_[client];
  of_client = std::max(of_client, served_) + amount;
  if (address.empty()) return;
  double& of_address = addresses_[address];
  of_address = std::max(of_address, kClientsOfAddress * served_) + amount;
}

}  // namespace server
