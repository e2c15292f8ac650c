#include "lod/qsplat/stream/order.h"

#include <limits>

namespace lod::qsplat {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
// More than any sweep has: 2^100 pixels are 200 000.
constexpr float kThroughLens = 1e6F;

Priority plainPriority(StreamOrder order, int picture_height) {
  switch (order) {
    case StreamOrder::kLevel:
      return [](const Want& want) { return -static_cast<float>(want.level); };
    case StreamOrder::kRadius:
      return [](const Want& want) { return want.radius; };
    case StreamOrder::kSize:
      return [](const Want& want) { return want.size_px; };
    case StreamOrder::kTopDown:
      return [](const Want& want) { return want.size_px < kInfinity ? -want.at_px.y : kInfinity; };
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
  return [plain, lens = *lens](const Want& want) {
    return plain(want) + (isSeenThrough(lens, want.at_px, want.size_px) ? kThroughLens : 0.0F);
  };
}

}  // namespace lod::qsplat
