#pragma once
// One viewer: a WebSocket with a protocol Session. Reads and writes run side by side; the next message is chosen when
// the one before it was written.
#include <memory>

#include "server/net/beast_types.h"
#include "server/net/hub.h"

namespace server {

/// Answers the upgrade and serves the viewer. `hosted` outlives the session.
void startWebSocketSession(std::shared_ptr<Hub> hub, const HostedScene& hosted, BeastStream&& stream,
                           const UpgradeRequest& upgrade);

}  // namespace server
