#include "server/auth/client_address.h"

#include <gtest/gtest.h>

namespace server {
namespace {

IpAddress addressOf(const std::string& text) {
  const auto address = parseIpAddress(text);
  EXPECT_TRUE(address.has_value()) << text;
  return address.value_or(IpAddress{});
}

TrustedProxies proxiesOf(const std::vector<std::string>& ranges) {
  auto proxies = TrustedProxies::parse(ranges);
  EXPECT_TRUE(bool(proxies)) << proxies.error().message;
  return *proxies;
}

TEST(IpAddress, isReadInAllItsForms) {
  EXPECT_EQ(addressOf("192.0.2.1").text(), "192.0.2.1");
  EXPECT_EQ(addressOf("[2001:DB8::1]").text(), "2001:db8::1");
  EXPECT_EQ(addressOf("::ffff:192.0.2.1"), addressOf("192.0.2.1"));
  for (const char* loopback : {"127.0.0.1", "127.9.8.7", "::1", "::ffff:127.0.0.1"})
    EXPECT_TRUE(addressOf(loopback).isLoopback()) << loopback;
  for (const char* other : {"128.0.0.1", "::2", "::", "0.0.0.0"}) EXPECT_FALSE(addressOf(other).isLoopback()) << other;
  for (const char* bad : {"", "192.0.2", "192.0.2.1:80", "192.0.2.256", "[192.0.2.1]", "[::1", "::1%lo", "host", "1"})
    EXPECT_FALSE(parseIpAddress(bad)) << bad;
}

TEST(LimitKey, countsANetworkOfIpv6AsOneClient) {
  EXPECT_EQ(limitKey("192.0.2.1"), "192.0.2.1");
  EXPECT_EQ(limitKey("192.0.2.2"), "192.0.2.2");
  EXPECT_EQ(limitKey("::ffff:192.0.2.1"), "192.0.2.1") << "by a socket for IPv6 and IPv4";
  EXPECT_EQ(limitKey("2001:db8:0:1::1"), "2001:db8:0:1::/64");
  EXPECT_EQ(limitKey("2001:DB8:0:1:ffff:ffff:ffff:ffff"), "2001:db8:0:1::/64") << "another address of that client";
  EXPECT_EQ(limitKey("2001:db8:0:2::1"), "2001:db8:0:2::/64");
  EXPECT_EQ(limitKey("::1"), "::/64");
  for (const char* other : {"", "unix", "unix:/run/lumigrid.sock", "192.0.2.1:80", "2001:db8::1%eth0"})
    EXPECT_EQ(limitKey(other), other);
}

TEST(TrustedProxies, rangesCoverWhatTheirBitsSay) {
  const TrustedProxies proxies = proxiesOf({"10.0.0.0/9", "192.0.2.1", "2001:db8::/33"});
  for (const char* in : {"10.127.255.255", "192.0.2.1", "::ffff:10.1.2.3", "2001:db8:7fff::1"})
    EXPECT_TRUE(proxies.contains(addressOf(in))) << in;
  for (const char* out : {"10.128.0.0", "192.0.2.2", "2001:db8:8000::", "::1"})
    EXPECT_FALSE(proxies.contains(addressOf(out))) << out;
  EXPECT_TRUE(proxiesOf({"0.0.0.0/0"}).contains(addressOf("8.8.8.8")));
  EXPECT_FALSE(proxiesOf({"0.0.0.0/0"}).contains(addressOf("2001:db8::1")));
  for (const char* bad : {"", "10.0.0.0/33", "::/129", "10.0.0.0/", "10.0.0.0/x", "localhost", "/8"}) {
    const auto parsed = TrustedProxies::parse({bad});
    ASSERT_FALSE(bool(parsed)) << bad;
    EXPECT_NE(parsed.error().message.find("--trusted-proxy"), std::string::npos);
  }
}

// client 203.0.113.9 -> proxies 10.0.0.2 -> 10.0.0.1 -> us
TEST(TrustedProxies, theRightmostUntrustedHopIsTheClient) {
  const TrustedProxies proxies = proxiesOf({"10.0.0.0/24"});
  const auto client = [&](const char* peer, const char* forwarded) {
    return proxies.clientAddress(addressOf(peer), forwarded).text();
  };
  EXPECT_EQ(client("10.0.0.1", "203.0.113.9, 10.0.0.2"), "203.0.113.9");
  EXPECT_EQ(client("10.0.0.1", "203.0.113.9"), "203.0.113.9");
  EXPECT_EQ(client("10.0.0.1", "198.51.100.7, 203.0.113.9, 10.0.0.2"), "203.0.113.9") << "the client's own word";
  EXPECT_EQ(client("203.0.113.9", "198.51.100.7"), "203.0.113.9") << "no proxy of ours";
  EXPECT_EQ(client("10.0.0.1", ""), "10.0.0.1");
  EXPECT_EQ(client("10.0.0.1", "10.0.0.3,10.0.0.2"), "10.0.0.3") << "a client in the proxies' own network";
  EXPECT_EQ(client("10.0.0.1", "203.0.113.9, unknown"), "10.0.0.1") << "no address";
  EXPECT_EQ(client("10.0.0.1", "203.0.113.9, <script>, 10.0.0.2"), "10.0.0.2");
  EXPECT_EQ(client("10.0.0.1", "203.0.113.9:4711"), "203.0.113.9");
  EXPECT_EQ(client("10.0.0.1", "[2001:db8::1]:4711"), "2001:db8::1");
  EXPECT_EQ(client("10.0.0.1", "2001:db8::1"), "2001:db8::1");
  EXPECT_EQ(client("::ffff:10.0.0.1", "203.0.113.9"), "203.0.113.9") << "a socket for IPv6 and IPv4";
}

TEST(TrustedProxies, onlyTheyTellOfTls) {
  const TrustedProxies proxies = proxiesOf({"10.0.0.1"});
  EXPECT_TRUE(proxies.cameByTls(addressOf("10.0.0.1"), "https"));
  EXPECT_FALSE(proxies.cameByTls(addressOf("10.0.0.1"), "http"));
  EXPECT_FALSE(proxies.cameByTls(addressOf("10.0.0.1"), "https, http"));
  EXPECT_FALSE(proxies.cameByTls(addressOf("10.0.0.2"), "https"));
}

}  // namespace
}  // namespace server
