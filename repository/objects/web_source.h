#pragma once
// Reads objects from a server that answers HTTP range requests (RFC 9110, section 14).
#include <memory>
#include <string>
#include <vector>

#include "base/error.h"
#include "repository/objects/http_client.h"
#include "repository/objects/objects.h"

namespace repository {

/// Sends requests to one kind of server and explains its refusals. Safe from any thread.
class ObjectServer {
 public:
  virtual ~ObjectServer() = default;
  /// `headers` are "Name: value" lines; `max_body_bytes` is as in HttpRequest. Errors name the object.
  virtual base::Result<HttpResponse> request(const std::string& method, const std::string& name,
                                             const std::vector<std::string>& headers,
                                             std::uint64_t max_body_bytes) const = 0;
  /// The error for an answer that is none of 200, 206, 412 and 416.
  virtual base::Error refusal(const std::string& name, const HttpResponse& response) const = 0;
  /// Place and name of the object, for messages.
  virtual std::string describe(const std::string& name) const = 0;
};

/// Reads through `server`. The first answer about an object, or the last size() of it, fixes its version: its ETag or
/// else its Last-Modified time, and its size. A read that meets another version is an error, so bytes of two versions
/// are never mixed.
std::unique_ptr<ObjectSource> makeWebSource(const std::string& place, std::unique_ptr<ObjectServer> server);

/// The error for a status that means the same at every server: kNotFound, kIo (credentials), kUnsupported or kNetwork.
base::Error statusError(const std::string& object, int status);

/// `place` is "http://host/folder" or the same with https. Errors: kInvalidInput when it is no such address.
base::Result<std::unique_ptr<ObjectSource>> openHttpSource(const std::string& place, const HttpOptions& options);

}  // namespace repository
