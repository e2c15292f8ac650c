// libcurl is loaded when it is needed; where it cannot be, requests end in one line that says so.
#include "repository/objects/curl_library.h"

#include <gtest/gtest.h>

namespace {

using repository::loadCurl;

TEST(CurlLibrary, isLoadedOnceWithAllThatIsUsed) {
  const auto& library = repository::curlLibrary();
  ASSERT_TRUE(library) << library.error().message;
  EXPECT_EQ(&repository::curlLibrary(), &library);
  CURL* const handle = library->easy_init();
  ASSERT_NE(handle, nullptr);
  EXPECT_EQ(library->easy_setopt(handle, CURLOPT_NOSIGNAL, 1L), CURLE_OK);
  library->easy_cleanup(handle);
}

TEST(CurlLibrary, whatIsNotThereOrIsNoCurlIsNamed) {
  for (const char* name : {"libcurl-that-is-not-here.so.4", "libm.so.6"}) {
    const auto library = loadCurl(name);
    ASSERT_FALSE(library) << name;
    EXPECT_EQ(library.error().code, base::ErrorCode::kUnsupported);
    EXPECT_EQ(library.error().message.rfind(name, 0), 0U) << library.error().message;
    EXPECT_EQ(library.error().message.find('\n'), std::string::npos);
    EXPECT_NE(library.error().message.find("install it"), std::string::npos);
  }
}

}  // namespace
