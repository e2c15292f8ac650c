#include "server/log/log_text.h"

#include <gtest/gtest.h>

#include <chrono>
#include <nlohmann/json.hpp>

namespace server {
namespace {

using std::chrono::milliseconds;

LogEntry entryOf(std::string text, LogLevel level = LogLevel::kInfo) {
  // 2026-11-26 19:06:23.042 UTC
  return {std::chrono::system_clock::time_point(milliseconds(1'795'719'983'042)), level, std::move(text)};
}

TEST(LogText, theTimeIsRfc3339InUtcWithMilliseconds) {
  EXPECT_EQ(formatTime(entryOf("").time), "2026-11-26T19:06:23.042Z");
  EXPECT_EQ(formatTime(std::chrono::system_clock::time_point(milliseconds(-1))), "1969-12-31T23:59:59.999Z");
}

TEST(LogText, controlCharactersAndInvalidBytesAreEscaped) {
  EXPECT_EQ(escapeControls("plain, gr\xC3\xBC\xC3\x9F, \xE2\x82\xAC"), "plain, gr\xC3\xBC\xC3\x9F, \xE2\x82\xAC");
  EXPECT_EQ(escapeControls("a\nb\r\x1B[31m\x7F"), "a\\x0ab\\x0d\\x1b[31m\\x7f");
  EXPECT_EQ(escapeControls(std::string("a\0b", 3)), "a\\x00b");
  EXPECT_EQ(escapeControls("\xC2\x9B"), "\\xc2\\x9b") << "C1: some terminals take it for ESC [";
  EXPECT_EQ(escapeControls("\xE2\x80\xAE"), "\\xe2\\x80\\xae") << "turns the direction of writing";
  EXPECT_EQ(escapeControls("\xE2\x80\xA8"), "\\xe2\\x80\\xa8") << "a line separator";
  EXPECT_EQ(escapeControls("\xFF\xC3(\xED\xA0\x80"), "\\xff\\xc3(\\xed\\xa0\\x80");
  EXPECT_EQ(escapeControls("cut \xE2\x82"), "cut \\xe2\\x82");
}

TEST(LogText, aQuotedValueCannotEndItself) {
  EXPECT_EQ(quoteText("x\" why=\"y"), "\"x\\\" why=\\\"y\"");
  EXPECT_EQ(quoteText("\\"), "\"\\\\\"");
  const LogMessage message = parseMessage("hello client=1 program=" + quoteText("a\" client=2 b=\"\\"));
  ASSERT_EQ(message.fields.size(), 2U);
  EXPECT_EQ(message.fields[1].name, "program");
  EXPECT_EQ(message.fields[1].value, "a\" client=2 b=\"\\");
}

TEST(LogText, fieldsAreParsedFromTheEndOfAMessage) {
  const LogMessage message = parseMessage("disconnect client=7 peer=127.0.0.1:80 why=\"the viewer left\"");
  EXPECT_EQ(message.words, "disconnect");
  ASSERT_EQ(message.fields.size(), 3U);
  EXPECT_EQ(message.fields[0].name, "client");
  EXPECT_EQ(message.fields[0].value, "7");
  EXPECT_EQ(message.fields[1].value, "127.0.0.1:80");
  EXPECT_TRUE(message.fields[2].is_quoted);
  EXPECT_EQ(message.fields[2].value, "the viewer left");
}

TEST(LogText, whatIsNotAllFieldsIsAllWords) {
  for (const char* text : {"see a=1 and b=2", "stopping: 3 connections are open", "x why=\"open", "x why=\"a\"b", "=",
                           "a =1", "", "A=1", "x a=1  b=2"}) {
    const LogMessage message = parseMessage(text);
    EXPECT_EQ(message.words, text);
    EXPECT_TRUE(message.fields.empty()) << text;
  }
  EXPECT_EQ(parseMessage("a=1").words, "");
  EXPECT_EQ(parseMessage("a=").fields.size(), 1U);
}

TEST(LogText, kindsAreTheWordsAtTheFront) {
  EXPECT_EQ(kindOfMessage("connect client=1"), "connect");
  EXPECT_EQ(kindOfMessage("turn away: 9 connections are open"), "turn away");
  EXPECT_EQ(kindOfMessage("image: /x/y cannot be read"), "image");
  EXPECT_EQ(kindOfMessage("all words"), "all words");
  EXPECT_EQ(kindOfMessage("9 lines"), "");
  EXPECT_EQ(kindOfMessage(""), "");
}

TEST(LogText, aTextLineIsOneLine) {
  EXPECT_EQ(formatTextLine(entryOf("a\nb", LogLevel::kWarning)), "2026-11-26T19:06:23.042Z warning a\\x0ab\n");
}

TEST(LogText, aJsonLineHasTheFieldsAsMembers) {
  const std::string line = formatJsonLine(entryOf(
      "disconnect client=7 seconds=1.5 peer=10.0.0.1:5 id=007 delta=-3 program=" + quoteText("7\"\x1B") + " message=x",
      LogLevel::kError));
  EXPECT_EQ(line.find('\n'), line.size() - 1);
  const auto json = nlohmann::json::parse(line, nullptr, false);
  ASSERT_TRUE(json.is_object()) << line;
  EXPECT_EQ(json["time"], "2026-11-26T19:06:23.042Z");
  EXPECT_EQ(json["level"], "error");
  EXPECT_EQ(json["message"], "disconnect");
  EXPECT_EQ(json["client"], 7);
  EXPECT_EQ(json["seconds"], 1.5);
  EXPECT_EQ(json["delta"], -3);
  EXPECT_EQ(json["peer"], "10.0.0.1:5");
  EXPECT_EQ(json["id"], "007") << "an identifier, no number";
  EXPECT_EQ(json["program"], "7\"\\x1b") << "what was quoted is text";
  EXPECT_EQ(json["message_"], "x") << "a field cannot take the place of the message";
}

TEST(LogText, longLinesAreClipped) {
  for (const std::string& text : {std::string(100'000, 'a'), std::string(5'000, '\x01'), std::string(3'000, '\x01')}) {
    const std::string line = formatTextLine(entryOf(text));
    EXPECT_LE(line.size(), kMaxLogLine);
    EXPECT_NE(line.find(" bytes"), std::string::npos);
    const std::string as_json = formatJsonLine(entryOf(text));
    EXPECT_LE(as_json.size(), kMaxLogLine);
    EXPECT_TRUE(nlohmann::json::accept(as_json));
  }
  std::string euros = "x";
  for (int i = 0; i < 3000; ++i) euros += "\xE2\x82\xAC";
  EXPECT_EQ(formatTextLine(entryOf(euros)).find("\\x"), std::string::npos) << "no character is cut in two";
}

}  // namespace
}  // namespace server
