#include "client/native/host_access.h"

#include <algorithm>
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
  const std::size_t scheme = url.find("://");
  std::string host = url.substr(scheme == std::string::npos ? 0 : scheme + 3);
  host = host.substr(0, host.find_first_of("/?#"));
  return !host.starts_with("localhost") && !host.starts_with("127.") && !host.starts_with("[::1]");
}

}  // namespace client
