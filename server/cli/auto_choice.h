#pragma once
// scene.json keeps what `build --methods auto` measured as the parameter "auto", apart from the options that were given
// (docs/formats/scene.md).
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "base/error.h"
#include "server/trial/trial.h"

namespace server::cli {

inline constexpr const char* kAutoParameter = "auto";

/// views; patches and images: mean_psnr_db, worst_psnr_db, bytes.
nlohmann::json trialJson(const Trial& trial);
/// The trial in the parameters, or nothing when there is none. An error, naming the parameter, when it is not one that
/// trialJson() writes.
base::Result<std::optional<Trial>> storedTrial(const std::map<std::string, std::string>& parameters);

/// "10 held-out views: patches alone 38.31 dB (worst 33.1) from 1.2 MB, with images 38.90 dB (worst 34.0) from 4.1 MB;
/// images bring 0.59 dB, at least 0.3 is asked of them, so they are built"
std::string describeTrial(const Trial& trial);

}  // namespace server::cli
