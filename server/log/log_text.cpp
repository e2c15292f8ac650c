#include "server/log/log_text.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/number.h"
#include "base/text.h"

namespace server {
namespace {

constexpr std::size_t kMaxTries = 3;  // a clipped text still grows when its control characters are escaped

/// Whether a terminal or a viewer of logs would obey the character in place of showing it.
bool isObeyed(std::uint32_t character) {
  return character < 0x20 || (character >= 0x7F && character <= 0x9F) ||  // C0, DEL, C1
         character == 0x2028 || character == 0x2029 ||                    // separators of lines and paragraphs
         character == 0x200E || character == 0x200F || (character >= 0x202A && character <= 0x202E) ||  // bidi
         (character >= 0x2066 && character <= 0x2069);
}

void appendEscaped(std::string& out, std::string_view bytes) {
  constexpr std::string_view kDigits = "0123456789abcdef";
  for (const char c : bytes) {
    const auto byte = static_cast<unsigned char>(c);
    out += "\\x";
    out += kDigits[byte >> 4];
    out += kDigits[byte & 0xFU];
  }
}

/// `special`: characters that get a backslash.
std::string escape(std::string_view text, std::string_view special) {
  std::string out;
  out.reserve(text.size());
  while (!text.empty()) {
    const std::size_t length = base::utf8Length(text);
    const std::string_view bytes = text.substr(0, std::max<std::size_t>(length, 1));
    if (length == 0 || isObeyed(base::utf8Character(text, length))) {
      appendEscaped(out, bytes);
    } else {
      if (special.find(bytes) != std::string_view::npos) out += '\\';
      out += bytes;
    }
    text.remove_prefix(bytes.size());
  }
  return out;
}

bool isNameCharacter(char c) {
  return (c >= 'a' && c <= 'z') || c == '_';
}

/// The length of `name=` at the front; 0 where there is none.
std::size_t nameLength(std::string_view text) {
  const std::size_t end =
      static_cast<std::size_t>(std::find_if_not(text.begin(), text.end(), isNameCharacter) - text.begin());
  return end > 0 && end < text.size() && text[end] == '=' ? end + 1 : 0;
}

/// Takes a quoted value off the front of `text`; nothing where its end is missing.
std::optional<std::string> takeQuoted(std::string_view& text) {
  std::string value;
  for (std::size_t i = 1; i < text.size(); ++i) {
    if (text[i] == '"') {
      text.remove_prefix(i + 1);
      return value;
    }
    const bool is_escape = text[i] == '\\' && i + 1 < text.size() && (text[i + 1] == '"' || text[i + 1] == '\\');
    if (is_escape) ++i;
    value += text[i];
  }
  return std::nullopt;
}

/// All fields of a text that is nothing but fields; nothing otherwise.
std::optional<std::vector<LogField>> parseFields(std::string_view text) {
  std::vector<LogField> fields;
  while (!text.empty()) {
    const std::size_t name = nameLength(text);
    if (name == 0) return std::nullopt;
    LogField field{std::string(text.substr(0, name - 1)), "", false};
    text.remove_prefix(name);
    if (text.starts_with('"')) {
      auto value = takeQuoted(text);
      if (!value) return std::nullopt;
      field.value = std::move(*value);
      field.is_quoted = true;
    } else {
      const std::size_t end = std::min(text.find(' '), text.size());
      field.value = text.substr(0, end);
      text.remove_prefix(end);
    }
    fields.push_back(std::move(field));
    if (!text.empty() && text.front() != ' ') return std::nullopt;
    if (!text.empty()) text.remove_prefix(1);
  }
  return fields;
}

const char* nameOfLevel(LogLevel level) {
  switch (level) {
    case LogLevel::kInfo:
      return "info";
    case LogLevel::kWarning:
      return "warning";
    case LogLevel::kError:
      return "error";
  }
  return "";
}

/// Numbers as numbers: decimal ones without exponent or leading zeros, so that no identifier becomes one.
nlohmann::ordered_json valueOf(const LogField& field) {
  const std::string_view text = field.value;
  const std::size_t first = text.starts_with('-') ? 1 : 0;
  const bool is_plain = !text.empty() && text.find_first_not_of("0123456789.", first) == std::string_view::npos &&
                        !(text.size() > first + 1 && text[first] == '0' && text[first + 1] != '.');
  if (field.is_quoted || !is_plain) return field.value;
  if (const auto whole = base::parseDecimal(text)) return *whole;
  if (const auto number = base::parseNumber(text)) return *number;
  return field.value;
}

std::string textLineOf(const LogEntry& entry, std::string_view text) {
  return formatTime(entry.time) + ' ' + nameOfLevel(entry.level) + ' ' + escapeControls(text) + '\n';
}

std::string jsonLineOf(const LogEntry& entry, std::string_view text) {
  LogMessage message = parseMessage(escapeControls(text));
  nlohmann::ordered_json line{
      {"time", formatTime(entry.time)}, {"level", nameOfLevel(entry.level)}, {"message", std::move(message.words)}};
  for (LogField& field : message.fields) {
    while (line.contains(field.name)) field.name += '_';
    line[field.name] = valueOf(field);
  }
  return line.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + '\n';
}

/// Formats the longest beginning of the text that gives a line of at most kMaxLogLine bytes.
template <class Format>
std::string formatClipped(const LogEntry& entry, Format format) {
  if (entry.text.size() <= kMaxLogLine) {
    std::string line = format(entry, entry.text);
    if (line.size() <= kMaxLogLine) return line;
  }
  std::size_t kept = std::min(entry.text.size(), kMaxLogLine / 2);
  for (std::size_t i = 0; i < kMaxTries; ++i, kept /= 4) {
    // A sequence of UTF-8 that the end cuts in two would be shown as bytes.
    while (kept > 0 && (static_cast<unsigned char>(entry.text[kept]) & 0xC0U) == 0x80U) --kept;
    const std::string rest = " ... and " + std::to_string(entry.text.size() - kept) + " bytes more";
    std::string line = format(entry, entry.text.substr(0, kept) + rest);
    if (line.size() <= kMaxLogLine) return line;
  }
  return format(entry, "a message of " + std::to_string(entry.text.size()) + " bytes that is too long for a line");
}

}  // namespace

std::string quoteText(std::string_view text) {
  return '"' + escape(text, "\"\\") + '"';
}

std::string escapeControls(std::string_view text) {
  return escape(text, "");
}

std::string_view kindOfMessage(std::string_view text) {
  std::size_t end = 0;
  while (end < text.size()) {
    const std::string_view rest = text.substr(end);
    const std::size_t word = std::min(rest.find(' '), rest.size());
    const auto letters = static_cast<std::size_t>(
        std::find_if_not(rest.begin(), rest.begin() + static_cast<std::ptrdiff_t>(word), isNameCharacter) -
        rest.begin());
    if (letters < word) {
      if (letters > 0 && rest[letters] == ':') return text.substr(0, end + letters);
      break;
    }
    end += word + 1;
  }
  return text.substr(0, end > 0 ? std::min(end - 1, text.size()) : 0);
}

LogMessage parseMessage(std::string_view text) {
  // The fields begin at the first word that has the form of one.
  for (std::size_t at = 0; at < text.size();) {
    if (nameLength(text.substr(at)) > 0) {
      auto fields = parseFields(text.substr(at));
      if (!fields) break;
      return {std::string(text.substr(0, at > 0 ? at - 1 : 0)), std::move(*fields)};
    }
    const std::size_t space = text.find(' ', at);
    if (space == std::string_view::npos) break;
    at = space + 1;
  }
  return {std::string(text), {}};
}

std::string formatTime(std::chrono::system_clock::time_point time) {
  const auto since = std::chrono::floor<std::chrono::milliseconds>(time.time_since_epoch());
  const auto seconds = std::chrono::floor<std::chrono::seconds>(since);
  // A thread in gmtime_r() holds a lock of the C library, which a process that is forked meanwhile would never get.
  const auto day = std::chrono::floor<std::chrono::days>(seconds);
  const std::chrono::year_month_day date{std::chrono::sys_days(day)};
  const std::chrono::hh_mm_ss clock(seconds - day);
  std::array<char, 80> text{};
  std::snprintf(text.data(), text.size(), "%04d-%02u-%02uT%02d:%02d:%02d.%03dZ", static_cast<int>(date.year()),
                static_cast<unsigned>(date.month()), static_cast<unsigned>(date.day()),
                static_cast<int>(clock.hours().count()), static_cast<int>(clock.minutes().count()),
                static_cast<int>(clock.seconds().count()), static_cast<int>((since - seconds).count()));
  return text.data();
}

std::string formatTextLine(const LogEntry& entry) {
  return formatClipped(entry, textLineOf);
}

std::string formatJsonLine(const LogEntry& entry) {
  return formatClipped(entry, jsonLineOf);
}

}  // namespace server
