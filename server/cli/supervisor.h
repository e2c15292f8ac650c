#pragma once
// Several server processes of one port, and one process that looks after them (lumigrid serve --workers N).
#include <cstdint>
#include <functional>
#include <string>

#include "base/error.h"
#include "base/file.h"

namespace server::cli {

/// A port of an address that is kept for processes that share it (SO_REUSEPORT) while this lives.
struct KeptPort {
  base::FileDescriptor socket;
  std::uint16_t port = 0;
};
/// `port` 0: any free one. Errors: no IP address, a port in use.
base::Result<KeptPort> keepPort(const std::string& address, std::uint16_t port);

/// Serves until it is told to stop, and returns the exit status. It calls `ready` once it accepts connections.
using Worker = std::function<int(unsigned number, const std::function<void()>& ready)>;

/// Starts `count` workers as processes, the first by itself: if it ends before it is ready, its exit status is returned
/// and no other is started. Calls `all_ready` when all are. A worker that ends by itself is started again, after a
/// pause that grows while workers end soon. SIGTERM, SIGINT and SIGHUP are handed on, the last one after a call of
/// `on_hangup`; after the first two this returns when all workers have ended, the largest of their exit statuses. To be
/// called while the process has no thread besides that of the log, of which no worker may make use.
int supervise(unsigned count, const Worker& worker, const std::function<void()>& all_ready,
              const std::function<void()>& on_hangup);

}  // namespace server::cli
