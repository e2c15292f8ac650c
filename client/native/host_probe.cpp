#include "client/native/host_probe.h"

#include <memory>

#include "client/native/http_answer.h"
#include "client/native/published_scene.h"

namespace client {
namespace {

constexpr long kMostSeconds = 10;
constexpr std::size_t kMostSceneBytes = std::size_t{16} << 20;

struct Probe {
  HttpHead head;
  std::string body;
  std::size_t most = 0;
};

extern "C" std::size_t probeHeader(char* data, std::size_t size, std::size_t count, void* probe) {
  return static_cast<Probe*>(probe)->head.add({data, size * count}) ? size * count : 0;
}
extern "C" std::size_t probeBody(char* data, std::size_t size, std::size_t count, void* probe) {
  auto* p = static_cast<Probe*>(probe);
  p->body.append(data, size * count);
  return p->body.size() <= p->most ? size * count : 0;
}

struct CloseHandle {
  void operator()(CURL* handle) const { curl_easy_cleanup(handle); }
};

/// A body longer than `most` is broken off.
Probe ask(const std::string& url, const char* range, std::size_t most) {
  startCurlOnce();
  Probe probe;
  probe.most = most;
  const std::unique_ptr<CURL, CloseHandle> handle(curl_easy_init());
  setUpRequest(handle.get(), url);
  curl_easy_setopt(handle.get(), CURLOPT_TIMEOUT, kMostSeconds);
  curl_easy_setopt(handle.get(), CURLOPT_HEADERFUNCTION, probeHeader);
  curl_easy_setopt(handle.get(), CURLOPT_HEADERDATA, &probe);
  curl_easy_setopt(handle.get(), CURLOPT_WRITEFUNCTION, probeBody);
  curl_easy_setopt(handle.get(), CURLOPT_WRITEDATA, &probe);
  if (range != nullptr) curl_easy_setopt(handle.get(), CURLOPT_RANGE, range);
  // As a browser would: hosts send some headers to it alone.
  curl_slist* headers = curl_slist_append(nullptr, "Origin: https://lumigrid.invalid");
  if (range != nullptr) headers = curl_slist_append(headers, "Accept-Encoding: gzip, deflate, br");
  curl_easy_setopt(handle.get(), CURLOPT_HTTPHEADER, headers);
  static_cast<void>(curl_easy_perform(handle.get()));  // the status tells: 0 without an answer
  curl_slist_free_all(headers);
  return probe;
}

HostAnswer answerOf(const Probe& probe) {
  HostAnswer answer;
  answer.status = probe.head.status;
  answer.content_range = probe.head.header("content-range");
  answer.content_encoding = probe.head.header("content-encoding");
  answer.cache_control = probe.head.header("cache-control");
  answer.allow_origin = probe.head.header("access-control-allow-origin");
  answer.has_version = !probe.head.header("etag").empty() || !probe.head.header("last-modified").empty();
  return answer;
}

}  // namespace

base::Result<HostAnswers> askHost(const std::string& url) {
  const std::string place = placeOfScene(url);
  HostAnswers answers;
  answers.other_origin = true;
  const Probe json = ask(place + "/scene.json", nullptr, kMostSceneBytes);
  answers.scene = answerOf(json);
  if (answers.scene.status < 200 || answers.scene.status >= 300) return answers;
  const auto scene = staticSceneFrom(json.body, place);
  if (!scene) return scene.error();
  constexpr std::size_t kAsked = 16;
  const Probe range = ask(place + "/" + scene->patches.name, "0-15", kAsked);
  answers.range = answerOf(range);
  answers.range_bytes = range.body.size();
  return answers;
}

}  // namespace client
