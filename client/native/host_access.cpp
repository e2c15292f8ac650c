#include "client/native/host_access.h"

#include <arpa/inet.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <string_view>

#include "base/file.h"
#include "base/text.h"

namespace client {
namespace {

std::string_view takeUntil(std::string_view& rest, char separator) {
  const std::size_t end = rest.find(separator);
  const std::string_view piece = rest.substr(0, end);
  rest = end == std::string_view::npos ? std::string_view() : rest.substr(end + 1);
  return piece;
}

/// The host of a server's address in lower case, without port, brackets and last dot.
std::string hostOf(std::string_view url) {
  const std::size_t scheme = url.find("://");
  if (scheme != std::string_view::npos) url.remove_prefix(scheme + 3);
  url = url.substr(0, url.find_first_of("/?#"));
  if (url.starts_with('[')) return std::string(url.substr(1, std::min(url.find(']'), url.size()) - 1));
  std::string host(url.substr(0, url.find(':')));
  for (char& c : host)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  if (host.ends_with('.')) host.pop_back();
  return host;
}

/// Whether the host is this machine: 127.0.0.0/8, ::1, or a name that is kept for it (RFC 6761, section 6.3).
bool isThisMachine(const std::string& host) {
  if (host == "localhost" || host.ends_with(".localhost")) return true;
  std::array<std::uint8_t, 4> v4{};
  if (::inet_pton(AF_INET, host.c_str(), v4.data()) == 1) return v4[0] == 127;
  constexpr std::array<std::uint8_t, 16> kLoopback{0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1};
  std::array<std::uint8_t, 16> v6{};
  return ::inet_pton(AF_INET6, host.c_str(), v6.data()) == 1 && v6 == kLoopback;
}

}  // namespace

base::Result<std::string> readTokenFile(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(const base::Bytes bytes, base::readFile(path));
  std::string token = base::trimmed(base::textOf(bytes));
  if (token.empty() || token.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-._~") !=
                           std::string::npos)
    return base::Error{base::ErrorCode::kInvalidInput, path + ": is not one token and nothing else"};
  return token;
}

std::string takeCredential(std::string& url) {
  const std::size_t question = url.find('?');
  if (question == std::string::npos) return "";
  const std::size_t hash = std::min(url.find('#', question), url.size());
  std::string_view query = std::string_view(url).substr(question + 1, hash - question - 1);
  std::string token, expires, signature, rest;
  while (!query.empty()) {
    const std::string_view part = takeUntil(query, '&');
    std::string_view value = part;
    const std::string_view name = takeUntil(value, '=');
    if (name == "token") {
      token = value;
    } else if (name == "expires") {
      expires = value;
    } else if (name == "signature") {
      signature = value;
    } else {
      rest += (rest.empty() ? "" : "&") + std::string(part);
    }
  }
  if (token.empty() && signature.empty()) return "";
  url = url.substr(0, question) + (rest.empty() ? "" : "?" + rest) + url.substr(hash);
  return token.empty() ? expires + "." + signature : token;
}

bool wouldExposeToken(const std::string& url) {
  if (url.starts_with("wss://") || url.starts_with("https://")) return false;
  return !isThisMachine(hostOf(url));
}

}  // namespace client
