#include "server/net/unsent_pictures.h"

#include <algorithm>
#include <utility>

namespace server {

std::size_t UnsentPictures::countOf(const std::string& address) const {
  const auto it = of_.find(address);
  return it == of_.end() ? 0 : it->second.count;
}

void UnsentPictures::add(const std::string& address, std::size_t bytes) {
  OfAddress& of_address = of_[address];
  counted_ -= std::min(of_address.bytes, kShare);
  ++of_address.count;
  of_address.bytes += bytes;
  counted_ += std::min(of_address.bytes, kShare);
}

void UnsentPictures::remove(const std::string& address, std::size_t bytes) {
  const auto it = of_.find(address);
  OfAddress& of_address = it->second;
  counted_ -= std::min(of_address.bytes, kShare);
  of_address.bytes -= bytes;
  counted_ += std::min(of_address.bytes, kShare);
  if (--of_address.count == 0) of_.erase(it);
}

UnsentPicture::UnsentPicture(UnsentPictures& all, std::string address, std::size_t bytes)
    : all_(all), address_(std::move(address)), bytes_(bytes) {
  all_.add(address_, bytes_);
}

UnsentPicture::~UnsentPicture() {
  all_.remove(address_, bytes_);
}

}  // namespace server
