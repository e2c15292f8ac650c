#pragma once
// The members and private functions of client::Viewer: images on their way to the GPU (viewer_images.cpp), pins and
// splats (viewer_modes.cpp), everything else (viewer.cpp). Only these three files include it.
#include <memory>
#include <optional>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "client/viewer/memory_plan.h"
#include "client/viewer/pick.h"
#include "client/viewer/pins.h"
#include "client/viewer/resident_patches.h"
#include "client/viewer/viewer.h"

namespace client {

struct Viewer::Impl {
  /// Exact frames of the server get ids of their own beside the codes of faces (63 bits).
  static constexpr SampleId kFrameTag = SampleId{1} << 63U;
  /// Expected use below which an image does not matter for the present view: a thousandth of the picture.
  static constexpr float kNeededUse = 1e-3F;

  /// The state of an image on its way from the cache to the GPU.
  enum class ImageState {
    kCached,
    kDecoding,
    kDecoded,
    kResident,
    kEmpty,  ///< is an empty flag, or broken
    kUnfit,  ///< larger than its share of the budget
  };

  /// A face or an exact frame on its way to the GPU.
  struct BlendImage {
    ImageState state = ImageState::kCached;
    base::Camera camera;
    base::Image rgba;   // only while kDecoded
    float use = 0.0F;   // expected share of the blend in the present view
    float rank = 0.0F;  // use, and among the unused the nearer first
  };

  Impl(const ViewerOptions& wanted, const MemoryPlan& shares, std::unique_ptr<ImageDecoder> image_decoder)
      : options(wanted), plan(shares), session(wanted.session), decoder(std::move(image_decoder)) {}

  ViewerOptions options;
  MemoryPlan plan;
  Session session;
  std::unique_ptr<ImageDecoder> decoder;
  std::unique_ptr<LumigraphRenderer> renderer;
  bool context_lost = false;
  std::optional<Picker> picker;
  lod::draw::Shading shading;
  base::Sphere scene;
  std::optional<base::SectionPlane> section;

  std::unordered_map<SampleId, BlendImage> images;
  std::unordered_map<SampleId, std::uint64_t> decoding;  // id -> bytes, dropped images included
  std::vector<SampleId> ranked;                          // best first
  std::vector<SampleId> candidates;                      // the resident ones among them
  bool gpu_full = false;
  ResidentPatches patches;
  base::ViewCamera view;
  base::Camera camera;
  bool more_to_do = false;
  double upload_bytes_left = 0.0;
  std::uint32_t broken = 0;
  std::string last_fault;

  std::shared_ptr<SplatView> splats;  // for kQsplat; null until its link has them
  std::optional<lod::qsplat::Lens> lens;

  std::vector<glm::dvec3> pins;  // world
  std::optional<PinProbe> probe;
  std::vector<bool> pins_visible;
  std::uint64_t drawn_signature = 0;  // signature of the picture against which the pins were tested

  base::Result<void> startScene();
  base::Result<void> startRenderer();
  base::Result<void> takeEvents();
  void addFace(const repository::FaceKey& key);
  void addFrame(std::uint32_t sequence);
  void dropImage(SampleId id);
  void dropOldFrames();
  void takeDecoded();
  void updatePatches();
  void rankImages();
  void uploadImages(double now);
  bool makeRoomFor(const BlendImage& image);
  const BlendImage* worstResident(SampleId* id, const base::Camera* of_size_like) const;
  void submitImages();
  void markInUse();
  base::Result<void> startPins();
  void probePins();
  std::uint64_t pictureSignature() const;
  bool showsSplats() const { return options.method == Method::kQsplat; }
  bool hasSplats() const { return splats && splats->bounds() != nullptr && session.welcome() != nullptr; }
  SplatLook splatLook() const;
  void addSplats(ViewerStats& stats) const;
  base::Result<bool> setSplatView(const base::ViewCamera& wanted);
  base::Result<void> updateSplats(const base::ViewCamera& wanted);
  base::Result<void> drawSplats(const base::ViewCamera& wanted);
  base::Camera cameraAt(const base::ViewCamera& wanted) const {
    return base::cameraForScene(wanted, session.welcome()->origin, scene);
  }
  base::ViewCamera viewForServer(const base::ViewCamera& wanted) const;
  glm::vec4 sectionHere() const;
  const base::Bytes* codedImage(SampleId id);
  void fault(const std::string& problem);
  bool spend(double bytes);
  MemoryUse memory() const;
  std::uint64_t waitingBytes() const;
  bool showsExactFrame() const;
  Accuracy accuracy() const;
  double last_draw = 0.0;
};

}  // namespace client
