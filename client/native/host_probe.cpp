#include "client/native/host_probe.h"

#include "client/native/http_request.h"
#include "client/native/published_scene.h"

namespace client {
namespace {

constexpr std::size_t kMaxSceneBytes = std::size_t{16} << 20;

HostAnswer answerOf(const HttpResponse& reply) {
  HostAnswer answer;
  answer.status = reply.head.status;
  answer.bytes = reply.body.size() + (reply.too_long ? 1 : 0);
  answer.headers = reply.head.headers;
  return answer;
}

}  // namespace

base::Result<HostAnswers> askHost(const std::string& url, const HostAccess& access) {
  const std::string place = placeOfScene(url);
  HttpClient client(access);
  HostAnswers answers;
  answers.other_origin = true;

  // Send an Origin as a browser does, since hosts send some headers only then.
  HttpRequest request;
  request.headers = {"Origin: https://lumigrid.invalid"};
  request.url = place + "/scene.json";
  request.max_bytes = kMaxSceneBytes;
  const HttpResponse json = client.send(request);
  answers.scene = answerOf(json);
  if (answers.scene.status < 200 || answers.scene.status >= 300) return answers;
  LUMIGRID_ASSIGN_OR_RETURN(const auto parsed,
                            base::parseScene(std::string(json.body.begin(), json.body.end()), place + "/scene.json"));
  LUMIGRID_ASSIGN_OR_RETURN(const auto scene, staticSceneFrom(parsed, place));

  request.url = place + "/" + scene.patches.name;
  request.max_bytes = 16;
  request.headers.emplace_back("Accept-Encoding: gzip, deflate, br");
  request.range = "0-15";
  answers.range = answerOf(client.send(request));
  request.range = "16-31";
  answers.next_range = answerOf(client.send(request));

  request.method = "OPTIONS";
  request.range.clear();
  request.max_bytes = 64 * 1024;
  request.headers = {request.headers.front(), "Access-Control-Request-Method: GET",
                     "Access-Control-Request-Headers: range"};
  answers.preflight = answerOf(client.send(request));
  return answers;
}

}  // namespace client
