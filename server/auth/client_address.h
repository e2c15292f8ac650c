#pragma once
// Tells who asks behind proxies: X-Forwarded-For counts only as far as proxies that we trust wrote it.
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"

namespace server {

/// An IP address; IPv4 is kept as ::ffff:a.b.c.d (RFC 4291, section 2.5.5.2), so that both forms of one are equal.
struct IpAddress {
  std::array<std::uint8_t, 16> bytes{};

  bool isV4() const;
  bool isLoopback() const;  ///< 127.0.0.0/8 or ::1
  std::string text() const;
  friend bool operator==(const IpAddress&, const IpAddress&) = default;
};
/// Reads "192.0.2.1", "2001:db8::1" or "[2001:db8::1]"; nothing for any other text, a port behind it included.
std::optional<IpAddress> parseIpAddress(std::string_view text);

/// The name under which limits per client count an address: IPv4 in dotted form, whichever form it came in; of IPv6 the
/// first 64 bits ("2001:db8:0:1::/64"), since one client commonly has all addresses of such a network and could begin
/// anew with each. A text that is no address is its own key.
std::string limitKey(const std::string& address);

/// The proxies of `--trusted-proxy`.
class TrustedProxies {
 public:
  /// Reads "192.0.2.1" and "10.0.0.0/8"; errors name the text.
  static base::Result<TrustedProxies> parse(const std::vector<std::string>& ranges);

  bool contains(const IpAddress& address) const;
  /// The address that a request comes from. `peer` is the connection's other end; `forwarded_for` the values of
  /// X-Forwarded-For, joined with commas in their order. From the right, addresses of trusted proxies are passed over;
  /// the first other one is the client. A text that is no address ends the walk at the proxy that passed it on.
  IpAddress clientAddress(const IpAddress& peer, std::string_view forwarded_for) const;
  /// Whether the client spoke TLS, by X-Forwarded-Proto (its last value) of a trusted proxy.
  bool cameByTls(const IpAddress& peer, std::string_view forwarded_proto) const;

 private:
  struct Range {
    IpAddress address;
    int bits = 128;  ///< of the 16 bytes
  };
  std::vector<Range> ranges_;
};

}  // namespace server
