#include "client/source/host_check.h"

#include <algorithm>
#include <cctype>

namespace client {
namespace {

using Grade = HostFinding::Grade;

constexpr int kOk = 200;
constexpr int kPartial = 206;
constexpr std::uint64_t kAsked =
    16;  // length of each requested range, bytes; client/web/site/check.js requests the same

// These lines stand in docs/hosting.md, section "nginx".
constexpr const char* kAllowOrigin = "add_header Access-Control-Allow-Origin \"*\" always;";
constexpr const char* kAllowHeaders = "add_header Access-Control-Allow-Headers \"Range, If-Range\" always;";
constexpr const char* kAnswerOptions = "if ($request_method = OPTIONS) { return 204; }";
constexpr const char* kExpose =
    "add_header Access-Control-Expose-Headers \"Content-Length, Content-Range, ETag\" always;";
constexpr const char* kRanges = "max_ranges 1;";
constexpr const char* kProxyRanges = "proxy_force_ranges on;";
constexpr const char* kNoCompression = "gzip off;";
constexpr const char* kVersions = "etag on;";
constexpr const char* kCaching = "add_header Cache-Control $lumigrid_cache;";

bool isSuccess(const HostAnswer& answer) {
  return answer.status >= kOk && answer.status < 300;
}

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return std::tolower(c); });
  return text;
}

bool holds(const std::string& list, const std::string& word) {
  return list == "*" || lower(list).find(word) != std::string::npos;
}

std::string statusOf(const HostAnswer& answer) {
  return " (status " + std::to_string(answer.status) + ")";
}

class Judge {
 public:
  explicit Judge(const HostAnswers& answers) : answers_(answers) {}

  std::vector<HostFinding> judge() {
    if (!there(answers_.scene, "scene.json") || !there(answers_.range, "The file of the hierarchy")) return findings_;
    range();
    if (answers_.range.status == kPartial) contentRange();
    acceptRanges();
    encoding();
    version();
    allowOrigin();
    exposeHeaders();
    preflight();
    caching();
    return findings_;
  }

 private:
  void good(const char* header, const std::string& message) {
    findings_.push_back({Grade::kGood, header, message, "", ""});
  }
  void bad(Grade grade, const char* header, const std::string& message, const std::string& todo,
           const std::string& nginx = "") {
    findings_.push_back({grade, header, message, todo, nginx});
  }
  /// A page sees few headers of another origin unless they are exposed.
  bool hides() const { return answers_.in_browser && answers_.other_origin; }

  bool there(const HostAnswer& answer, const char* name) {
    const std::string object = name;
    if (isSuccess(answer)) return true;
    if (answer.status == 0 && answer.there_without_cors) {
      bad(Grade::kFails, "Access-Control-Allow-Origin", object + " is there, but pages of this origin may not read it.",
          "Send it with every answer: * or this page's origin.", kAllowOrigin);
    } else if (answer.status == 0) {
      bad(Grade::kFails, name, "No answer.",
          answers_.in_browser
              ? "Check address and network; a host that sends no Access-Control-Allow-Origin looks the same."
              : "Check address and network.");
    } else if (answer.status == 401 || answer.status == 403) {
      bad(Grade::kFails, name, "May not be read" + statusOf(answer) + ".", "Sign in, or let the host allow reading.");
    } else if (answer.status == 404 || answer.status == 410) {
      bad(Grade::kFails, name, "Is not there" + statusOf(answer) + ".",
          "Check the address; it is the folder that lumigrid publish wrote to. Publish again if files were lost.");
    } else {
      bad(Grade::kFails, name, "The host could not send it" + statusOf(answer) + ".", "Look into the host's log.");
    }
    return false;
  }

  void range() {
    if (answers_.range.status == kPartial && answers_.range.bytes == kAsked)
      return good("Range", "Answered 206 with the bytes that were asked for.");
    if (answers_.range.status == kPartial)
      return bad(Grade::kFails, "Range", "Another number of bytes came than was asked for.",
                 "A cache or proxy before the host is broken; forward the header Range.", kProxyRanges);
    const bool compressed = !answers_.range.header("content-encoding").empty();
    bad(Grade::kFails, "Range",
        "Ignored: 16 bytes were asked for, the whole file is sent" + statusOf(answers_.range) +
            (compressed ? ", compressed." : "."),
        compressed ? "Compressed replies have no ranges: switch compression off for this file."
                   : "Switch ranges on at the host or in the proxy before it; a CDN must forward the header Range.",
        compressed ? kNoCompression : kRanges);
  }

  void contentRange() {
    const std::string said = answers_.range.header("content-range");
    if (said.rfind("bytes 0-15/", 0) == 0) return good("Content-Range", "Says which bytes came.");
    if (!said.empty())
      return bad(Grade::kFails, "Content-Range", "Says another range than was asked for.",
                 "A cache or proxy before the host is broken; forward the header Range.", kProxyRanges);
    if (hides()) return;  // exposeHeaders() reports it
    bad(Grade::kFails, "Content-Range", "Missing with an answer 206.", "A proxy before the host drops it; let it pass.",
        "proxy_pass_header Content-Range;");
  }

  void acceptRanges() {
    const std::string said = answers_.scene.header("accept-ranges");
    if (holds(said, "bytes")) return good("Accept-Ranges", "Ranges are offered.");
    if (hides() && said.empty()) return;
    bad(Grade::kSlow, "Accept-Ranges", "Missing: some caches and proxies then ask for whole files.",
        "Let the host send Accept-Ranges: bytes.", answers_.range.status == kPartial ? kProxyRanges : kRanges);
  }

  void encoding() {
    const std::string said = answers_.range.header("content-encoding");
    if (!said.empty() && said != "identity")
      return bad(Grade::kFails, "Content-Encoding",
                 "Files are compressed on their way (" + said + "), such have no ranges.",
                 "Switch compression off for .lgp, .lgr, .lgi and .lgk files.", kNoCompression);
    if (!hides()) good("Content-Encoding", "Files come as they are.");
  }

  void version() {
    const std::string first = answers_.range.header("etag");
    const std::string second = answers_.next_range.header("etag");
    if (isSuccess(answers_.next_range) && !first.empty() && first != second)
      return bad(Grade::kFails, "ETag", "Two answers about one file have different ones: viewers take it for changed.",
                 "Let all hosts behind one address have the same files with the same times.");
    if (first.rfind("W/", 0) == 0)
      return bad(Grade::kSlow, "ETag", "Is a weak one (W/), which ranges cannot be tied to.",
                 "Send the files as they are, not compressed or filtered.", kNoCompression);
    if (!first.empty()) return good("ETag", "A file that changes is noticed.");
    if (hides()) return;
    if (!answers_.range.header("last-modified").empty())
      return bad(Grade::kSlow, "ETag", "Missing; Last-Modified tells versions apart by the second alone.",
                 "Let the host send ETag.", kVersions);
    bad(Grade::kSlow, "ETag", "Missing, and Last-Modified too: a changed file is not noticed.",
        "Let the host send ETag.", kVersions);
  }

  void allowOrigin() {
    if (!answers_.other_origin) return;
    // Without the header a page could not have read the answers at all.
    const bool allowed = answers_.in_browser || (!answers_.scene.header("access-control-allow-origin").empty() &&
                                                 !answers_.range.header("access-control-allow-origin").empty());
    if (allowed) return good("Access-Control-Allow-Origin", "Pages of other hosts may read the scene.");
    bad(Grade::kSlow, "Access-Control-Allow-Origin", "Missing: only pages of the same host can show the scene.",
        "Send it with every answer, unless the page lies beside the scene.", kAllowOrigin);
  }

  void exposeHeaders() {
    if (!answers_.other_origin) return;
    const std::string said = answers_.range.header("access-control-expose-headers");
    const bool seen = answers_.in_browser
                          ? !answers_.range.header("content-range").empty() && !answers_.range.header("etag").empty()
                          : holds(said, "content-range") && holds(said, "etag");
    if (seen) return good("Access-Control-Expose-Headers", "Pages see Content-Range and ETag.");
    bad(Grade::kSlow, "Access-Control-Expose-Headers",
        "Content-Range or ETag is hidden from pages of other hosts: they cannot tell whether a file changed.",
        "Name Content-Length, Content-Range and ETag in it.", kExpose);
  }

  void preflight() {
    if (answers_.in_browser || !answers_.other_origin) return;
    const char* name = "Access-Control-Allow-Headers";
    if (!isSuccess(answers_.preflight))
      return bad(Grade::kSlow, name,
                 "OPTIONS is refused" + statusOf(answers_.preflight) + ": older browsers then send no Range.",
                 "Answer OPTIONS with 204.", kAnswerOptions);
    if (holds(answers_.preflight.header("access-control-allow-headers"), "range"))
      return good(name, "Pages of other hosts may send Range, in older browsers too.");
    bad(Grade::kSlow, name, "Missing, or without Range: pages of other hosts may not send it in older browsers.",
        "Name Range and If-Range in it.", kAllowHeaders);
  }

  // Browsers show Cache-Control to pages even without Access-Control-Expose-Headers.
  void caching() {
    const char* name = "Cache-Control";
    const bool root_kept = holds(answers_.scene.header("cache-control"), "immutable");
    const bool rest_kept = holds(answers_.range.header("cache-control"), "immutable");
    if (root_kept)
      bad(Grade::kSlow, name, "scene.json is said never to change.", "Send no-cache with scene.json.", kCaching);
    if (!rest_kept)
      bad(Grade::kSlow, name, "Files with a hash in their names are not said to be immutable.",
          "Send public, max-age=31536000, immutable with them.", kCaching);
    if (!root_kept && rest_kept) good(name, "Caches may keep what never changes, and ask anew for what may.");
  }

  const HostAnswers& answers_;
  std::vector<HostFinding> findings_;
};

}  // namespace

std::string HostAnswer::header(const std::string& lower_case_name) const {
  const auto found = headers.find(lower_case_name);
  return found == headers.end() ? "" : found->second;
}

std::vector<HostFinding> judgeHost(const HostAnswers& answers) {
  return Judge(answers).judge();
}

const char* nameOf(HostFinding::Grade grade) {
  return grade == Grade::kGood ? "good" : grade == Grade::kSlow ? "could be better" : "fails";
}

}  // namespace client
