#include "client/source/fetch.h"

namespace client {
namespace {

constexpr int kTooManyRequests = 429;
constexpr int kFirstServerFault = 500;

std::string inBrackets(const FetchAnswer& answer) {
  std::string text = answer.status != 0 ? "status " + std::to_string(answer.status) : "";
  if (!answer.detail.empty()) text += (text.empty() ? "" : ", ") + answer.detail;
  return text.empty() ? "" : " (" + text + ")";
}

std::string fault(const FetchAnswer& answer) {
  switch (answer.outcome) {
    case FetchOutcome::kBytes:
      return "is there";
    case FetchOutcome::kNetwork:
      return "no answer" + inBrackets(answer) +
             "; check the network and the address. In a browser, a host that does not send "
             "Access-Control-Allow-Origin looks the same: docs/hosting.md has the headers";
    case FetchOutcome::kNotFound:
      return "is not there" + inBrackets(answer) +
             "; open the scene anew if it was published again, else publish all of it with `lumigrid publish`";
    case FetchOutcome::kForbidden:
      return "may not be read" + inBrackets(answer) + "; sign in, give a token, or let the host allow reading";
    case FetchOutcome::kRangeIgnored:
      return "this host ignores Range" + inBrackets(answer) +
             ", so a scene cannot be read piece by piece; switch ranges on there, or in the proxy before it "
             "(docs/hosting.md)";
    case FetchOutcome::kCompressed:
      return "the host compresses it" + inBrackets(answer) +
             "; switch that off for .lgp, .lgr, .lgq, .lgm, .lgi and .lgk files";
    case FetchOutcome::kChanged:
      return "changed while it was read; open the scene anew";
    case FetchOutcome::kTooShort:
      return "is shorter than it must be" + inBrackets(answer) + "; its upload was cut off, publish the scene again";
    case FetchOutcome::kServer:
      return "the host could not send it" + inBrackets(answer) + "; try again later";
  }
  return "failed";
}

}  // namespace

std::string describeFailure(const FetchAnswer& answer, const std::string& object) {
  return object + ": " + fault(answer);
}

bool isTransient(const FetchAnswer& answer) {
  return answer.outcome == FetchOutcome::kNetwork ||
         (answer.outcome == FetchOutcome::kServer &&
          (answer.status == kTooManyRequests || answer.status >= kFirstServerFault));
}

}  // namespace client
