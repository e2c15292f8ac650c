#include "client/native/units.h"

#include <charconv>
#include <cmath>
#include <initializer_list>
#include <string_view>

namespace client {
namespace {

base::Error badValue(const std::string& text, const std::string& like) {
  return {base::ErrorCode::kInvalidInput, "'" + text + "' is not " + like};
}

struct Suffix {
  std::string_view text;
  double factor;
};

/// Reads a non-negative number with one of the suffixes. A number without suffix is accepted only where the list has an
/// empty one. `like` describes such values for the error.
base::Result<double> parseScaled(const std::string& text, std::initializer_list<Suffix> suffixes, double max,
                                 const char* like) {
  double number = 0.0;
  const char* end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, number);
  if (error != std::errc{} || !std::isfinite(number) || number < 0.0) return badValue(text, like);
  const std::string_view suffix(rest, static_cast<std::size_t>(end - rest));
  for (const Suffix& known : suffixes)
    if (known.text == suffix && number * known.factor <= max) return number * known.factor;
  return badValue(text, like);
}

}  // namespace

base::Result<std::uint64_t> parseByteCount(const std::string& text) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto value,
                            parseScaled(text, {{"", 1.0}, {"k", 1e3}, {"K", 1e3}, {"M", 1e6}, {"G", 1e9}}, 1e15,
                                        "a number of bytes like 50M"));
  return static_cast<std::uint64_t>(value);
}

base::Result<double> parseBitRate(const std::string& text) {
  return parseScaled(text, {{"", 0.125}, {"bit", 0.125}, {"kbit", 125.0}, {"Mbit", 125e3}, {"Gbit", 125e6}}, 1e15,
                     "a rate like 20Mbit (per second)");
}

base::Result<double> parseDuration(const std::string& text) {
  return parseScaled(text, {{"", 1.0}, {"s", 1.0}, {"ms", 1e-3}}, 1e6, "a duration like 30ms or 2s");
}

base::Result<std::pair<int, int>> parseViewSize(const std::string& text) {
  const base::Error bad = badValue(text, "a size like 1280x720, each side 1 to 16384 pixels");
  int width = 0;
  int height = 0;
  const char* end = text.data() + text.size();
  const auto first = std::from_chars(text.data(), end, width);
  if (first.ec != std::errc{} || first.ptr == end || *first.ptr != 'x') return bad;
  const auto second = std::from_chars(first.ptr + 1, end, height);
  if (second.ec != std::errc{} || second.ptr != end) return bad;
  if (width < 1 || height < 1 || width > 16384 || height > 16384) return bad;
  return std::pair(width, height);
}

base::Result<std::array<float, 4>> parseColor(const std::string& text) {
  if (text == "transparent") return std::array<float, 4>{0.0F, 0.0F, 0.0F, 0.0F};
  std::array<float, 4> color{0.0F, 0.0F, 0.0F, 1.0F};
  if ((text.size() != 7 && text.size() != 9) || text.front() != '#')
    return badValue(text, "a colour like #204060 or transparent");
  for (std::size_t i = 0; 1 + 2 * i < text.size(); ++i) {
    unsigned value = 0;
    const char* digits = text.data() + 1 + 2 * i;
    const auto [rest, error] = std::from_chars(digits, digits + 2, value, 16);
    if (error != std::errc{} || rest != digits + 2) return badValue(text, "a colour like #204060 or transparent");
    color[i] = static_cast<float>(value) / 255.0F;
  }
  return color;
}

std::array<float, 4> opaque(const base::Rgb& color) {
  const auto share = [](std::uint8_t part) { return static_cast<float>(part) / 255.0F; };
  return {share(color[0]), share(color[1]), share(color[2]), 1.0F};
}

}  // namespace client
