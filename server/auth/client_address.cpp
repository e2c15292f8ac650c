#include "server/auth/client_address.h"

#include <arpa/inet.h>

#include <algorithm>

#include "base/number.h"
#include "base/text.h"

namespace server {
namespace {

constexpr std::array<std::uint8_t, 12> kV4Prefix{0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xFF, 0xFF};
constexpr int kV4PrefixBits = 96;
constexpr int kNetworkBytes = 8;  // of an IPv6 address; a machine chooses the others (RFC 4291, section 2.5.4)

/// An entry of X-Forwarded-For: an address, with a port at some proxies ("192.0.2.1:4711", "[2001:db8::1]:4711").
std::optional<IpAddress> parseForwarded(std::string_view text) {
  if (const auto address = parseIpAddress(text)) return address;
  const std::size_t colon = text.rfind(':');
  if (colon == std::string_view::npos || !base::parseDecimal(text.substr(colon + 1))) return std::nullopt;
  const std::string_view host = text.substr(0, colon);
  // Without brackets only IPv4 leaves its port tellable.
  if (!host.starts_with('[') && host.find(':') != std::string_view::npos) return std::nullopt;
  return parseIpAddress(host);
}

std::string lastValue(std::string_view& list) {
  const std::size_t comma = list.rfind(',');
  const std::string value = base::trimmed(comma == std::string_view::npos ? list : list.substr(comma + 1));
  list = comma == std::string_view::npos ? std::string_view() : list.substr(0, comma);
  return value;
}

}  // namespace

bool IpAddress::isV4() const {
  return std::equal(kV4Prefix.begin(), kV4Prefix.end(), bytes.begin());
}

bool IpAddress::isLoopback() const {
  return isV4() ? bytes[12] == 127 : *this == IpAddress{{0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1}};
}

std::string IpAddress::text() const {
  char text[INET6_ADDRSTRLEN] = "";
  if (isV4())
    ::inet_ntop(AF_INET, bytes.data() + kV4Prefix.size(), text, sizeof text);
  else
    ::inet_ntop(AF_INET6, bytes.data(), text, sizeof text);
  return text;
}

std::optional<IpAddress> parseIpAddress(std::string_view text) {
  if (text.size() >= 2 && text.front() == '[' && text.back() == ']') {
    text = text.substr(1, text.size() - 2);
    if (text.find(':') == std::string_view::npos) return std::nullopt;
  }
  const std::string copy(text);
  IpAddress address;
  if (::inet_pton(AF_INET6, copy.c_str(), address.bytes.data()) == 1) return address;
  std::copy(kV4Prefix.begin(), kV4Prefix.end(), address.bytes.begin());
  if (::inet_pton(AF_INET, copy.c_str(), address.bytes.data() + kV4Prefix.size()) == 1) return address;
  return std::nullopt;
}

std::string limitKey(const std::string& address) {
  auto parsed = parseIpAddress(address);
  if (!parsed) return address;
  if (parsed->isV4()) return parsed->text();
  std::fill(parsed->bytes.begin() + kNetworkBytes, parsed->bytes.end(), std::uint8_t{0});
  return parsed->text() + "/64";
}

base::Result<TrustedProxies> TrustedProxies::parse(const std::vector<std::string>& ranges) {
  TrustedProxies proxies;
  for (const std::string& text : ranges) {
    const std::size_t slash = text.find('/');
    const auto address = parseIpAddress(std::string_view(text).substr(0, slash));
    const std::uint64_t most = address && address->isV4() ? 32 : 128;
    const std::uint64_t bits = slash == std::string::npos
                                   ? most
                                   : base::parseDecimal(std::string_view(text).substr(slash + 1)).value_or(most + 1);
    if (!address || bits > most)
      return base::Error{base::ErrorCode::kInvalidInput,
                         "--trusted-proxy: '" + text + "' is no address like 192.0.2.1 or 10.0.0.0/8"};
    proxies.ranges_.push_back({*address, static_cast<int>(bits) + (address->isV4() ? kV4PrefixBits : 0)});
  }
  return proxies;
}

bool TrustedProxies::contains(const IpAddress& address) const {
  const auto covers = [&](const Range& range) {
    for (int bit = 0; bit < range.bits; ++bit) {
      const auto at = static_cast<std::size_t>(bit / 8);
      if ((((address.bytes[at] ^ range.address.bytes[at]) >> (7 - bit % 8)) & 1) != 0) return false;
    }
    return true;
  };
  return std::any_of(ranges_.begin(), ranges_.end(), covers);
}

IpAddress TrustedProxies::clientAddress(const IpAddress& peer, std::string_view forwarded_for) const {
  IpAddress client = peer;
  while (contains(client) && !forwarded_for.empty()) {
    const auto before = parseForwarded(lastValue(forwarded_for));
    if (!before) break;
    client = *before;
  }
  return client;
}

bool TrustedProxies::cameByTls(const IpAddress& peer, std::string_view forwarded_proto) const {
  return contains(peer) && lastValue(forwarded_proto) == "https";
}

}  // namespace server
