#pragma once
// SCENE/build.json keeps what each part of a scene took to build (docs/formats/scene.md). It is no part of the scene:
// two builds of the same scene differ in it alone.
#include <string>
#include <vector>

#include "base/error.h"
#include "server/cli/build_command/report.h"

namespace server::cli {

inline constexpr const char* kBuildRecord = "build.json";

/// Adds what this process built to the record. The time of images adds up over processes and reruns. Under the scene's
/// lock. A record that cannot be read begins anew.
base::Result<void> addToBuildRecord(const std::string& scene, const BuildReport& report);
/// The warnings of the record, each a line; none where there is no record that can be read.
std::vector<std::string> recordedWarnings(const std::string& scene);

}  // namespace server::cli
