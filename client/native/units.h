#pragma once
// Parses values with units, as the command line spells them.
#include <array>
#include <cstdint>
#include <string>
#include <utility>

#include "base/error.h"
#include "base/image.h"

namespace client {

/// "50M", "512k", "4G", "1000": bytes, decimal (k = 1000). At most 1e15.
base::Result<std::uint64_t> parseByteCount(const std::string& text);
/// "20Mbit", "384kbit", "1Gbit": bytes per second. Plain numbers are bits per second.
base::Result<double> parseBitRate(const std::string& text);
/// "30ms", "0.5s": seconds. Plain numbers are seconds.
base::Result<double> parseDuration(const std::string& text);
/// "1280x720": pixels, each 1 … 16384.
base::Result<std::pair<int, int>> parseViewSize(const std::string& text);
/// "#rrggbb", "#rrggbbaa" or "transparent": RGBA, 0 … 1.
base::Result<std::array<float, 4>> parseColor(const std::string& text);
/// The same of a colour without alpha.
std::array<float, 4> opaque(const base::Rgb& color);

}  // namespace client
