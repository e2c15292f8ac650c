#include "client/host_check.h"

namespace client {
namespace {

using Grade = HostFinding::Grade;

class Judge {
 public:
  explicit Judge(const HostAnswers& answers) : a_(answers) {}

  std::vector<HostFinding> all() {
    if (there(a_.scene, "scene.json") && there(a_.range, "The file of the hierarchy")) {
      ranges();
      compression();
      origins();
      caching();
    }
    return findings_;
  }

 private:
  void add(Grade grade, const std::string& what, const std::string& todo = "") {
    findings_.push_back({grade, what, grade == Grade::kGood ? "" : todo});
  }

  bool there(const HostAnswer& answer, const std::string& name) {
    if (answer.status == 0 && answer.there_without_cors) {
      add(Grade::kFails, name + " is there, but pages of this origin may not read it.",
          "Send Access-Control-Allow-Origin: * (or this page's origin) with every answer, and allow the header Range.");
      return false;
    }
    if (answer.status == 0) {
      add(Grade::kFails, "No answer about " + name + ".",
          a_.in_browser ? "Check address and network; a host that sends no Access-Control-Allow-Origin looks the same."
                        : "Check address and network.");
      return false;
    }
    if (answer.status >= 200 && answer.status < 300) return true;
    const std::string status = " (status " + std::to_string(answer.status) + ").";
    if (answer.status == 401 || answer.status == 403)
      add(Grade::kFails, name + " may not be read" + status, "Sign in, or let the host allow reading.");
    else if (answer.status == 404 || answer.status == 410)
      add(Grade::kFails, name + " is not there" + status,
          "Check the address; it is the folder that lumigrid publish wrote to. Publish again if files were lost.");
    else
      add(Grade::kFails, "The host could not send " + name + status, "Look into the host's log.");
    return false;
  }

  void ranges() {
    constexpr int kPartial = 206;
    if (a_.range.status != kPartial) {
      add(Grade::kFails,
          "Range requests are ignored: 16 bytes were asked for, the whole file is sent (status " +
              std::to_string(a_.range.status) + ").",
          "Switch ranges on at the host or in the proxy before it; a CDN must forward the header Range.");
      return;
    }
    if (a_.range_bytes != 16) {
      add(Grade::kFails, "Range requests bring another number of bytes than was asked for.",
          "A cache or proxy before the host is broken; forward the header Range.");
      return;
    }
    if (a_.range.content_range.rfind("bytes 0-15/", 0) == 0)
      return add(Grade::kGood, "Range requests bring the bytes that were asked for.");
    if (a_.range.content_range.empty() && a_.in_browser && a_.other_origin)
      return add(Grade::kSlow, "Content-Range is not to be seen by pages.",
                 "Send Access-Control-Expose-Headers: Content-Length, Content-Range, ETag.");
    add(Grade::kFails, "The answer to a Range request says another range than was asked for, or none.",
        "A cache or proxy before the host is broken; forward the header Range.");
  }

  void compression() {
    const std::string& encoding = a_.range.content_encoding;
    if (encoding.empty() || encoding == "identity") return;
    add(Grade::kFails, "Files are compressed on their way (Content-Encoding), such have no ranges.",
        "Switch compression off for .lgp, .lgi and .lgk files.");
  }

  void origins() {
    if (!a_.other_origin) return;
    if (a_.in_browser) return add(Grade::kGood, "Pages of this origin may read it (CORS).");
    if (a_.scene.allow_origin.empty() || a_.range.allow_origin.empty())
      return add(Grade::kSlow, "No Access-Control-Allow-Origin: only pages of the same host can show the scene.",
                 "Send Access-Control-Allow-Origin: * unless the page lies beside the scene.");
    add(Grade::kGood, "Pages of other origins may read it (CORS).");
  }

  void caching() {
    if (a_.scene.cache_control.find("immutable") != std::string::npos)
      add(Grade::kSlow, "scene.json is said never to change.", "Send Cache-Control: no-cache with scene.json.");
    // What is not exposed cannot be judged; Cache-Control always is.
    if (a_.range.cache_control.find("immutable") == std::string::npos)
      add(Grade::kSlow, "Files with a hash in their names are not said to be immutable.",
          "Send Cache-Control: public, max-age=31536000, immutable with them.");
    else
      add(Grade::kGood, "Caches may keep what never changes.");
    if (!a_.range.has_version && !(a_.in_browser && a_.other_origin))
      add(Grade::kSlow, "Neither ETag nor Last-Modified is sent: a changed file is not noticed.",
          "Let the host send ETag.");
  }

  const HostAnswers& a_;
  std::vector<HostFinding> findings_;
};

}  // namespace

std::vector<HostFinding> judgeHost(const HostAnswers& answers) {
  return Judge(answers).all();
}

}  // namespace client
