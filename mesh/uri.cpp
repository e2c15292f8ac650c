#include "mesh/uri.h"

#include <algorithm>
#include <array>
#include <filesystem>

namespace mesh {
namespace {

int hexDigit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  return c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

// Sequences that are no percent and two digits stay as they are.
std::string decodePercent(std::string_view text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const int high = text[i] == '%' && i + 2 < text.size() ? hexDigit(text[i + 1]) : -1;
    const int low = high >= 0 ? hexDigit(text[i + 2]) : -1;
    if (low >= 0) {
      out += static_cast<char>(16 * high + low);
      i += 2;
    } else {
      out += text[i];
    }
  }
  return out;
}

// Windows programs write backslashes.
std::string besideFile(const std::string& from, std::string name) {
  std::replace(name.begin(), name.end(), '\\', '/');
  const std::size_t slash = from.rfind('/');
  return name.empty() || name[0] == '/' || slash == std::string::npos ? name : from.substr(0, slash + 1) + name;
}

// The length of "https" in "https:..."; 0 where there is no scheme. One letter is a drive of Windows.
std::size_t schemeLength(std::string_view reference) {
  const std::size_t colon = reference.find(':');
  if (colon == std::string_view::npos || colon < 2) return 0;
  const auto fits = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '+' || c == '-' ||
           c == '.';
  };
  return std::all_of(reference.begin(), reference.begin() + static_cast<std::ptrdiff_t>(colon), fits) ? colon : 0;
}

constexpr std::array<std::int8_t, 256> kSixBits = [] {
  std::array<std::int8_t, 256> values{};
  values.fill(-1);
  constexpr std::string_view kAlphabet = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  for (std::size_t i = 0; i < kAlphabet.size(); ++i)
    values[static_cast<unsigned char>(kAlphabet[i])] = static_cast<std::int8_t>(i);
  return values;
}();

}  // namespace

bool isRemote(std::string_view reference) {
  return reference.substr(0, 2) == "//" ||
         (schemeLength(reference) > 0 && !isDataUri(reference) && reference.substr(0, 8) != "file:///");
}

std::string fileOfReference(const std::string& from, std::string_view reference) {
  constexpr std::string_view kFile = "file://";
  if (reference.substr(0, kFile.size() + 1) == "file:///") reference.remove_prefix(kFile.size());
  std::string decoded = besideFile(from, decodePercent(reference.substr(0, reference.find_first_of("?#"))));

  // Some programs write names as they are, also those with "%", "?" or "#".
  std::error_code ignored;
  if (decoded.size() != from.size() && !std::filesystem::exists(decoded, ignored)) {
    std::string literal = besideFile(from, std::string(reference));
    if (std::filesystem::exists(literal, ignored)) return literal;
  }
  return decoded;
}

std::string_view base64Of(std::string_view reference) {
  constexpr std::string_view kEncoding = ";base64";
  if (!isDataUri(reference)) return {};
  const std::size_t comma = reference.find(',');
  if (comma == std::string_view::npos) return {};
  const std::string_view media = reference.substr(0, comma);
  const bool base64 = media.size() >= kEncoding.size() && media.substr(media.size() - kEncoding.size()) == kEncoding;
  return base64 ? reference.substr(comma + 1) : std::string_view();
}

std::optional<base::Bytes> bytesOfDataUri(std::string_view reference) {
  const std::size_t comma = reference.find(',');
  if (!isDataUri(reference) || comma == std::string_view::npos) return std::nullopt;
  if (const std::string_view base64 = base64Of(reference); !base64.empty()) return bytesOfBase64(base64);
  const std::string decoded = decodePercent(reference.substr(comma + 1));
  return base::Bytes(decoded.begin(), decoded.end());
}

std::optional<base::Bytes> bytesOfBase64(std::string_view text) {
  while (!text.empty() && text.back() == '=') text.remove_suffix(1);
  base::Bytes bytes;
  bytes.reserve(text.size() / 4 * 3 + 2);
  std::uint32_t bits = 0;
  int count = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '\\' && i + 1 < text.size() && text[i + 1] == '/') continue;
    const std::int8_t six = kSixBits[static_cast<unsigned char>(text[i])];
    if (six < 0) return std::nullopt;
    bits = bits << 6 | static_cast<std::uint32_t>(six);
    count += 6;
    if (count < 8) continue;
    count -= 8;
    bytes.push_back(static_cast<std::uint8_t>(bits >> count));
  }
  return bytes;
}

}  // namespace mesh
