#include "server/bake/face_maker.h"

#include <utility>

#include "base/parallel.h"

namespace server {
namespace {

class MadeHere : public FaceMaker {
 public:
  MadeHere(const FaceWork& work, unsigned threads, Take take, Fail fail, Encode encode)
      : quality_(work.quality),
        subsampling_(work.subsampling),
        take_(std::move(take)),
        fail_(std::move(fail)),
        encode_(std::move(encode)),
        encoders_(threads, std::size_t{2} * threads),
        draw_(
            work.scene, work.patches, work.grid, work.render, work.gpu_budget_bytes,
            [this](std::uint64_t sequence, const repository::FaceKey& key, RenderedPicture rendered) {
              this->encode(sequence, key, std::move(rendered));
            },
            fail_) {}

  void submit(DrawJob job) override { draw_.submit(std::move(job)); }
  void finish() override {
    draw_.finish();
    encoders_.drain();
  }

 private:
  void encode(std::uint64_t sequence, const repository::FaceKey& key, RenderedPicture rendered) {
    auto picture = std::make_shared<base::Image>(std::move(rendered.rgba));
    encoders_.submit([this, sequence, key, picture] {
      auto face = encode_(*picture, quality_, subsampling_);
      if (!face) return fail_(face.error());
      take_(sequence, key, std::move(*face));
    });
  }

  const int quality_;
  const repository::Subsampling subsampling_;
  const Take take_;
  const Fail fail_;
  const Encode encode_;
  base::ThreadPool encoders_;  // its jobs use the others, so it ends before them
  DrawThread draw_;            // … and this one before it
};

}  // namespace

std::unique_ptr<FaceMaker> makeFacesHere(const FaceWork& work, unsigned threads, FaceMaker::Take take,
                                         FaceMaker::Fail fail, Encode encode) {
  return std::make_unique<MadeHere>(work, threads, std::move(take), std::move(fail), std::move(encode));
}

}  // namespace server
