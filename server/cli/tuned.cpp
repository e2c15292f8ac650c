#include "server/cli/tuned.h"

#include <charconv>
#include <cmath>
#include <utility>

#include "base/format_text.h"
#include "server/cli/console.h"

namespace server::cli {
namespace {

constexpr const char* kPrefix = "tuned-";
constexpr double kMaxDb = 99.0;  // the PSNR of equal pictures (base::PictureError)

template <class T>
bool parseNumber(const std::string& text, T& number) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc() && end == text.data() + text.size();
}

// The value of one of the choice's parameters; empty, which no number and no name is, where it is absent.
std::string valueOf(const Parameters& parameters, const char* name) {
  const auto found = parameters.find(kPrefix + std::string(name));
  return found == parameters.end() ? "" : found->second;
}

// Whether the parameter is a number in the range, which is stored then.
template <class T>
bool readNumber(const Parameters& parameters, const char* name, T min, T max, T& number) {
  return parseNumber(valueOf(parameters, name), number) && number >= min && number <= max;
}

// Reads all of the choice. Returns the name of the first parameter that is missing or out of range; null: none is.
const char* readChoice(const Parameters& parameters, TuneChoice& choice) {
  const auto subsampling = base::subsamplingOf(valueOf(parameters, "subsampling"));
  choice.subsampling = subsampling.value_or(choice.subsampling);
  if (!readNumber(parameters, "quality", 1, 100, choice.quality)) return "quality";
  if (!subsampling) return "subsampling";
  if (!readNumber(parameters, "psnr", 0.0, kMaxDb, choice.psnr_db)) return "psnr";
  if (!readNumber<std::uint64_t>(parameters, "jpeg-bytes", 1, std::uint64_t{1} << 40, choice.jpeg_bytes))
    return "jpeg-bytes";
  if (!readNumber<std::size_t>(parameters, "faces", 1, kTuneTiles, choice.faces)) return "faces";
  return nullptr;
}

}  // namespace

Parameters withoutChoice(Parameters parameters) {
  std::erase_if(parameters, [](const auto& parameter) { return parameter.first.starts_with(kPrefix); });
  return parameters;
}

Parameters withoutEncoding(Parameters parameters) {
  for (const char* name : {"codec", "tune", "quality", "subsampling"}) parameters.erase(name);
  return withoutChoice(std::move(parameters));
}

void storeChoice(const TuneChoice& choice, Parameters& parameters) {
  const auto put = [&](const char* name, const std::string& value) { parameters[kPrefix + std::string(name)] = value; };
  put("quality", std::to_string(choice.quality));
  put("subsampling", base::nameOf(choice.subsampling));
  put("psnr", base::formatText("%.17g", choice.psnr_db));
  put("jpeg-bytes", std::to_string(choice.jpeg_bytes));
  put("faces", std::to_string(choice.faces));
}

base::Result<std::optional<TuneChoice>> storedChoice(const Parameters& parameters) {
  if (withoutChoice(parameters).size() == parameters.size()) return std::optional<TuneChoice>();
  TuneChoice choice;
  if (const char* wrong = readChoice(parameters, choice))
    return base::Error{base::ErrorCode::kInvalidInput, "parameters: " + std::string(kPrefix) + wrong +
                                                           " is missing or out of range; build the scene again with "
                                                           "--force"};
  return std::optional(choice);
}

std::string describeChoice(const TuneChoice& choice) {
  return base::formatText("quality %d, %s: %.2f dB on %zu images, %s an image", choice.quality,
                          base::nameOf(choice.subsampling), choice.psnr_db, choice.faces,
                          formatBytes(choice.jpeg_bytes / choice.faces).c_str());
}

nlohmann::json tunedJson(const TuneChoice& choice) {
  return {{"quality", choice.quality},
          {"subsampling", base::nameOf(choice.subsampling)},
          {"psnr_db", choice.psnr_db},
          {"faces", choice.faces},
          {"jpeg_bytes", choice.jpeg_bytes}};
}

bool parseTune(const std::string& text, std::optional<double>& psnr_db) {
  psnr_db.reset();
  if (text == "off") return true;
  double value = 0.0;
  if (!parseNumber(text, value) || !(value > 0.0 && value < kMaxDb)) return false;
  psnr_db = value;
  return true;
}

}  // namespace server::cli
