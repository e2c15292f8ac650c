#include "server/bake/face_maker.h"

#include <utility>
#include <vector>

#include "base/parallel.h"

namespace server {
namespace {

class LocalFaceMaker : public FaceMaker {
 public:
  LocalFaceMaker(const FaceWork& work, unsigned threads, OnFace on_face, OnError on_error, Encode encode)
      : work_(work),
        on_face_(std::move(on_face)),
        on_error_(std::move(on_error)),
        encode_(std::move(encode)),
        encoders_(threads, std::size_t{2} * threads),
        draw_(
            work,
            [this](std::uint64_t sequence, const repository::FaceKey& key, RenderedPicture rendered) {
              this->encode(sequence, key, std::move(rendered));
            },
            on_error_) {}

  void submit(DrawJob job) override { draw_.submit(std::move(job)); }
  void finish() override {
    draw_.finish();
    encoders_.drain();
  }

 private:
  void encode(std::uint64_t sequence, const repository::FaceKey& key, RenderedPicture rendered) {
    auto picture = std::make_shared<base::Image>(std::move(rendered.rgba));
    encoders_.submit([this, sequence, key, picture] {
      FaceCoding coding{work_.quality, work_.subsampling, drawnDepth(work_, key), work_.codec};
      std::vector<std::uint32_t> wanted;
      if (work_.tiles != nullptr) {
        wanted = work_.tiles->ofFace(key);
        coding.wanted = &wanted;
      }
      auto face = encode_(*picture, coding);
      if (!face) return on_error_(face.error());
      on_face_(sequence, key, std::move(*face));
    });
  }

  const FaceWork work_;
  const OnFace on_face_;
  const OnError on_error_;
  const Encode encode_;
  base::ThreadPool encoders_;  // its jobs use the others, so it ends before them
  DrawThread draw_;            // … and this one before it
};

}  // namespace

std::unique_ptr<FaceMaker> makeLocalFaceMaker(const FaceWork& work, unsigned threads, FaceMaker::OnFace on_face,
                                              FaceMaker::OnError on_error, Encode encode) {
  return std::make_unique<LocalFaceMaker>(work, threads, std::move(on_face), std::move(on_error), std::move(encode));
}

}  // namespace server
