#include "server/session/frame_schedule.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "plan/view_plan.h"

namespace server {
namespace {

// Choices that measurements bore out, not the best of a sweep (docs/decisions/frames-first.md).
constexpr double kQuickSeconds = 0.1;    // a quick frame occupies the link this long
constexpr double kMovingSeconds = 0.05;  // and a moving eye's this long
// A moving eye's frames have this share of the link at most, less where one takes longer than kMovingSeconds: patches
// and images, which last, bring more (docs/decisions/slow-links.md).
constexpr double kFramesShare = 0.25;
constexpr double kLastSeconds = 0.25;  // a last frame that occupies it no longer goes ahead of the others
// A frame without loss that occupies the link longer is not sent: what is under way delays a new view.
constexpr double kWithoutLossSeconds = 1.0;
// It goes once the eye has stood so many times as long: the longer it has, the longer it is expected to go on.
constexpr double kStandsTimes = 3.0;
constexpr double kStandsMost = 1.0;  // seconds, or so long: a view is exact within two, whatever the frame takes
constexpr double kMaxCredit = 0.1;   // seconds of that share that may be saved up
// An eye that has stood for so many times as long as a better frame takes, or for so long, is expected to go on
// standing for long enough to see it. A better frame has so many times the bytes of the last at most, unless the eye
// has stood for longer (docs/decisions/slow-links.md).
constexpr double kBetterTimes = 1.5;
constexpr double kStandsSeconds = 3.0;
constexpr double kStep = 2.0;
constexpr double kLateShare = 0.75;  // of a stay, after which a frame is too late for an eye that jumps again
// Below it a frame gains little by being earlier. Of an unknown link the first frame is one that a few segments carry.
constexpr int kMinQuality = 60;
constexpr int kFirstQuality = 30;
// A moving eye's frames are blended, which costs more than this quality does; better ones would take the link from
// patches and images.
constexpr int kMovingQuality = 90;
// More is not worth its bytes: docs/decisions/larger-frames.md.
constexpr double kMostScale = 1.5;
constexpr double kLeastScale = 1.1;  // less brings nothing that is seen
// Bytes of larger frames ∝ scale^1.45: 1.6 to 1.9 times as many where each side is 1.5 times as long.
constexpr double kBytesPower = 1.45;
constexpr double kSoon = 0.15;  // whether an eye is fast is judged by where it will be after so many seconds
constexpr double kLargerRenderSeconds = 0.1;  // a larger frame that takes the renderer longer is late
constexpr double kDecodeSeconds = 0.01;       // a client's, a guess
constexpr double kRenderMemory = 0.25;        // weight of the newest rendering time
// Other messages keep the link busy up to this many seconds while a frame is rendered that is later than expected by
// more than kOverdue.
constexpr double kShortQueue = 0.02;
constexpr double kOverdue = 0.05;
constexpr double kMinWait = 0.002;  // seconds; a transport is never woken more often
// The part of the time for which a full link has been silent, after which it is looked at again: a choice, room is seen
// so much later at most.
constexpr double kQuietShare = 0.25;
// Messages wait once so many seconds of the link wait, here or on the way, since all of that is ahead of a new view's
// frame: the 128 KiB that a transport takes are a second at 1 Mbit/s, and a router's queue can hold more.
constexpr double kMostQueued = 0.1;
constexpr double kFirstBytesPerPixel = 0.25;  // at quality weight 1, before a frame tells

/// The bytes of a frame relative to those at quality 85, means over five scans (docs/decisions/frames-webp.md).
struct QualityWeight {
  int quality;
  double weight;
};
using QualityWeights = std::array<QualityWeight, 7>;
constexpr QualityWeights kJpegWeights{
    {{1, 0.08}, {30, 0.37}, {50, 0.51}, {70, 0.69}, {85, 1.0}, {95, 2.2}, {100, 3.6}}};
constexpr QualityWeights kWebpWeights{
    {{1, 0.15}, {30, 0.43}, {50, 0.56}, {75, 0.71}, {85, 1.0}, {95, 1.83}, {100, 4.0}}};

/// The same of a frame without loss: five scans have 3.9 to 9.2.
constexpr double kWeightWithoutLoss = 7.0;
constexpr int kWithoutLoss = base::ViewDefaults::kWithoutLoss;

double weightOf(protocol::FrameCodec codec, int quality) {
  const QualityWeights& weights = codec == protocol::FrameCodec::kWebp ? kWebpWeights : kJpegWeights;
  for (std::size_t i = 1; i < weights.size(); ++i) {
    const QualityWeight &a = weights[i - 1], &b = weights[i];
    if (quality > b.quality) continue;
    const double share = static_cast<double>(quality - a.quality) / (b.quality - a.quality);
    return a.weight + share * (b.weight - a.weight);
  }
  return weights.back().weight;
}

/// The bytes of a frame whose sides are so many times the view's, relative to one of the view's size.
double sizeWeightOf(double scale) {
  return std::pow(scale, kBytesPower);
}

double pixelsOf(const base::ViewCamera& camera) {
  return static_cast<double>(camera.width) * camera.height;
}

}  // namespace

void FrameSchedule::accept(std::shared_ptr<const protocol::View> view, bool possible) {
  const bool goes_on = motion_.accept(view->camera, link_.now());
  if (view_ && pixelsOf(view_->camera) != pixelsOf(view->camera)) bytes_per_weight_ = 0.0;
  if (!goes_on) under_way_.reset();
  if (!goes_on && !(view_ && base::showsSameView(view_->camera, view->camera))) countStay();
  view_ = std::move(view);
  possible_ = possible;
  aimed_ = last_requested_ = false;
  quality_ = 0;
}

/// Counts how long the eye stayed before the present jump.
void FrameSchedule::countStay() {
  if (view_) stays_ = {link_.now() - jumped_at_, stays_[0]};
  jumped_at_ = link_.now();
}

/// An eye that jumped soon each time is expected to jump soon again. A frame that it would see for less than a quarter
/// of its stay waits until it has stayed for longer: patches and images outlive a jump.
double FrameSchedule::quickMayGoAt() const {
  const double expected = std::max(stays_[0], stays_[1]);
  const double bytes = expectedBytes(qualityFor(kQuickSeconds));
  const double shown_after = render_seconds_ + link_.queueSeconds() + link_.transferSeconds(bytes) + link_.roundTrip();
  return jumped_at_ + (shown_after > kLateShare * expected ? expected : 0.0);
}

/// Time at which the eye stands saves nothing up.
void FrameSchedule::passTime() {
  const double passed = link_.now() - credited_at_;
  credited_at_ = link_.now();
  if (!moving()) {
    credit_ = 0.0;
    return;
  }
  const double rate = othersShare() * link_.rate();
  credit_ = std::min(credit_ + rate * passed, kMaxCredit * rate);
}

double FrameSchedule::expectedBytes(int quality, double scale) const {
  const double unit = bytes_per_weight_ > 0.0 ? bytes_per_weight_ : kFirstBytesPerPixel * pixelsOf(view_->camera);
  if (quality != kWithoutLoss) return unit * sizeWeightOf(scale) * weightOf(codec_, quality);
  return unit * (weight_without_loss_ > 0.0 ? weight_without_loss_ : kWeightWithoutLoss);
}

int FrameSchedule::wantedQuality() const {
  if (view_->frame_quality != protocol::kServersChoice) return view_->frame_quality;
  return codec_ == protocol::FrameCodec::kWebp ? base::ViewDefaults::kFrameWebpQuality
                                               : base::ViewDefaults::kFrameJpegQuality;
}

/// Whether the view gets a frame without loss. JPEG has none.
bool FrameSchedule::comesWithoutLoss() const {
  return view_->frame_quality == protocol::kServersChoice && codec_ == protocol::FrameCodec::kWebp &&
         link_.transferSeconds(expectedBytes(kWithoutLoss)) <= kWithoutLossSeconds;
}

double FrameSchedule::withoutLossMayGoAt() const {
  const double transfer = link_.transferSeconds(expectedBytes(kWithoutLoss));
  return motion_.newestAt() + std::min(kStandsTimes * transfer, kStandsMost);
}

/// Returns the quality of the frame after the quick one: without loss if that may go already, or the wanted one came.
/// Where one without loss was expected and the link turns out to be too slow, the wanted one is sent again, as the
/// last. `all_sent`: nothing but frames is to come, so nothing speaks for steps.
int FrameSchedule::betterQuality(bool all_sent) const {
  const int wanted = wantedQuality();
  const bool may = comesWithoutLoss() && (quality_ >= wanted || link_.now() >= withoutLossMayGoAt());
  if (may) return kWithoutLoss;
  if (all_sent || quality_ >= wanted) return wanted;
  int quality = wanted;
  while (quality > quality_ + 1 && weightOf(codec_, quality) > kStep * weightOf(codec_, quality_)) --quality;
  const double stood = link_.now() - motion_.newestAt();
  return std::max(quality, qualityFor(std::max(kLastSeconds, stood / kBetterTimes)));
}

/// The best quality, up to the wanted one, whose frame occupies the link no longer than this.
int FrameSchedule::qualityFor(double seconds) const {
  const int least = link_.isKnown() ? kMinQuality : kFirstQuality;
  int quality = wantedQuality();
  while (quality > least && link_.transferSeconds(expectedBytes(quality)) > seconds) --quality;
  return quality;
}

/// How many times as long as the view's the sides of a larger frame may be.
double FrameSchedule::mostScale() const {
  if (isFast()) return 1.0;
  const double room = std::sqrt(most_pixels_ / pixelsOf(view_->camera));
  const double time = std::sqrt(kLargerRenderSeconds / render_seconds_);
  const double side = static_cast<double>(protocol::kMaxViewport) / std::max(view_->camera.width, view_->camera.height);
  const double scale = std::min({kMostScale, room, time, side});
  return scale >= kLeastScale ? scale : 1.0;
}

/// Bytes that would bring more than kMovingQuality go into pixels.
FrameSchedule::MovingFrame FrameSchedule::movingFrame() const {
  const int quality = qualityFor(kMovingSeconds);
  if (quality < kMovingQuality) return {quality, 1.0};
  const double scale = mostScale();
  return {std::min(qualityFor(kMovingSeconds / sizeWeightOf(scale)), kMovingQuality), scale};
}

/// A fast eye's frames are as far off as they are late, which more pixels make them.
bool FrameSchedule::isFast() const {
  return plan::isFast(view_->camera, motion_.ahead(kSoon), kSoon, diagonal_);
}

/// How long a frame of so many times the view's sides is expected to take the renderer.
double FrameSchedule::renderSeconds(double scale) const {
  return scale * scale * render_seconds_;
}

FrameRequest FrameSchedule::request(const base::ViewCamera& camera, int quality, bool last) {
  under_way_ = UnderWay{++requests_, link_.now(), renderSeconds(scaleOf(camera))};
  return {view_->sequence, camera, quality, codec_, last, requests_};
}

std::optional<FrameRequest> FrameSchedule::next(bool all_sent) {
  if (!possible_ || under_way_) return std::nullopt;
  if (moving()) return nextAimed();
  if (quality_ == 0) {
    if (link_.now() < quickMayGoAt()) return std::nullopt;
    return requestExact(qualityFor(kQuickSeconds));
  }
  if (last_requested_ || link_.now() < betterMayGoAt(all_sent)) return std::nullopt;
  return requestExact(betterQuality(all_sent));
}

/// Requests a frame of this very view.
FrameRequest FrameSchedule::requestExact(int quality) {
  quality_ = quality;
  last_requested_ = quality == kWithoutLoss || (quality >= wantedQuality() && !comesWithoutLoss());
  return request(view_->camera, quality, last_requested_);
}

/// Whether so large a frame waits until acknowledgements have told the rate of a link that is not known yet.
bool FrameSchedule::waitsForRate(double bytes) const {
  return bytes > LinkEstimate::kFirstWindow && !link_.isKnown() && !link_.isIdle();
}

/// A better frame shows the view better than all else that is to come, but only while the eye stands. `all_sent`:
/// nothing else is to come.
double FrameSchedule::betterMayGoAt(bool all_sent) const {
  const int quality = betterQuality(all_sent);
  if (!all_sent && waitsForRate(expectedBytes(quality))) return std::numeric_limits<double>::infinity();
  if (quality == kWithoutLoss) return withoutLossMayGoAt();
  const double transfer = link_.transferSeconds(expectedBytes(quality));
  const bool at_once = all_sent || transfer <= kLastSeconds;
  return motion_.newestAt() + (at_once ? 0.0 : std::min(kBetterTimes * transfer, kStandsSeconds));
}

/// The view was half a round trip old when it came. The frame is rendered, waits for the link, travels and is decoded;
/// then it is shown until the next one comes, so it is aimed at the middle of that time.
std::optional<FrameRequest> FrameSchedule::nextAimed() {
  if (aimed_ || frameWaits() > 0.0) return std::nullopt;
  aimed_ = true;
  const MovingFrame frame = movingFrame();
  const double render = renderSeconds(frame.scale);
  const double transfer = link_.transferSeconds(expectedBytes(frame.quality, frame.scale));
  const double until_shown = render + transfer + link_.roundTrip() + kDecodeSeconds;
  const double shown_for = std::max(render, transfer);
  const double view_age = link_.now() - motion_.newestAt();
  base::ViewCamera camera = motion_.ahead(view_age + until_shown + 0.5 * shown_for);
  camera.width = static_cast<int>(frame.scale * camera.width);
  camera.height = static_cast<int>(frame.scale * camera.height);
  return request(camera, frame.quality, false);
}

/// Seconds for which a moving eye's frame would wait for the link, so that it is not requested yet; 0: not at all. The
/// time is a guess where the link is not known.
double FrameSchedule::frameWaits() const {
  if (!link_.isKnown() && link_.unsentSeconds() > 0.0) return 0.5 * link_.roundTrip();
  return std::max(0.0, link_.queueSeconds() - render_seconds_);
}

/// The camera's height over that of the newest view.
double FrameSchedule::scaleOf(const base::ViewCamera& camera) const {
  return static_cast<double>(camera.height) / view_->camera.height;
}

void FrameSchedule::learn(int quality, double bytes) {
  if (quality != kWithoutLoss)
    bytes_per_weight_ = bytes / weightOf(codec_, quality);
  else if (bytes_per_weight_ > 0.0)
    weight_without_loss_ = bytes / bytes_per_weight_;
}

void FrameSchedule::rendered(const FrameRequest& request, std::size_t bytes) {
  const double scale = scaleOf(request.camera);
  if (bytes > 0) learn(request.quality, static_cast<double>(bytes) / sizeWeightOf(scale));
  if (!under_way_ || under_way_->number != request.number) return;
  const double took = (link_.now() - under_way_->since) / (scale * scale);
  render_seconds_ += kRenderMemory * (took - render_seconds_);
  under_way_.reset();
}

bool FrameSchedule::isUseful(const base::ViewCamera& camera) const {
  if (!possible_) return false;
  const base::ViewCamera& now = view_->camera;
  return camera.section == now.section && glm::length(now.position - camera.position) <= kReach * diagonal_ &&
         glm::dot(now.direction, camera.direction) > std::cos(now.fov_y);
}

double FrameSchedule::renderSecondsLeft() const {
  return under_way_ ? std::max(0.0, under_way_->since + under_way_->render_seconds - link_.now()) : 0.0;
}

/// The share of the link for other messages while the eye moves: what frames leave, which is more where the renderer is
/// slower than the link.
double FrameSchedule::othersShare() const {
  const MovingFrame frame = movingFrame();
  const double transfer = expectedBytes(frame.quality, frame.scale) / link_.rate();
  const double most = kFramesShare * std::sqrt(std::min(1.0, kMovingSeconds / transfer));
  return 1.0 - std::min(most, transfer / std::max(renderSeconds(frame.scale), transfer));
}

bool FrameSchedule::overdue() const {
  return link_.now() - under_way_->since >= under_way_->render_seconds + kOverdue;
}

/// Bytes that wait when a frame is there delay it. While TCP begins that costs whole round trips, so nothing waits then
/// unless it will have gone a round trip earlier.
double FrameSchedule::othersMayWait() const {
  return overdue() ? kShortQueue : std::max(0.0, renderSecondsLeft() - link_.roundTrip());
}

bool FrameSchedule::linkIsFull() const {
  if (!link_.isMeasured()) return link_.isFullUnmeasured();
  return link_.queueSeconds() > kMostQueued;
}

bool FrameSchedule::holdsOthers(double bytes) const {
  if (linkIsFull()) return true;
  if (moving()) return credit_ <= 0.0;
  if (!possible_ || !under_way_) return false;
  return link_.waitSeconds(overdue() ? 0.0 : bytes) > othersMayWait();
}

std::optional<double> FrameSchedule::wakeAt(bool tells_room) const {
  const double now = link_.now();
  double at = std::numeric_limits<double>::infinity();
  const auto in = [&](double seconds) { at = std::min(at, now + std::max(kMinWait, seconds)); };
  // A client that takes nothing is looked at ever less often, or many of them on a server with too much to do would
  // keep it from sending.
  if (linkIsFull() && !tells_room)
    in(std::max(kQuietShare * link_.quietSeconds(),
                link_.isMeasured() ? link_.queueSeconds() - kMostQueued : 0.5 * link_.roundTrip()));
  if (!possible_) return std::isfinite(at) ? std::optional(at) : std::nullopt;
  if (moving()) {
    in(motion_.settledAt() - now);
    if (!aimed_ && !under_way_) in(frameWaits());
    if (credit_ <= 0.0) in(-credit_ / (othersShare() * link_.rate()));
  } else if (under_way_) {
    if (holdsOthers()) in(link_.waitSeconds(0.0) - othersMayWait());
    if (!overdue()) in(under_way_->since + under_way_->render_seconds + kOverdue - now);
  } else if (quality_ == 0) {
    in(quickMayGoAt() - now);
  } else if (!last_requested_) {
    const double better = betterMayGoAt(false);
    in(std::isfinite(better) ? better - now : 0.5 * link_.roundTrip());
  }
  return std::isfinite(at) ? std::optional(at) : std::nullopt;
}

}  // namespace server
