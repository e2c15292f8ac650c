#pragma once
// The text of log lines. Clients choose what some of it says (their names, their addresses), so nothing that a terminal
// or a reader of fields would obey gets through (docs/formats/log.md).
#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace server {

enum class LogLevel { kInfo, kWarning, kError };

struct LogEntry {
  std::chrono::system_clock::time_point time;
  LogLevel level = LogLevel::kInfo;
  std::string text;
};

/// The value of a field, as a message has it: in quotation marks, with a backslash before those and backslashes inside,
/// and escapeControls() for the rest.
std::string quoteText(std::string_view text);

/// The text as valid UTF-8 on one line: "\x1b" for each byte of a control character, of a line or paragraph separator,
/// of a character that turns the direction of writing, and of what is no UTF-8.
std::string escapeControls(std::string_view text);

/// The kind of a message, which its limit of lines a second goes by: the words of lower-case letters that it begins
/// with, up to a ':' or a field. "turn away" of "turn away: 9 are open"; may be empty.
std::string_view kindOfMessage(std::string_view text);

struct LogField {
  std::string name, value;
  bool is_quoted = false;
};
struct LogMessage {
  std::string words;
  std::vector<LogField> fields;
};
/// Takes a message apart: 'connect client=7 why="the viewer left"'. A text that does not end in fields, without
/// anything between and behind them, is all words.
LogMessage parseMessage(std::string_view text);

/// "2026-11-26T19:06:23.042Z": RFC 3339, UTC, milliseconds.
std::string formatTime(std::chrono::system_clock::time_point time);

/// Bytes of the longest line, with its end. POSIX promises at least 512 for PIPE_BUF and Linux has 4096: writes of so
/// many bytes to a pipe are never mixed with another process's.
inline constexpr std::size_t kMaxLogLine = 4096;

/// One line with its end: the time, the level and the message; or the same as a JSON object, with the message's fields
/// as members, numbers as numbers. A longer one than kMaxLogLine ends with how many bytes of the message it lacks.
std::string formatTextLine(const LogEntry& entry);
std::string formatJsonLine(const LogEntry& entry);

}  // namespace server
