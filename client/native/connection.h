#pragma once
// The WebSocket to the server runs on a thread of its own: messages and events go into a queue that the render loop
// empties between frames (Okamoto 2011, figure 6: "COM threads"). Nothing here makes the render loop wait.
#include <memory>
#include <string>

#include "base/error.h"
#include "client/native/host_access.h"
#include "client/native/link.h"

namespace client {

struct ServerUrl {
  std::string host;  ///< name or address; an IPv6 address without its brackets
  std::string port = "8080";
  std::string target = "/";       ///< path and query
  bool is_secure = false;         ///< wss or https
  std::string folder;             ///< the text as given, where it may have been meant as a folder: it has no scheme
  std::string authority() const;  ///< host:port as in a Host header
  /// "http://host:port" or "https://host:port", where the server answers requests.
  std::string httpPlace() const { return (is_secure ? "https://" : "http://") + authority(); }
};

/// "ws://host:port/path", "http://…", or "host:port" alone; "wss://host/path" or "https://…", whose port is 443 unless
/// it is given. Errors say what is wrong.
base::Result<ServerUrl> parseServerUrl(const std::string& text);

class Connection final : public Link {
 public:
  /// Starts to connect at once, and again after every loss: first after 0.25 s, then after twice as long each time, at
  /// most 5 s. A server that refuses, or whose certificate is refused, is asked again every 5 s.
  explicit Connection(const ServerUrl& url, const LinkLimit& limit = {}, const HostAccess& access = {});
  ~Connection() override;
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  /// The connection is closed when the session rejects a message of the server.
  bool pump(Session& session) override;
  void waitForArrival(double seconds) override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace client
