#include "client/web/text_rows.h"

#include <cstdio>

namespace client {

void TextRows::part() {
  if (in_row_) text_ += '\t';
  in_row_ = true;
}

TextRows& TextRows::add(std::string_view text) {
  part();
  for (const char c : text) text_ += c == '\t' || c == '\n' || c == '\r' ? ' ' : c;
  return *this;
}

TextRows& TextRows::add(double number) {
  part();
  char text[32];
  std::snprintf(text, sizeof(text), "%.17g", number);
  text_ += text;
  return *this;
}

TextRows& TextRows::end() {
  text_ += '\n';
  in_row_ = false;
  return *this;
}

}  // namespace client
