#pragma once
// Decodes at once and hands images over when a real decoder would have: one after the other, at a given speed.
#include <algorithm>
#include <deque>
#include <utility>
#include <vector>

#include "client/native/native_decoder.h"
#include "client/viewer/decode.h"

namespace compare {

class VirtualDecoder final : public client::ImageDecoder {
 public:
  /// `seconds`: for 512 × 512 pixels.
  explicit VirtualDecoder(double seconds) : seconds_per_pixel_(seconds / (512.0 * 512.0)) {}

  /// Every submit() and takeDecoded() until the next call happens at `now`.
  void setTime(double now) { now_ = now; }
  void submit(std::uint64_t id, base::ByteView coded) override {
    DecodedImage decoded = client::decodeFaceImage(id, coded);
    free_ = std::max(free_, now_) + seconds_per_pixel_ * static_cast<double>(decoded.rgba.width * decoded.rgba.height);
    waiting_.push_back({free_, std::move(decoded)});
  }
  std::vector<DecodedImage> takeDecoded() override {
    std::vector<DecodedImage> done;
    for (; !waiting_.empty() && waiting_.front().first <= now_; waiting_.pop_front())
      done.push_back(std::move(waiting_.front().second));
    return done;
  }
  std::size_t pending() const override { return waiting_.size(); }

 private:
  double seconds_per_pixel_;
  double now_ = 0.0, free_ = 0.0;
  std::deque<std::pair<double, DecodedImage>> waiting_;
};

}  // namespace compare
