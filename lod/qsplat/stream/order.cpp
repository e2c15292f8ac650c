#include "lod/qsplat/stream/order.h"

#include <limits>

namespace lod::qsplat {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
// More than sweepPriority ever returns: a size of 2^100 pixels has priority 200 000.
constexpr float kThroughLens = 1e6F;

Priority plainPriority(StreamOrder order, int picture_height) {
  switch (order) {
    case StreamOrder::kLevel:
      return [](const MissingChildren& missing) { return -static_cast<float>(missing.level); };
    case StreamOrder::kRadius:
      return [](const MissingChildren& missing) { return missing.radius; };
    case StreamOrder::kSize:
      return [](const MissingChildren& missing) { return missing.size_px; };
    case StreamOrder::kTopDown:
      return [](const MissingChildren& missing) { return missing.size_px < kInfinity ? -missing.at_px.y : kInfinity; };
    case StreamOrder::kSweeps:
      break;
  }
  return sweepPriority(picture_height);
}

}  // namespace

std::optional<StreamOrder> streamOrderFromName(std::string_view name) {
  for (const auto& [order, text] : kStreamOrderNames)
    if (text == name) return order;
  return std::nullopt;
}

Priority priorityFor(StreamOrder order, const std::optional<Lens>& lens, int picture_height) {
  const Priority plain = plainPriority(order, picture_height);
  if (!lens) return plain;
  return [plain, lens = *lens](const MissingChildren& missing) {
    return plain(missing) + (isSeenThrough(lens, missing.at_px, missing.size_px) ? kThroughLens : 0.0F);
  };
}

}  // namespace lod::qsplat
