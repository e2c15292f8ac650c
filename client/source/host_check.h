#pragma once
// Whether a host can show published scenes: what its answers say, header by header, as a list that a page or a terminal
// prints. The platform asks; docs/hosting.md lists the same headers.
#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace client {

/// One answer, as far as the platform may see it.
struct HostAnswer {
  int status = 0;  ///< 0: none
  /// A browser's second try, without asking for the body (fetch mode "no-cors"), got through where the first failed.
  bool there_without_cors = false;
  std::uint64_t bytes = 0;                     ///< of its body; counting may stop above 16
  std::map<std::string, std::string> headers;  ///< names in lower case

  /// "" when absent or not to be seen.
  std::string header(const std::string& lower_case_name) const;
};

/// What was asked.
struct HostAnswers {
  bool in_browser = false;    ///< CORS counts for pages of another origin, and hides headers that are not exposed
  bool other_origin = false;  ///< of the page; natively: whether pages of others shall be able to read it
  HostAnswer scene;           ///< GET scene.json
  HostAnswer range;           ///< GET of an object with a hash in its name, Range: bytes=0-15
  HostAnswer next_range;      ///< the same, Range: bytes=16-31
  /// OPTIONS of that object as a browser asks before it sends Range to another host; pages cannot ask themselves.
  HostAnswer preflight;
};

struct HostFinding {
  enum class Grade : std::uint8_t {
    kGood,
    kSlow,
    kFails
  };  ///< kSlow: works, but costs requests, shows old versions,
      ///< or does not work everywhere
  Grade grade = Grade::kGood;
  std::string
      header;  ///< what it is about: a header's name, "Range" for the answer to it, or the object that is asked for
  std::string what;   ///< a sentence
  std::string todo;   ///< what to change; empty when good
  std::string nginx;  ///< the line of its configuration that mends it; empty when good, or when no line does
};

/// One for each header, in the order in which to mend them; those that cannot be judged from here are left out.
std::vector<HostFinding> judgeHost(const HostAnswers& answers);
/// "good", "could be better", "fails".
const char* nameOf(HostFinding::Grade grade);

}  // namespace client
