#pragma once
// scene.json keeps the choice of `build --tune` among the parameters, under names that begin with "tuned-", apart from
// the options that were given (docs/formats/scene.md).
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "base/error.h"
#include "server/bake/tune.h"

namespace server::cli {

using Parameters = std::map<std::string, std::string>;

/// The parameters without the choice.
Parameters withoutChoice(Parameters parameters);
/// The parameters without those of encoding images: codec, tune, quality, subsampling, and the choice.
Parameters withoutEncoding(Parameters parameters);

void storeChoice(const TuneChoice& choice, Parameters& parameters);
/// The choice, or nothing when there is none. An error, naming the parameter, when it is not one that storeChoice
/// writes.
base::Result<std::optional<TuneChoice>> storedChoice(const Parameters& parameters);

/// "quality 78, 4:2:0: 36.02 dB on 64 faces, 6.1 kB an image"
std::string describeChoice(const TuneChoice& choice);

/// The same for machines: quality, subsampling, psnr_db, faces, jpeg_bytes (of the sample).
nlohmann::json tunedJson(const TuneChoice& choice);

/// Reads the value of --tune: decibels, or nothing for "off". False when it is neither, or not above 0 and below 99.
bool parseTune(const std::string& text, std::optional<double>& psnr_db);

}  // namespace server::cli
