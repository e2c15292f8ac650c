#pragma once
// Decides which exact frame of a client's view is rendered next, and how much of the link the other messages get.
//
// A view at which the eye stands gets a quick frame at once, of a quality that the link carries in kQuickSeconds, then
// better ones up to the wanted quality if the quick one had less, and where the client leaves the quality to the
// server, one without loss if the link carries that in kWithoutLossSeconds. A better one has kStep times the bytes of
// the last at most, or what the eye has stood for long enough; it comes at once where it occupies the link no longer
// than kLastSeconds, else when the eye has stood kBetterTimes as long as it takes, or kStandsSeconds, or everything
// else was sent; the one without loss when the eye has stood kStandsTimes as long as it takes, or kStandsMost. A moving
// eye gets frames one after the other, each drawn for where the eye will be when the frame arrives; where the link
// carries more than they need, with more pixels than the view has, since looking a picture up between its pixels blurs
// it.
//
// Until the link is known, no more is handed out than it takes at once: a slow one would be full for seconds.
#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>

#include "base/camera.h"
#include "base/view_defaults.h"
#include "protocol/message.h"
#include "server/session/link_estimate.h"
#include "server/session/motion.h"

namespace server {

/// An exact frame to be rendered.
struct FrameRequest {
  std::uint32_t sequence = 0;  ///< of the newest view; the camera may be ahead of that view's
  base::ViewCamera camera;
  int quality = protocol::kServersChoice;  ///< 1..100, kServersChoice, or base::ViewDefaults::kWithoutLoss
  protocol::FrameCodec codec = protocol::FrameCodec::kJpeg;
  bool last = false;         ///< the view gets no other frame after it
  std::uint64_t number = 0;  ///< counts the session's requests
};

class FrameSchedule {
 public:
  /// The eye moves by this share of the scene's diagonal before a frame is dropped. Measured: after 8 % a late frame
  /// still improves the blended view.
  static constexpr double kReach = 0.1;

  /// `diagonal`: the scene's, world units. A frame from farther away than kReach of it is of no use to a view.
  explicit FrameSchedule(double diagonal) : diagonal_(diagonal), motion_(kReach * diagonal) {}

  /// Sets the codec of all frames.
  void setCodec(protocol::FrameCodec codec) { codec_ = codec; }
  /// Sets how many pixels a moving eye's frame may have, if those of its view are fewer.
  void setMostPixels(std::uint32_t pixels) {
    most_pixels_ = std::min<std::uint32_t>(pixels, base::ViewDefaults::kMaxFramePixels);
  }
  LinkEstimate& link() { return link_; }
  const LinkEstimate& link() const { return link_; }
  /// Accepts the newest view, not null; `possible`: it wants frames, and the server can render them.
  void accept(std::shared_ptr<const protocol::View> view, bool possible);
  /// The frame to render now; one is under way at a time, except that a view after a jump waits for none.
  /// `all_sent`: everything but frames was sent for the newest view.
  std::optional<FrameRequest> next(bool all_sent);
  /// Accepts that a request was answered, by so many bytes; 0: rendering failed.
  void rendered(const FrameRequest& request, std::size_t bytes);
  /// Whether a frame drawn for this camera is a good sample for the newest view.
  bool isUseful(const base::ViewCamera& camera) const;
  /// Whether the newest view still gets a frame, before which nothing is sent that is not needed yet.
  bool owesFrame() const { return possible_ && (!last_requested_ || under_way_); }
  /// Whether the newest view's frame is of use before there is any model: it is shown by itself while the eye stands.
  bool standsAlone() const { return possible_ && !moving(); }
  /// Whether the eye moves, and fast (plan::isFast()), as the views of the last tenth of a second tell.
  bool eyeIsFast() const { return motion_.moving(link_.now()) && isFast(); }
  /// Whether so much is queued already that nothing but a frame should join it.
  bool linkIsFull() const;
  /// Whether other messages wait, so that the link is free for a new view, or when the frame that is being rendered
  /// comes. `bytes`: of the next one, as far as they are known.
  bool holdsOthers(double bytes = 0.0) const;
  /// Counts bytes of another message that was handed out.
  void countOther(std::size_t bytes) { credit_ -= static_cast<double>(bytes); }
  /// Counts time: call it after link().update().
  void passTime();
  /// When next() or holdsOthers() may answer otherwise without any other call, seconds; nothing: never. `tells_room`:
  /// there will be an update() of the link when the transport has written what it holds, so that nobody need look
  /// whether a full link has room by then.
  std::optional<double> wakeAt(bool tells_room = false) const;

 private:
  struct UnderWay {
    std::uint64_t number;
    double since;
    double render_seconds;  ///< expected
  };
  /// A moving eye's next frame. `scale`: its width and height over the view's.
  struct MovingFrame {
    int quality;
    double scale;
  };
  bool moving() const { return possible_ && motion_.moving(link_.now()); }
  FrameRequest request(const base::ViewCamera& camera, int quality, bool last);
  FrameRequest requestExact(int quality);
  std::optional<FrameRequest> nextAimed();
  int wantedQuality() const;
  bool comesWithoutLoss() const;
  double withoutLossMayGoAt() const;
  int betterQuality(bool all_sent) const;
  double frameWaits() const;
  bool waitsForRate(double bytes) const;
  void countStay();
  double quickMayGoAt() const;
  int qualityFor(double seconds) const;
  MovingFrame movingFrame() const;
  bool isFast() const;
  double mostScale() const;
  double expectedBytes(int quality, double scale = 1.0) const;
  double renderSeconds(double scale) const;
  double betterMayGoAt(bool all_sent) const;
  double scaleOf(const base::ViewCamera& camera) const;
  void learn(int quality, double bytes);
  double renderSecondsLeft() const;
  bool overdue() const;
  double othersMayWait() const;
  double othersShare() const;

  double diagonal_;
  protocol::FrameCodec codec_ = protocol::FrameCodec::kJpeg;
  LinkEstimate link_;
  Motion motion_;
  std::uint32_t most_pixels_ = 0;

  // The newest view.
  std::shared_ptr<const protocol::View> view_;  // null: there was none
  bool possible_ = false;
  bool aimed_ = false;  // a frame ahead of it was requested
  int quality_ = 0;     // of the newest frame of this very view that was requested; 0: none was
  bool last_requested_ = false;

  double jumped_at_ = 0.0;  // when the eye came to where it is, seconds
  // How long it stayed before the last two jumps, the newest first; infinite before there were any.
  std::array<double, 2> stays_{std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};

  std::optional<UnderWay> under_way_;
  std::uint64_t requests_ = 0;
  double render_seconds_ = 0.03;      // how long a frame of the view's size takes the renderer; the first's is assumed
  double bytes_per_weight_ = 0.0;     // a frame's bytes at quality weight 1; 0: not known
  double weight_without_loss_ = 0.0;  // of the newest frame without loss; 0: not known
  double credit_ = 0.0;               // bytes that other messages may take while the eye moves
  double credited_at_ = 0.0;
};

}  // namespace server
