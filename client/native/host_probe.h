#pragma once
// Sends the requests whose answers client/source/host_check.h judges.
#include <string>

#include "base/error.h"
#include "client/native/host_access.h"
#include "client/source/host_check.h"

namespace client {

/// Sends one request, and three more when it succeeds; waits at most 10 s for each. A host that does not answer is a
/// finding, not an error; an error says that scene.json exists but belongs to no published scene. `url` is as
/// PublishedSceneLink takes it.
base::Result<HostAnswers> askHost(const std::string& url, const HostAccess& access = {});

}  // namespace client
