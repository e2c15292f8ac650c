#include "repository/objects/curl_library.h"

#include <dlfcn.h>

namespace repository {
namespace {

// The name of its binary interface, the same since 2006 (curl's docs/libcurl/ABI.md).
constexpr const char* kLibrary = "libcurl.so.4";

template <class Function>
bool find(void* library, const char* name, Function& function) {
  function = reinterpret_cast<Function>(::dlsym(library, name));
  return function != nullptr;
}

}  // namespace

base::Result<CurlLibrary> loadCurl(const std::string& name) {
  const auto unusable = [&](const std::string& why) {
    return base::Error{base::ErrorCode::kUnsupported,
                       name + " cannot be loaded, which speaks to web servers and buckets (" + why + "); install it"};
  };
  void* const library = ::dlopen(name.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) {
    const char* const why = ::dlerror();
    return unusable(why != nullptr ? why : "no reason is given");
  }
  CurlLibrary curl;
  const bool whole =
      find(library, "curl_global_init", curl.global_init) && find(library, "curl_easy_init", curl.easy_init) &&
      find(library, "curl_easy_cleanup", curl.easy_cleanup) && find(library, "curl_easy_reset", curl.easy_reset) &&
      find(library, "curl_easy_setopt", curl.easy_setopt) && find(library, "curl_easy_getinfo", curl.easy_getinfo) &&
      find(library, "curl_easy_perform", curl.easy_perform) &&
      find(library, "curl_easy_strerror", curl.easy_strerror) &&
      find(library, "curl_slist_append", curl.slist_append) &&
      find(library, "curl_slist_free_all", curl.slist_free_all);
  if (!whole) return unusable("it lacks a function");
  if (curl.global_init(CURL_GLOBAL_DEFAULT) != CURLE_OK) return unusable("it does not start");
  return curl;
}

const base::Result<CurlLibrary>& curlLibrary() {
  static const base::Result<CurlLibrary> library = loadCurl(kLibrary);
  return library;
}

}  // namespace repository
