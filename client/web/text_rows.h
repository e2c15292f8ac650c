#pragma once
// Writes tables for JavaScript as text: one line per row, fields separated by tabs. Tabs and line breaks within a field
// become blanks. Numbers are written so that they read back as the same double.
#include <string>
#include <string_view>
#include <utility>

namespace client {

class TextRows {
 public:
  TextRows& add(std::string_view text);
  TextRows& add(const char* text) { return add(std::string_view(text)); }
  TextRows& add(double number);
  TextRows& add(int number) { return add(static_cast<double>(number)); }
  TextRows& end();
  std::string takeText() { return std::move(text_); }

 private:
  void part();
  std::string text_;
  bool in_row_ = false;
};

}  // namespace client
