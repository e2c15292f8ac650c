#include "client/web/web_fetcher.h"

#include <emscripten/emscripten.h>

// Ids and offsets stay below 2^53, so doubles carry them exactly.
EM_JS(void, lumigridFetch, (double id, const char* name, double offset, double length),
      { Module.fetchRange(id, UTF8ToString(name), offset, length); });
EM_JS(void, lumigridCancel, (double id), { Module.cancelRange(id); });

namespace client {
namespace {

constexpr int kMaxOutcome = static_cast<int>(FetchOutcome::kServer);

}  // namespace

void WebFetcher::submit(std::uint64_t id, const std::string& name, std::uint64_t offset, std::uint64_t length) {
  lumigridFetch(static_cast<double>(id), name.c_str(), static_cast<double>(offset), static_cast<double>(length));
}

void WebFetcher::cancel(std::uint64_t id) {
  lumigridCancel(static_cast<double>(id));
  std::erase_if(done_, [id](const FetchAnswer& one) { return one.id == id; });
}

std::uint8_t* WebFetcher::acceptBytes(std::uint64_t id, int status, std::size_t size) {
  done_.push_back({id, FetchOutcome::kBytes, base::Bytes(size), status, ""});
  return done_.back().bytes.data();
}

void WebFetcher::acceptFailure(std::uint64_t id, FetchOutcome outcome, int status, const std::string& detail) {
  done_.push_back({id, outcome, {}, status, detail});
}

}  // namespace client

extern "C" {

EMSCRIPTEN_KEEPALIVE std::uint8_t* fetchedBytes(double id, int status, std::size_t size) {
  auto* fetcher = client::WebFetcher::instance();
  return fetcher == nullptr ? nullptr : fetcher->acceptBytes(static_cast<std::uint64_t>(id), status, size);
}

EMSCRIPTEN_KEEPALIVE void fetchFailed(double id, int outcome, int status, const char* detail) {
  auto* fetcher = client::WebFetcher::instance();
  if (fetcher == nullptr || outcome < 1 || outcome > client::kMaxOutcome) return;
  fetcher->acceptFailure(static_cast<std::uint64_t>(id), static_cast<client::FetchOutcome>(outcome), status, detail);
}

}  // extern "C"
