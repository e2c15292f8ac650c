#include "server/cli/tuned.h"

#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <utility>

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

// Reads parameters by name, and remembers the first that is missing or no number in its range.
class ChoiceReader {
 public:
  explicit ChoiceReader(const Parameters& parameters) : parameters_(parameters) {}
  template <class T>
  T number(const char* name, T min, T max) {
    T value{};
    const auto found = parameters_.find(kPrefix + std::string(name));
    if (found == parameters_.end() || !parseNumber(found->second, value) || !(value >= min && value <= max)) fail(name);
    return value;
  }
  repository::Subsampling subsampling() {
    const auto found = parameters_.find(kPrefix + std::string("subsampling"));
    const auto parsed = found == parameters_.end() ? std::nullopt : repository::subsamplingOf(found->second);
    if (!parsed) fail("subsampling");
    return parsed.value_or(repository::Subsampling::k420);
  }
  void fail(const char* name) {
    if (problem_.empty()) problem_ = kPrefix + std::string(name);
  }
  const std::string& problem() const { return problem_; }

 private:
  const Parameters& parameters_;
  std::string problem_;
};

}  // namespace

Parameters withoutChoice(Parameters parameters) {
  std::erase_if(parameters, [](const auto& parameter) { return parameter.first.starts_with(kPrefix); });
  return parameters;
}

Parameters withoutEncoding(Parameters parameters) {
  for (const char* name : {"tune", "quality", "subsampling"}) parameters.erase(name);
  return withoutChoice(std::move(parameters));
}

void storeChoice(const TuneChoice& choice, Parameters& parameters) {
  const auto put = [&](const char* name, const std::string& value) { parameters[kPrefix + std::string(name)] = value; };
  std::array<char, 32> psnr{};
  std::snprintf(psnr.data(), psnr.size(), "%.17g", choice.psnr_db);
  put("quality", std::to_string(choice.quality));
  put("subsampling", repository::nameOf(choice.subsampling));
  put("psnr", psnr.data());
  put("jpeg-bytes", std::to_string(choice.jpeg_bytes));
  put("faces", std::to_string(choice.faces));
}

base::Result<std::optional<TuneChoice>> storedChoice(const Parameters& parameters) {
  if (withoutChoice(parameters).size() == parameters.size()) return std::optional<TuneChoice>();
  ChoiceReader reader(parameters);
  TuneChoice choice;
  choice.quality = reader.number("quality", 1, 100);
  choice.subsampling = reader.subsampling();
  choice.psnr_db = reader.number("psnr", 0.0, kMaxDb);
  choice.jpeg_bytes = reader.number<std::uint64_t>("jpeg-bytes", 1, std::uint64_t{1} << 40);
  choice.faces = reader.number<std::size_t>("faces", 1, kTuneFaces);
  if (!reader.problem().empty())
    return base::Error{base::ErrorCode::kInvalidInput, "parameters: " + reader.problem() +
                                                           " is missing or out of range; build the scene again with "
                                                           "--force"};
  return std::optional(choice);
}

std::string describeChoice(const TuneChoice& choice) {
  std::array<char, 160> text{};
  std::snprintf(text.data(), text.size(), "quality %d, %s: %.2f dB on %zu faces, %s an image", choice.quality,
                repository::nameOf(choice.subsampling), choice.psnr_db, choice.faces,
                formatBytes(choice.jpeg_bytes / choice.faces).c_str());
  return text.data();
}

nlohmann::json tunedJson(const TuneChoice& choice) {
  return {{"quality", choice.quality},
          {"subsampling", repository::nameOf(choice.subsampling)},
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
