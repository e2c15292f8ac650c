#include "server/cli/auto_choice.h"

#include "base/format_text.h"
#include "base/picture_error.h"
#include "server/cli/console.h"

namespace server::cli {
namespace {

nlohmann::json figuresJson(const TrialFigures& figures) {
  return {{"mean_psnr_db", figures.mean_psnr_db}, {"worst_psnr_db", figures.worst_psnr_db}, {"bytes", figures.bytes}};
}

/// False when a member is missing or out of range.
bool readFigures(const nlohmann::json& json, const char* name, TrialFigures& figures) {
  const auto found = json.find(name);
  if (found == json.end() || !found->is_object()) return false;
  const auto decibels = [&](const char* member, double& db) {
    const auto it = found->find(member);
    if (it == found->end() || !it->is_number()) return false;
    db = it->get<double>();
    return db >= 0.0 && db <= base::kEqualDb;
  };
  const auto bytes = found->find("bytes");
  if (bytes == found->end() || !bytes->is_number_unsigned()) return false;
  figures.bytes = bytes->get<std::uint64_t>();
  return decibels("mean_psnr_db", figures.mean_psnr_db) && decibels("worst_psnr_db", figures.worst_psnr_db);
}

std::string describe(const TrialFigures& figures) {
  return base::formatText("%.2f dB (worst %.1f) from %s", figures.mean_psnr_db, figures.worst_psnr_db,
                          formatBytes(figures.bytes).c_str());
}

}  // namespace

nlohmann::json trialJson(const Trial& trial) {
  return {{"views", trial.views}, {"patches", figuresJson(trial.patches)}, {"images", figuresJson(trial.images)}};
}

base::Result<std::optional<Trial>> storedTrial(const std::map<std::string, std::string>& parameters) {
  const auto found = parameters.find(kAutoParameter);
  if (found == parameters.end()) return std::optional<Trial>();
  const auto json = nlohmann::json::parse(found->second, nullptr, false);
  Trial trial;
  const bool read = json.is_object() && json.contains("views") && json["views"].is_number_unsigned() &&
                    readFigures(json, "patches", trial.patches) && readFigures(json, "images", trial.images);
  if (!read)
    return base::Error{base::ErrorCode::kInvalidInput, "parameters: " + std::string(kAutoParameter) +
                                                           " is not what --methods auto measured; build the scene "
                                                           "again with --force"};
  trial.views = json["views"].get<std::size_t>();
  return std::optional(trial);
}

std::string describeTrial(const Trial& trial) {
  return base::formatText(
      "%zu held-out views: patches alone %s, with images %s; images bring %.2f dB, at least %.1f is asked of them, so "
      "they are %s",
      trial.views, describe(trial.patches).c_str(), describe(trial.images).c_str(), trial.gainDb(), Trial::kMinGainDb,
      trial.imagesPay() ? "built" : "left out");
}

}  // namespace server::cli
