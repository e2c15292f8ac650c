#include "server/cli/build_command/build_record.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/file.h"
#include "server/cli/console.h"

namespace server::cli {
namespace {

template <class Summary>
nlohmann::json timesOf(const Summary& summary) {
  return {{"seconds", summary.seconds}, {"cpu_seconds", summary.cpu_seconds}};
}

/// 0 where there is no such number.
double numberAt(const nlohmann::json& json, const nlohmann::json::json_pointer& place) {
  return json.contains(place) && json[place].is_number() ? json[place].get<double>() : 0.0;
}

/// The record of the scene; an empty object where it cannot be read.
nlohmann::json readRecord(const std::string& path) {
  nlohmann::json record;
  if (const auto bytes = base::readFile(path)) record = nlohmann::json::parse(*bytes, nullptr, false);
  return record.is_object() ? record : nlohmann::json::object();
}

std::vector<std::string> warningsIn(const nlohmann::json& record) {
  std::vector<std::string> warnings;
  if (!record.contains("warnings") || !record["warnings"].is_array()) return warnings;
  for (const auto& warning : record["warnings"])
    if (warning.is_string()) warnings.push_back(warning.get<std::string>());
  return warnings;
}

}  // namespace

std::vector<std::string> recordedWarnings(const std::string& scene) {
  return warningsIn(readRecord(scene + "/" + kBuildRecord));
}

base::Result<void> addToBuildRecord(const std::string& scene, const BuildReport& report) {
  const bool rendered = report.bake && report.bake->faces_rendered != 0;
  if (!report.hierarchy && !report.splats && !report.umbrellas && !report.hlod && !rendered) return {};
  using Place = nlohmann::json::json_pointer;
  const std::string path = scene + "/" + kBuildRecord;
  nlohmann::json record = readRecord(path);
  record["version"] = 1;
  record["peak_memory_bytes"] =
      std::max(numberAt(record, Place("/peak_memory_bytes")), static_cast<double>(peakResidentBytes()));
  if (report.hierarchy) record["patch"] = timesOf(*report.hierarchy);
  if (report.splats) record["qsplat"] = timesOf(*report.splats);
  if (report.umbrellas) record["pmr"] = timesOf(*report.umbrellas);
  if (report.hlod) record["hlod"] = timesOf(*report.hlod);
  std::vector<std::string> warnings = report.hierarchy ? std::vector<std::string>() : warningsIn(record);
  for (const std::string& warning : report.warnings)
    if (std::find(warnings.begin(), warnings.end(), warning) == warnings.end()) warnings.push_back(warning);
  if (warnings.empty())
    record.erase("warnings");
  else
    record["warnings"] = warnings;
  if (rendered)
    record["images"] = {
        {"seconds", numberAt(record, Place("/images/seconds")) + report.bake->seconds},
        {"rendered", numberAt(record, Place("/images/rendered")) + static_cast<double>(report.bake->faces_rendered)}};
  return base::writeFileAtomically(path, base::viewOfText(record.dump(1) + "\n"));
}

}  // namespace server::cli
