#pragma once
// Writes tables for JavaScript as text: one line per row, fields separated by tabs. Tabs and line breaks within a field
// become blanks. Numbers are written so that they read back as the same double.
#include <glm/glm.hpp>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>

#include "base/format_text.h"

namespace client {

class TextRows {
 public:
  /// Adds a field: a text, a number (flags and enumerators are numbers, too), or the three numbers of a vector.
  TextRows& add(std::string_view text) {
    part();
    for (const char c : text) text_ += c == '\t' || c == '\n' || c == '\r' ? ' ' : c;
    return *this;
  }
  TextRows& add(const char* text) { return add(std::string_view(text)); }
  TextRows& add(double number) {
    part();
    text_ += base::formatText("%.17g", number);
    return *this;
  }
  template <class Number>
  requires(std::is_arithmetic_v<Number> || std::is_enum_v<Number>) TextRows& add(Number number) {
    return add(static_cast<double>(number));
  }
  TextRows& add(const glm::dvec3& v) { return add(v.x).add(v.y).add(v.z); }
  TextRows& end() {
    text_ += '\n';
    in_row_ = false;
    return *this;
  }
  template <class... Fields>
  TextRows& addRow(const Fields&... fields) {
    (add(fields), ...);
    return end();
  }
  std::string takeText() { return std::move(text_); }

 private:
  void part() {
    if (in_row_) text_ += '\t';
    in_row_ = true;
  }

  std::string text_;
  bool in_row_ = false;
};

}  // namespace client
