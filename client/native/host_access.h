#pragma once
// Reaching hosts that are not for everybody: a token for private scenes, and authorities that vouch for a host.
#include <string>

#include "base/error.h"

namespace client {

struct HostAccess {
  std::string token;    ///< sent as "Authorization: Bearer …" to the host of the scene and no other; empty: none
  std::string ca_file;  ///< PEM; authorities trusted besides those of this system; empty: none
};

/// Reads a token from a file that holds nothing else but spaces and line ends. Errors name the file, never its content.
base::Result<std::string> readTokenFile(const std::string& path);

/// Takes the credential out of a link's query, "?token=…" or "?expires=…&signature=…" (docs/private-scenes.md), and
/// returns what stands for it in Authorization; "" for an address without one.
std::string takeCredential(std::string& url);

/// Whether a token for this address would travel so that others on the way can read it: not encrypted, and not on this
/// machine.
bool wouldExposeToken(const std::string& url);

}  // namespace client
