// Judges a host's answers (client/source/host_check.h). This is a WebAssembly module of its own: it is fetched when
// somebody asks for the list (client/web/site/check.js).
#include <emscripten/emscripten.h>

#include <string>

#include "client/source/host_check.h"
#include "client/web/text_rows.h"

namespace {

client::HostAnswers answers;
std::string rows;

client::HostAnswer& answerNumber(int which) {
  return which == 0 ? answers.scene : which == 1 ? answers.range : answers.next_range;
}

}  // namespace

extern "C" {

/// Called before the first takeAnswer(). `other_origin`: the scene's host is not the page's.
EMSCRIPTEN_KEEPALIVE void beginCheck(int other_origin) {
  answers = {};
  answers.in_browser = true;
  answers.other_origin = other_origin != 0;
}

/// Takes an answer. `which`: 0 scene.json, 1 bytes 0-15, 2 bytes 16-31. takeHeader() adds its headers.
EMSCRIPTEN_KEEPALIVE void takeAnswer(int which, int status, int there_without_cors, double bytes) {
  client::HostAnswer& answer = answerNumber(which);
  answer.status = status;
  answer.there_without_cors = there_without_cors != 0;
  answer.bytes = static_cast<std::uint64_t>(bytes);
}

/// Adds a header; `name` is in lower case.
EMSCRIPTEN_KEEPALIVE void takeHeader(int which, const char* name, const char* value) {
  answerNumber(which).headers[name] = value;
}

/// Returns rows: grade (0 good, 1 could be better, 2 fails), its name, header, finding, what to change, line of nginx.
EMSCRIPTEN_KEEPALIVE const char* findings() {
  client::TextRows out;
  for (const client::HostFinding& one : client::judgeHost(answers))
    out.addRow(one.grade, client::nameOf(one.grade), one.header, one.message, one.todo, one.nginx);
  rows = out.takeText();
  return rows.c_str();
}

}  // extern "C"
