#pragma once
// Shared by all users of libcurl: handles that free themselves, and the head of an answer, collected line by line.
#include <curl/curl.h>

#include <map>
#include <memory>
#include <string>
#include <string_view>

#include "base/bytes.h"

namespace base {

template <auto kFree>
struct FreeWith {
  template <class T>
  void operator()(T* one) const {
    kFree(one);
  }
};
using CurlHandle = std::unique_ptr<CURL, FreeWith<curl_easy_cleanup>>;
using CurlMulti = std::unique_ptr<CURLM, FreeWith<curl_multi_cleanup>>;
using CurlHeaders = std::unique_ptr<curl_slist, FreeWith<curl_slist_free_all>>;

/// Both start libcurl when it has not been started in this process. They fail only without memory, and stop then.
CurlHandle makeCurlHandle();
CurlMulti makeCurlMulti();
/// Appends "Name: value".
void appendHeader(CurlHeaders& headers, const std::string& line);

/// Status and headers of an answer. A redirect or a 100 Continue sends a head of its own before; the last one counts.
struct HttpHead {
  int status = 0;
  std::map<std::string, std::string> headers;  ///< names in lower case
  bool complete = false;                       ///< the empty line at its end has come
  bool too_long = false;                       ///< all heads together exceed 64 KiB

  /// Adds a status line or a header; returns false when there are too many.
  bool addLine(std::string_view line);
  /// The header's value; "" when it is absent.
  std::string header(const std::string& lower_case_name) const;

 private:
  std::size_t bytes_ = 0;
};

/// Has the answer handed to `sink`, which must outlive the transfer: sink.addHeader(std::string_view) gets each line of
/// the head, sink.addBody(ByteView) each piece of the body. They return false to end the transfer.
template <class Sink>
void receiveInto(Sink& sink, CURL* handle) {
  const curl_write_callback add_header = [](char* data, std::size_t size, std::size_t count, void* to) {
    return static_cast<Sink*>(to)->addHeader({data, size * count}) ? size * count : 0;
  };
  const curl_write_callback add_body = [](char* data, std::size_t size, std::size_t count, void* to) {
    const ByteView bytes(reinterpret_cast<const std::uint8_t*>(data), size * count);
    return static_cast<Sink*>(to)->addBody(bytes) ? bytes.size() : 0;
  };
  curl_easy_setopt(handle, CURLOPT_HEADERFUNCTION, add_header);
  curl_easy_setopt(handle, CURLOPT_HEADERDATA, &sink);
  curl_easy_setopt(handle, CURLOPT_WRITEFUNCTION, add_body);
  curl_easy_setopt(handle, CURLOPT_WRITEDATA, &sink);
}

}  // namespace base
