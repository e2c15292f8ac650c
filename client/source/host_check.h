#pragma once
// Judges whether a host can show published scenes: header by header, from its answers, as a list that a page or a
// terminal prints. The platform sends the requests; docs/hosting.md lists the same headers.
#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace client {

/// One HTTP answer, as far as the platform may see it.
struct HostAnswer {
  int status = 0;  ///< 0 when nobody answered
  /// The first try failed, and a browser's second one without reading the body (fetch mode "no-cors") succeeded.
  bool there_without_cors = false;
  std::uint64_t bytes = 0;                     ///< length of the body; counting may stop above 16
  std::map<std::string, std::string> headers;  ///< names in lower case

  /// The empty text when the header is absent or hidden from this page.
  std::string header(const std::string& lower_case_name) const;
};

/// The answers to the four requests that the check needs.
struct HostAnswers {
  bool in_browser = false;  ///< the browser applies CORS, and hides headers that are not exposed
  bool other_origin =
      false;  ///< the scene's origin is not the page's; natively: pages of other hosts shall be able to read the scene
  HostAnswer scene;       ///< GET scene.json
  HostAnswer range;       ///< GET of an object with a hash in its name, Range: bytes=0-15
  HostAnswer next_range;  ///< the same, Range: bytes=16-31
  /// OPTIONS for that object, as a browser sends it before a request with Range to another host. A page cannot send
  /// this itself.
  HostAnswer preflight;
};

struct HostFinding {
  enum class Grade : std::uint8_t {
    kGood,
    kSlow,   ///< works, but costs requests, shows old versions, or does not work everywhere
    kFails,  ///< scenes cannot be shown
  };
  Grade grade = Grade::kGood;
  std::string header;   ///< a header's name, "Range" for the answer to a range request, or the requested object
  std::string message;  ///< a sentence that says what was found
  std::string todo;     ///< what to change; empty when good
  std::string nginx;    ///< nginx's configuration line that repairs it; empty when good, or when no line does
};

/// Returns one finding for each header, in the order in which to repair them. Headers that cannot be judged from here
/// are left out.
std::vector<HostFinding> judgeHost(const HostAnswers& answers);
/// "good", "could be better", "fails".
const char* nameOf(HostFinding::Grade grade);

}  // namespace client
