#include "client/native/host_probe.h"

#include "client/native/http_request.h"
#include "client/native/published_scene.h"

namespace client {
namespace {

constexpr std::size_t kMaxSceneBytes = std::size_t{16} << 20;

HostAnswer answerOf(const HttpReply& reply) {
  HostAnswer answer;
  answer.status = reply.head.status;
  answer.bytes = reply.body.size() + (reply.too_long ? 1 : 0);
  answer.headers = reply.head.headers;
  return answer;
}

}  // namespace

base::Result<HostAnswers> askHost(const std::string& url) {
  const std::string place = placeOfScene(url);
  HttpClient client;
  HostAnswers answers;
  answers.other_origin = true;

  // As a browser would: hosts send some headers to it alone.
  HttpQuestion question;
  question.headers = {"Origin: https://lumigrid.invalid"};
  question.url = place + "/scene.json";
  question.most_bytes = kMaxSceneBytes;
  const HttpReply json = client.ask(question);
  answers.scene = answerOf(json);
  if (answers.scene.status < 200 || answers.scene.status >= 300) return answers;
  LUMIGRID_ASSIGN_OR_RETURN(const auto scene, staticSceneFrom(std::string(json.body.begin(), json.body.end()), place));

  question.url = place + "/" + scene.patches.name;
  question.most_bytes = 16;
  question.headers.emplace_back("Accept-Encoding: gzip, deflate, br");
  question.range = "0-15";
  answers.range = answerOf(client.ask(question));
  question.range = "16-31";
  answers.again = answerOf(client.ask(question));

  question.method = "OPTIONS";
  question.range.clear();
  question.most_bytes = 64 * 1024;
  question.headers = {question.headers.front(), "Access-Control-Request-Method: GET",
                      "Access-Control-Request-Headers: range"};
  answers.preflight = answerOf(client.ask(question));
  return answers;
}

}  // namespace client
