#pragma once
// Whether a host can show published scenes: what its answers say, as a list that a page or a terminal prints. The
// platform asks; docs/hosting.md lists the same headers.
#include <cstdint>
#include <string>
#include <vector>

namespace client {

/// One answer, as far as the platform may see it.
struct HostAnswer {
  int status = 0;  ///< 0: none
  /// A browser's second try, without asking for the body (fetch mode "no-cors"), got through where the first failed.
  bool there_without_cors = false;
  std::string content_range, content_encoding, cache_control, allow_origin;  ///< "": absent or not to be seen
  bool has_version = false;                                                  ///< ETag or Last-Modified
};

/// What was asked.
struct HostAnswers {
  bool in_browser = false;        ///< CORS counts for pages of another origin, and hides headers that are not exposed
  bool other_origin = false;      ///< of the page; natively: whether pages of others shall be able to read it
  HostAnswer scene;               ///< GET scene.json
  HostAnswer range;               ///< GET of an object with a hash in its name, Range: bytes=0-15
  std::uint64_t range_bytes = 0;  ///< of its body; counting may stop above 16
};

struct HostFinding {
  enum class Grade { kGood, kSlow, kFails };  ///< kSlow: works, but costs requests or shows old versions
  Grade grade = Grade::kGood;
  std::string what;  ///< a sentence
  std::string todo;  ///< what to change; empty when good
};

/// In the order in which to mend them.
std::vector<HostFinding> judgeHost(const HostAnswers& answers);

}  // namespace client
