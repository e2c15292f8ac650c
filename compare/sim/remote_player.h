#pragma once
// A client that shows the pictures that a server draws of its views: it sends its camera, and shows what arrived last.
#include <algorithm>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "compare/sim/player.h"
#include "compare/sim/remote_picture.h"

namespace compare {

class RemotePlayer : public Player {
 public:
  base::Result<void> advance(double now, const base::ViewCamera& camera) override;
  base::Result<base::Image> draw() override;
  bool atRest() const override { return shown_ && shown_->view.last && shown_->view.text == text_; }
  PlayerCounts counts() const override;

 protected:
  /// A view on its way through server and link.
  struct View {
    base::ViewCamera camera;
    std::string text;      ///< textOf(camera)
    double seen = 0.0;     ///< when the client looked at it, seconds
    base::Bytes coverage;  ///< of the drawn picture, one byte a pixel
    bool last = true;      ///< the server sends no other picture while the view stays
  };

  RemotePlayer(const Stage& stage, const LinkProfile& link);
  const Stage& stage() const { return stage_; }
  /// Bytes that wait at the server.
  std::uint64_t unsentBytes() const { return down_.unsentBytes(); }
  /// Begins to draw a view, which takes the server's time.
  void beginToDraw(View view, double now);
  bool draws() const { return drawing_.has_value(); }

  // ---- what a kind of picture decides ----
  /// The client's newest view has arrived at the server.
  virtual void acceptView(View view) = 0;
  /// Begins to draw when it is time for it and the server is free.
  virtual void serve(double now) = 0;
  /// When serve() has something to do by itself; kNever where only arrivals and the end of drawing call for it.
  virtual double nextServe() const { return kNever; }
  virtual base::Result<RemotePicture> encode(const base::ViewCamera& camera) = 0;
  /// Decodes what one encode() returned, in the same order. RGB.
  virtual base::Result<base::Image> decode(base::ByteView coded) = 0;

 private:
  struct Arrival {
    View view;
    base::Image picture;
    double shown = 0.0;  ///< when it is decoded
  };

  double nextEvent() const;
  base::Result<void> act(double now);
  base::Result<void> receive(double now);
  base::Result<void> finishDrawing(double now);

  const Stage& stage_;
  Pipe down_, up_;
  const double connected_at_;
  double now_ = 0.0;
  base::ViewCamera camera_;
  std::string text_, sent_text_;  // the view that the client has, and the one that it told last
  std::deque<View> told_;         // on their way to the server
  std::optional<View> drawing_;
  double drawn_at_ = 0.0;
  std::deque<View> coming_;  // on their way to the client
  std::deque<Arrival> decoding_;
  double decoder_free_ = 0.0;
  std::optional<Arrival> shown_;
  std::uint64_t sent_messages_ = 0;
};

}  // namespace compare
