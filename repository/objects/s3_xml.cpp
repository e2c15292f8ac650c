#include "repository/objects/s3_xml.h"

#include <cstdint>
#include <utility>

namespace repository {
namespace {

// The text between the next <name> and </name> behind `at`, which moves behind it. S3's elements never hold elements of
// their own name.
std::optional<std::string_view> nextElement(std::string_view xml, const std::string& name, std::size_t& at) {
  for (std::size_t open = at; (open = xml.find("<" + name, open)) != std::string_view::npos; ++open) {
    std::size_t begin = open + 1 + name.size();
    if (begin >= xml.size() || std::string_view(" \t\r\n/>").find(xml[begin]) == std::string_view::npos) continue;
    begin = xml.find('>', begin);
    if (begin == std::string_view::npos) return std::nullopt;
    if (xml[begin - 1] == '/') return at = begin + 1, std::string_view();
    const std::string close = "</" + name + ">";
    const std::size_t end = xml.find(close, ++begin);
    if (end == std::string_view::npos) return std::nullopt;
    at = end + close.size();
    return xml.substr(begin, end - begin);
  }
  return std::nullopt;
}

void appendUtf8(std::string& text, std::uint32_t code) {
  const auto byte = [&](std::uint32_t value) { text += static_cast<char>(value); };
  if (code < 0x80) return byte(code);
  if (code < 0x800) {
    byte(0xC0 | code >> 6);
  } else {
    if (code < 0x10000) {
      byte(0xE0 | code >> 12);
    } else {
      byte(0xF0 | code >> 18);
      byte(0x80 | (code >> 12 & 0x3F));
    }
    byte(0x80 | (code >> 6 & 0x3F));
  }
  byte(0x80 | (code & 0x3F));
}

// Reads "#38" or "#x26".
std::optional<std::uint32_t> numericEntity(std::string_view entity) {
  const bool is_hex = entity.size() > 1 && entity[1] == 'x';
  const std::string digits(entity.substr(is_hex ? 2 : 1));
  const char* const allowed = is_hex ? "0123456789abcdefABCDEF" : "0123456789";
  if (digits.empty() || digits.size() > 7 || digits.find_first_not_of(allowed) != std::string::npos)
    return std::nullopt;
  const auto code = static_cast<std::uint32_t>(std::stoul(digits, nullptr, is_hex ? 16 : 10));
  return code == 0 || code > 0x10FFFF ? std::nullopt : std::optional(code);
}

bool appendEntity(std::string& text, std::string_view entity) {
  constexpr std::pair<const char*, char> kNamed[] = {
      {"amp", '&'}, {"lt", '<'}, {"gt", '>'}, {"quot", '"'}, {"apos", '\''}};
  for (const auto& [name, character] : kNamed)
    if (entity == name) return text += character, true;
  if (entity.empty() || entity[0] != '#') return false;
  const auto code = numericEntity(entity);
  if (code) appendUtf8(text, *code);
  return code.has_value();
}

std::optional<std::string> resolved(std::string_view raw) {
  constexpr std::size_t kMaxEntityLength = 10;
  std::string text;
  for (std::size_t i = 0; i < raw.size(); ++i) {
    if (raw[i] != '&') {
      text += raw[i];
      continue;
    }
    const std::size_t length = raw.substr(i + 1, kMaxEntityLength).find(';');
    if (length == std::string_view::npos || !appendEntity(text, raw.substr(i + 1, length))) return std::nullopt;
    i += length + 1;
  }
  return text;
}

}  // namespace

std::optional<std::string> xmlText(std::string_view xml, const std::string& name) {
  std::size_t at = 0;
  const auto raw = nextElement(xml, name, at);
  return raw ? resolved(*raw) : std::nullopt;
}

base::Result<S3Page> parseS3Page(std::string_view xml) {
  const auto wrong = [](const std::string& problem) {
    return base::Error{base::ErrorCode::kNetwork,
                       "the store's list of objects " + problem + "; is this an S3 store (AWS_ENDPOINT_URL)?"};
  };
  std::size_t at = 0;
  const auto list = nextElement(xml, "ListBucketResult", at);
  if (!list) return wrong("is none");
  S3Page page;
  at = 0;
  while (const auto contents = nextElement(*list, "Contents", at)) {
    auto key = xmlText(*contents, "Key");
    if (!key) return wrong("has an object without a name");
    page.keys.push_back(std::move(*key));
  }
  if (xmlText(*list, "IsTruncated").value_or("false") != "true") return page;
  page.next_token = xmlText(*list, "NextContinuationToken").value_or("");
  if (page.next_token.empty()) return wrong("goes on, but does not say where");
  return page;
}

}  // namespace repository
