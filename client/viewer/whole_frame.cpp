#include "client/viewer/whole_frame.h"

#include <algorithm>

namespace client {

void WholeFrame::update(std::span<const std::uint64_t> frames, bool moved, bool over_blend, bool fades, double now) {
  const auto here = [&](const std::optional<std::uint64_t>& frame) {
    return frame && std::find(frames.begin(), frames.end(), *frame) != frames.end();
  };
  if (frames.empty()) return reset();
  const bool was_whole = whole() && !moved;
  if (moved || !here(shown_)) {
    // A frame that went from below its successor leaves nothing to fade from but the successor itself.
    shown_ = frames.back();
    under_.reset();
    since_ = was_whole || !over_blend ? now - kFadeSeconds : now;
  } else if (was_whole && frames.back() != *shown_) {
    // A fade that runs ends before the next begins, so that the picture never jumps.
    under_ = shown_;
    shown_ = frames.back();
    since_ = now;
  }
  const bool over_nothing = under_ && !here(under_);
  const double share = (now - since_) / kFadeSeconds;
  opacity_ = fades && !over_nothing ? static_cast<float>(std::clamp(share, 0.0, 1.0)) : 1.0F;
  if (opacity_ >= 1.0F) under_.reset();
  newer_waits_ = frames.back() != *shown_;
}

}  // namespace client
