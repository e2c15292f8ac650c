#pragma once
// Asks a host what client/host_check.h judges.
#include <string>

#include "base/error.h"
#include "client/source/host_check.h"

namespace client {

/// Four requests or one; waits for them, 10 s at most for each. A host that does not answer is a finding, not an error;
/// an error says that scene.json is there but is no published scene's. `url` as PublishedSceneLink takes it.
base::Result<HostAnswers> askHost(const std::string& url);

}  // namespace client
