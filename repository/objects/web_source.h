#pragma once
// Objects behind a server that answers HTTP range requests (RFC 9110, section 14).
#include <memory>
#include <string>
#include <vector>

#include "base/error.h"
#include "repository/objects/http_client.h"
#include "repository/objects/objects.h"

namespace repository {

/// How one kind of server is asked, and what its refusals mean. From any thread.
class ObjectServer {
 public:
  virtual ~ObjectServer() = default;
  /// `headers`: "Name: value" lines. `most_bytes`: as in HttpRequest. Errors name the object.
  virtual base::Result<HttpResponse> ask(const std::string& method, const std::string& name,
                                         const std::vector<std::string>& headers, std::uint64_t most_bytes) const = 0;
  /// The error for an answer that is none of 200, 206, 412 and 416.
  virtual base::Error refusal(const std::string& name, const HttpResponse& response) const = 0;
  /// The object, for messages: place and name.
  virtual std::string describe(const std::string& name) const = 0;
};

/// Reads through `server`. The first answer about an object, or the last size() of it, tells its version (ETag, or else
/// the time of its change, and its size); a read that meets another version is an error, never a mix of two.
std::unique_ptr<ObjectSource> makeWebSource(const std::string& place, std::unique_ptr<ObjectServer> server);

/// What a status says that means the same at every server. kNotFound, kIo (credentials), kUnsupported, kNetwork.
base::Error statusError(const std::string& object, int status);

/// `place`: "http://host/folder" or https. Errors: kInvalidInput when it is no such address.
base::Result<std::unique_ptr<ObjectSource>> openHttpSource(const std::string& place, const HttpOptions& options);

}  // namespace repository
