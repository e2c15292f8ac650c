#pragma once
// libcurl, loaded when the first request is sent: with what it needs itself it takes 6 ms to load, a tenth of the time
// in which a small mesh is built, and most runs speak to no server. Private to the HTTP client.
#include <curl/curl.h>

#include <string>

#include "base/error.h"

namespace repository {

/// The functions that are used, under their own names without "curl_".
struct CurlLibrary {
  decltype(&::curl_global_init) global_init = nullptr;
  decltype(&::curl_easy_init) easy_init = nullptr;
  decltype(&::curl_easy_cleanup) easy_cleanup = nullptr;
  decltype(&::curl_easy_reset) easy_reset = nullptr;
  decltype(&::curl_easy_setopt) easy_setopt = nullptr;
  decltype(&::curl_easy_getinfo) easy_getinfo = nullptr;
  decltype(&::curl_easy_perform) easy_perform = nullptr;
  decltype(&::curl_easy_strerror) easy_strerror = nullptr;
  decltype(&::curl_slist_append) slist_append = nullptr;
  decltype(&::curl_slist_free_all) slist_free_all = nullptr;
};

/// Loads it from the file `name`, as dlopen finds it, and starts it. It stays. kUnsupported where it is not there, or
/// lacks a function.
base::Result<CurlLibrary> loadCurl(const std::string& name);

/// The one of this process, loaded at the first call; from any thread.
const base::Result<CurlLibrary>& curlLibrary();

}  // namespace repository
