#include "server/net/http_text.h"

#include <algorithm>

#include "base/hash/sha256.h"
#include "base/number.h"

namespace server {
namespace {

constexpr std::size_t kMaxParameters = 32;  // /render, which knows most, knows 15
constexpr std::size_t kTagBytes = 16;       // bytes of the digest's 32; 128 bits never collide by chance
constexpr std::string_view kSpace = " \t";

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(kSpace);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kSpace) - first + 1);
}

/// Removes the text before `separator` from `rest`, and the separator, and returns the text; all of `rest` where there
/// is no separator.
std::string_view takeUntil(std::string_view& rest, char separator) {
  const std::size_t end = rest.find(separator);
  const std::string_view piece = rest.substr(0, end);
  rest = end == std::string_view::npos ? std::string_view() : rest.substr(end + 1);
  return piece;
}

bool sameIgnoringCase(std::string_view a, std::string_view b) {
  const auto lower = [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; };
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [&](char x, char y) { return lower(x) == lower(y); });
}

/// Whether the parameters behind a coding (";q=0.5") leave it a weight above 0. An absent weight counts as 1, a
/// malformed one as 0.
bool hasWeight(std::string_view parameters) {
  while (!parameters.empty()) {
    const std::string_view one = trimmed(takeUntil(parameters, ';'));
    if (one.size() < 2 || !sameIgnoringCase(one.substr(0, 2), "q=")) continue;
    const auto weight = base::parseNumber(one.substr(2));
    return weight && *weight > 0.0;
  }
  return true;
}

int hexDigit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

base::Error badQuery(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, "the query after '?' cannot be read: " + problem};
}

base::Result<std::string> percentDecoded(std::string_view text) {
  std::string decoded;
  for (std::size_t i = 0; i < text.size(); ++i) {
    char c = text[i] == '+' ? ' ' : text[i];
    if (c == '%') {
      const int high = i + 2 < text.size() ? hexDigit(text[i + 1]) : -1;
      const int low = i + 2 < text.size() ? hexDigit(text[i + 2]) : -1;
      if (high < 0 || low < 0) return badQuery("'%' without two hexadecimal digits behind it");
      c = static_cast<char>(high * 16 + low);
      i += 2;
    }
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F) return badQuery("it has a control character");
    decoded += c;
  }
  return decoded;
}

}  // namespace

bool acceptsCoding(std::string_view accept_encoding, std::string_view coding) {
  bool any = false;
  while (!accept_encoding.empty()) {
    std::string_view parameters = takeUntil(accept_encoding, ',');
    const std::string_view name = trimmed(takeUntil(parameters, ';'));
    if (sameIgnoringCase(name, coding)) return hasWeight(parameters);
    if (name == "*") any = hasWeight(parameters);
  }
  return any;
}

bool namesEntityTag(std::string_view if_none_match, std::string_view etag) {
  // Splitting at commas is safe: entityTag's tags hold none.
  while (!if_none_match.empty()) {
    std::string_view one = trimmed(takeUntil(if_none_match, ','));
    if (one == "*") return true;
    if (one.starts_with("W/")) one.remove_prefix(2);
    if (one == etag) return true;
  }
  return false;
}

bool isWebSocketKey(std::string_view key) {
  // 16 bytes are 22 characters and two of padding.
  constexpr std::size_t kCharacters = 22;
  constexpr const char* kAlphabet = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  return key.size() == kCharacters + 2 && key.substr(kCharacters) == "==" &&
         key.find_first_not_of(kAlphabet) == kCharacters;
}

std::string entityTag(base::ByteView bytes) {
  const base::Sha256Digest digest = base::sha256(bytes);
  return '"' + base::hexOf(base::ByteView(digest).first(kTagBytes)) + '"';
}

std::string closingAnswer(std::string_view status, std::string_view text) {
  return "HTTP/1.1 " + std::string(status) +
         "\r\nServer: lumigrid\r\nContent-Type: text/plain; charset=utf-8\r\nRetry-After: 5\r\nConnection: close\r\n"
         "Content-Length: " +
         std::to_string(text.size()) + "\r\n\r\n" + std::string(text);
}

base::Result<Query> parseQuery(std::string_view target) {
  Query query;
  takeUntil(target, '?');
  while (!target.empty()) {
    std::string_view value = takeUntil(target, '&');
    if (value.empty()) continue;
    const bool has_value = value.find('=') != std::string_view::npos;
    LUMIGRID_ASSIGN_OR_RETURN(auto name, percentDecoded(takeUntil(value, '=')));
    if (!has_value || name.empty()) return badQuery("a part is not of the form name=value");
    LUMIGRID_ASSIGN_OR_RETURN(auto decoded, percentDecoded(value));
    if (query.size() == kMaxParameters) return badQuery("more than " + std::to_string(kMaxParameters) + " values");
    if (!query.emplace(std::move(name), std::move(decoded)).second) return badQuery("a name stands there twice");
  }
  return query;
}

}  // namespace server
