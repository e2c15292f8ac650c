#pragma once
// The view of a file of which a stream decodes pieces: the leaves of a pmr.lgm, or the nodes of a hlod.lgh. It decides
// when pieces are chosen anew and when they are drawn; a method says how its own look and where a ray meets them.
#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "client/source/duty_cycle.h"
#include "client/source/motion_pace.h"
#include "client/source/scene_ray.h"
#include "client/source/streamed_draw.h"
#include "client/source/streamed_file.h"
#include "client/source/streamed_view.h"
#include "lod/file_bytes.h"

namespace client {

inline constexpr lod::hlod::ShadowLight kNoShadows{glm::vec4(0.0F), 0.0F};

/// `Types` has the method's own: Stream, StreamOptions and TraverseRequest of its file; Piece, which the stream finds
/// for a view; Renderer, View, Target and Count, with which pieces are drawn; isWhole(), whether so many pieces that
/// were found leave no hole; streamBytes(), the memory for what is here of the file and decoded of it, and kMinMemory,
/// the least; kSize, the member of StreamedQuality down to which pieces are refined at rest, pixels; kMinSize, the
/// least that it may be.
template <class Types>
class StreamedPieces : public StreamedView {
 public:
  /// `welcome` and `fetcher`: as in StreamedFile.
  StreamedPieces(FilePlace file, const protocol::Welcome& welcome, std::unique_ptr<RangeFetcher> fetcher,
                 const StreamedOptions& options)
      : file_(std::move(file), welcome, std::move(fetcher)),
        options_(checked(options)),
        stream_(file_.place().bytes, streamOptions(options)),
        pace_(options_.frame_seconds, finestPx()) {}
  /// Shows a whole file that is on this machine. `bytes`: not null.
  StreamedPieces(FilePlace file, const protocol::Welcome& welcome, std::shared_ptr<const lod::FileBytes> bytes,
                 const StreamedOptions& options)
      : file_(std::move(file), welcome, nullptr),
        options_(checked(options)),
        stream_(std::move(bytes), streamOptions(options)),
        pace_(options_.frame_seconds, finestPx()) {}

  bool pump(Session& session, double now) override;
  const base::Sphere* bounds() const override;
  void update(const base::Camera& camera, const StreamedLook& look) override;
  base::Result<void> draw(const base::Camera& camera, const StreamedLook& look) override;
  base::Camera drawnCamera() const override { return renderer_ ? renderer_->drawnCamera() : camera_; }
  bool isMultisampled() const override { return true; }
  std::optional<glm::vec3> surfaceAt(const base::Camera& camera, double x, double y) const override;
  bool complete() const override;
  bool busy() const override;
  void setQuality(const StreamedQuality& quality) override;
  const StreamedQuality& quality() const override { return options_; }
  void contextLost() override {
    renderer_.reset();
    drawn_.remove();
  }
  StreamedStats stats() const override;

 protected:
  using Piece = typename Types::Piece;
  using View = typename Types::View;

  const typename Types::Stream& stream() const { return stream_; }
  const std::vector<Piece>& pieces() const { return pieces_; }
  const typename Types::Count& count() const { return count_; }
  typename Types::Stream& stream() { return stream_; }
  const StreamedOptions& options() const { return options_; }
  const glm::dvec3& origin() const { return file_.origin(); }
  /// The tolerance of views at rest.
  float finestPx() const { return options_.*Types::kSize; }
  /// The light of the shadows on pieces(), as shadowLight() told it.
  const lod::hlod::ShadowLight& light() const { return light_; }
  /// The header is here.
  virtual View viewOf(const base::Camera& camera, const StreamedLook& look) const;

 private:
  /// Share of the memory, sixteenths, for pieces on the GPU. With the stream's they leave the rest to the samples of
  /// the picture (client/viewer/memory_plan.h).
  static constexpr std::uint64_t kGpuShare = 5;
  /// For each view at most what the link carries in this time is fetched ahead, seconds, and nothing over links slower
  /// than this, bytes a second. Choices (docs/results/hlod.md).
  static constexpr double kPrefetchSeconds = 0.5, kPrefetchRate = 250'000.0;
  /// A step of refinement at rest has about so many times the vertices of the one before (RateControl).
  static constexpr std::uint64_t kStepGrowth = 2;
  /// A picture of fewer vertices takes no less time than one of so many. A choice.
  static constexpr std::uint64_t kLeastWork = 50'000;

  /// Keeps the places of the piece that the ray meets.
  virtual void meet(RayHit& hit, const Piece& piece) const = 0;
  /// Adds the figures that no other method has, and the words for them.
  virtual void addFigures(StreamedStats& stats) const = 0;
  /// The light whose shadows a frame shows that rests, or one that moves. Its place is 0 where there are none.
  virtual lod::hlod::ShadowLight shadowLight(const StreamedLook& /*look*/, bool /*rests*/) const { return kNoShadows; }
  /// pieces() were found for the request and this light.
  virtual void piecesChosen(const typename Types::TraverseRequest& /*request*/) {}
  virtual base::Result<typename Types::Count> drawPieces(typename Types::Renderer& renderer, const View& view,
                                                         const typename Types::Target& target) {
    return renderer.draw(pieces_, view, target);
  }

  static StreamedOptions checked(StreamedOptions options) {
    options.*Types::kSize = std::max(options.*Types::kSize, Types::kMinSize);
    return options;
  }
  static typename Types::StreamOptions streamOptions(const StreamedOptions& options) {
    typename Types::StreamOptions stream;
    stream.memory_bytes = std::max(Types::streamBytes(options), Types::kMinMemory);
    stream.decode_per_frame = options.decode_per_frame;
    if constexpr (requires { stream.prefetch_bytes; }) {
      stream.prefetch_bytes = options.idle_bytes;
      stream.prefetch_seconds = kPrefetchSeconds;
      stream.prefetch_least_rate = kPrefetchRate;
    }
    return stream;
  }
  bool rests(const base::Camera& camera, const glm::vec4& light) const;
  void choose(std::uint32_t frames);
  bool beginFrame(const base::Camera& camera, const StreamedLook& look);
  void skipSteps(const base::Camera& camera, const StreamedLook& look);
  std::uint64_t vertices() const;
  /// The cost of a picture of pieces_, in vertices.
  double work() const { return static_cast<double>(std::max(vertices(), kLeastWork)); }
  base::Result<void> makeRenderer();
  base::Result<void> drawChosen(const base::Camera& camera, const StreamedLook& look);
  double now() const { return options_.clock ? options_.clock() : 0.0; }
  bool isRemote() const { return stream_.stats().requests > 0; }
  /// Whether requests are under way for a view that lacks something.
  bool moreIsComing() const { return !stream_.complete() && stream_.stats().under_way > 0; }
  /// Whether the last frame was so long ago that the next one may come before all requests are answered.
  bool hasRested() const { return !options_.clock || (!drawn_.isSet() && frames_.hasRested(now(), work())); }
  /// Whether pieces_ cover all of the model that the view sees, as coarse as they may be.
  bool isWhole() const { return Types::isWhole(stream_.stats(), pieces_.size()); }

  StreamedFile file_;
  StreamedOptions options_;
  typename Types::Stream stream_;
  MotionPace pace_;

  std::vector<Piece> pieces_;
  std::uint64_t chosen_generation_ = 0;  ///< generation of the stream when pieces_ was chosen
  bool chosen_ = false;
  bool moved_ = false;        ///< the last frame drawn was of a view that moved
  bool has_undrawn_ = false;  ///< pieces_ was chosen anew since the last update()
  base::Camera camera_;       ///< camera for which pieces_ was chosen; the next member belongs to that choice, too
  float size_px_ = 1.0F;
  lod::hlod::ShadowLight light_ = kNoShadows;
  bool awaits_rest_ = false;  ///< the view will have other shadows when it rests
  DutyCycle frames_;
  PictureFence drawn_;        ///< behind the last picture, while frames_ does not know its end
  double drawn_begin_ = 0.0;  ///< when that picture was begun
  double drawn_work_ = 0.0;   ///< work() of that picture
  bool drawn_whole_ = false;  ///< isWhole() of the last picture

  typename Types::Count count_;  ///< of the last drawing
  std::unique_ptr<typename Types::Renderer> renderer_;
};

template <class Types>
const base::Sphere* StreamedPieces<Types>::bounds() const {
  return stream_.header() != nullptr ? &stream_.header()->bounds : nullptr;
}

// ---- which pieces ----

template <class Types>
void StreamedPieces<Types>::update(const base::Camera& camera, const StreamedLook& look) {
  if (stream_.header() == nullptr) return;
  has_undrawn_ = false;
  const float size_px = pace_.wantedPx(finestPx());
  const lod::hlod::ShadowLight light_at_rest = shadowLight(look, true);
  const bool is_at_rest = size_px <= finestPx() && rests(camera, light_at_rest.place);
  const lod::hlod::ShadowLight light = is_at_rest ? light_at_rest : shadowLight(look, false);
  const bool same_view = chosen_ && base::sameCamera(camera, camera_) && size_px == size_px_ && light == light_;
  if (same_view && stream_.generation() == chosen_generation_ && !stream_.decoding()) return;
  if (same_view && moreIsComing() && !hasRested()) return;
  camera_ = camera;
  size_px_ = size_px;
  light_ = light;
  awaits_rest_ = light != light_at_rest;
  chosen_ = true;
  // A view that rests makes up for the frames in between, which are not drawn while requests are under way.
  choose(same_view && isRemote() ? 1 + DutyCycle::kRest : 1);
}

/// Whether the view does not move. Where every frame is as fine as at rest, none does.
template <class Types>
bool StreamedPieces<Types>::rests(const base::Camera& camera, const glm::vec4& light) const {
  return !pace_.isOn() || (!moved_ && pace_.isLastFrame(camera, light));
}

template <class Types>
void StreamedPieces<Types>::choose(std::uint32_t frames) {
  typename Types::TraverseRequest request;
  request.camera = camera_;
  request.tolerance = size_px_;
  chosen_generation_ = stream_.generation();
  stream_.update(request, pieces_, frames);
  piecesChosen(request);
}

/// Returns whether the view has moved. A first one that awaits its data has not: there is nothing yet to be drawn late.
template <class Types>
bool StreamedPieces<Types>::beginFrame(const base::Camera& camera, const StreamedLook& look) {
  const glm::vec4 light = shadowLight(look, true).place;
  const bool moved = pace_.beginFrame(camera, light);
  return moved && !chosen_ && isRemote() ? pace_.beginFrame(camera, light) : moved;
}

/// Steps of a view at rest that would only ask for other data than the last step does are passed over: what is here
/// makes no finer picture of them.
template <class Types>
void StreamedPieces<Types>::skipSteps(const base::Camera& camera, const StreamedLook& look) {
  const std::uint64_t most = kStepGrowth * vertices();
  while (!moved_ && isRemote() && size_px_ > finestPx() && !stream_.complete() && vertices() <= most) {
    pace_.beginFrame(camera, shadowLight(look, true).place);
    update(camera, look);
  }
}

template <class Types>
std::uint64_t StreamedPieces<Types>::vertices() const {
  std::uint64_t sum = 0;
  for (const Piece& piece : pieces_) sum += piece.picture->vertices.size();
  return sum;
}

template <class Types>
bool StreamedPieces<Types>::pump(Session& session, double now) {
  const bool came = file_.pump(stream_, session, now);
  if (drawn_.hasPassed()) frames_.record(drawn_begin_, this->now(), drawn_work_);
  // Between the frames of a view that rests, what comes is decoded while the link goes on.
  if (came && chosen_ && !moved_ && moreIsComing() && !hasRested()) {
    choose(1);
    has_undrawn_ = true;
    if (renderer_) renderer_->upload(pieces_);
  }
  return came;
}

// ---- drawing ----

template <class Types>
base::Result<void> StreamedPieces<Types>::draw(const base::Camera& camera, const StreamedLook& look) {
  const double begin = now();
  moved_ = beginFrame(camera, look);
  update(camera, look);
  skipSteps(camera, look);
  if (stream_.header() != nullptr) file_.sendRequests(stream_);  // the link goes on while the picture is drawn
  LUMIGRID_TRY(makeRenderer());
  const double begin_drawing = now();
  LUMIGRID_TRY(drawChosen(camera, look));
  drawn_.remove();
  drawn_whole_ = isWhole();
  if (stream_.header() == nullptr || !options_.clock) return {};
  if (moved_ && pace_.isOn()) {
    waitForGpu();
    const double end = now();
    frames_.record(begin, end, work());
    pace_.recordFrame(end - begin, count_.points + count_.triangles);
  } else if (moreIsComing()) {
    drawn_.set();
    drawn_begin_ = begin_drawing;
    drawn_work_ = work();
  }
  return {};
}

/// Makes the renderer when it is first needed.
template <class Types>
base::Result<void> StreamedPieces<Types>::makeRenderer() {
  if (renderer_ || stream_.header() == nullptr) return {};
  LUMIGRID_ASSIGN_OR_RETURN(renderer_, Types::Renderer::create(options_.memory_bytes / 16 * kGpuShare));
  return {};
}

template <class Types>
base::Result<void> StreamedPieces<Types>::drawChosen(const base::Camera& camera, const StreamedLook& look) {
  clearPicture(look.background);
  if (stream_.header() == nullptr) return {};
  GLint framebuffer = 0;
  glGetIntegerv(GL_FRAMEBUFFER_BINDING, &framebuffer);
  LUMIGRID_ASSIGN_OR_RETURN(count_, drawPieces(*renderer_, viewOf(camera, look),
                                               {static_cast<GLuint>(framebuffer), camera.width, camera.height}));
  return {};
}

template <class Types>
typename StreamedPieces<Types>::View StreamedPieces<Types>::viewOf(const base::Camera& camera,
                                                                   const StreamedLook& look) const {
  View view;
  view.camera = camera;
  view.shading = look.shading;
  view.resolution_colors = look.resolution_colors;
  return view;
}

template <class Types>
std::optional<glm::vec3> StreamedPieces<Types>::surfaceAt(const base::Camera& camera, double x, double y) const {
  RayHit hit{rayThrough(camera, x, y), camera.section};
  for (const Piece& piece : pieces_) meet(hit, piece);
  return hit.place();
}

template <class Types>
void StreamedPieces<Types>::setQuality(const StreamedQuality& quality) {
  static_cast<StreamedQuality&>(options_) = quality;
  options_ = checked(options_);
  pace_.setGoal(options_.frame_seconds, finestPx());
}

// ---- figures ----

template <class Types>
bool StreamedPieces<Types>::complete() const {
  return chosen_ && !has_undrawn_ && !awaits_rest_ && stream_.complete() &&
         chosen_generation_ == stream_.generation() && size_px_ <= finestPx();
}

template <class Types>
bool StreamedPieces<Types>::busy() const {
  if (!chosen_ || size_px_ > finestPx() || awaits_rest_) return chosen_;
  if (!has_undrawn_ && !stream_.decoding() && chosen_generation_ == stream_.generation()) return false;
  return !moreIsComing() || hasRested() || (isWhole() && !drawn_whole_);
}

template <class Types>
StreamedStats StreamedPieces<Types>::stats() const {
  StreamedStats stats;
  stats.drawn = count_.points + count_.triangles;
  stats.error_px = size_px_;
  stats.finest_px = finestPx();
  stats.limited = stream_.limitedByMemory();
  stats.buffer_bytes = renderer_ ? renderer_->gpuBytes() : 0;
  const auto stream = stream_.stats();
  stats.file_bytes = stream.memory_bytes;
  stats.bytes_received = stream.bytes_received;
  stats.requests = stream.requests;
  stats.present = stream.present;
  stats.lacking = stream.lacking;
  stats.broken = static_cast<std::uint32_t>(stream.damaged);
  stats.warning = stream_.warning();
  addFigures(stats);
  return stats;
}

}  // namespace client
