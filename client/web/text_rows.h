#pragma once
// What has many parts, on its way to JavaScript: rows of fields as text. A row is a line, fields are parted by tabs;
// tabs and line breaks in a field become blanks. Numbers are written so that they read back as the same double.
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
