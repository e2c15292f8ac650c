#pragma once
// Decides when the server's own picture of the present view takes the place of the blended one. It has no GL and no
// clock of its own.
#include <cstdint>
#include <optional>
#include <span>

namespace client {

/// A frame comes in over the blended picture, or over an older frame of the same view, and goes at once when the view
/// moves, since it shows another view then. A blended picture that is still coarse is worth no time: the frame takes
/// its place at once.
class WholeFrame {
 public:
  static constexpr double kFadeSeconds = 0.15;

  /// Takes the frames of the present view that can be shown, oldest first. `moved`: the view is not that of the last
  /// call. `over_blend`: the blended picture is good enough to come in over. `fades`: false shows the newest at once.
  /// `now` in seconds.
  void update(std::span<const std::uint64_t> frames, bool moved, bool over_blend, bool fades, double now);
  void reset() { *this = {}; }

  /// The frame that is shown or coming in; nothing where the picture is blended.
  const std::optional<std::uint64_t>& shown() const { return shown_; }
  /// The older frame over which it comes in; nothing where that is the blended picture.
  const std::optional<std::uint64_t>& under() const { return under_; }
  /// The share of the shown frame in the picture, 0 … 1.
  float opacity() const { return opacity_; }
  /// Whether the picture is the frame and nothing else.
  bool whole() const { return shown_ && opacity_ >= 1.0F; }
  /// Whether the next update() may show something else by itself.
  bool fading() const { return shown_ && (opacity_ < 1.0F || newer_waits_); }

 private:
  std::optional<std::uint64_t> shown_, under_;
  double since_ = 0.0;
  float opacity_ = 0.0F;
  bool newer_waits_ = false;  // for the end of a fade
};

}  // namespace client
