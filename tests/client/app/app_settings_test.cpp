// Tests settings that an App hands to its viewer, and those that links override.
#include "client/app/app.h"
#include "tests/client/app/scripted_app.h"

namespace client {
namespace {

TEST_F(AppTest, settingsSetTheViewersOptions) {
  Settings settings;
  settings.cache_megabytes = 64.0;
  settings.points = 4.0;
  settings.images = 0.0;
  settings.frames = 0.0;
  open(settings);
  EXPECT_EQ(app->viewer().options().session.cache_bytes, 64'000'000U);
  EXPECT_EQ(app->viewer().options().session.max_points, 4);
  EXPECT_FALSE(app->viewer().options().lumigraph.use_images);
  ASSERT_TRUE(bool(app->changeSetting("fov_degrees", 60.0)));
  EXPECT_NEAR(app->camera().fov_y, glm::radians(60.0), 1e-12);
  EXPECT_EQ(requests(RequestKind::kKeepSettings).size(), 1U);
  EXPECT_FALSE(bool(app->changeSetting("fov_degrees", 600.0)));
  EXPECT_TRUE(requests(RequestKind::kKeepSettings).empty());
}

/// Records the quality that it is given.
class PlainSplats final : public StreamedView {
 public:
  bool pump(Session&, double) override { return false; }
  const base::Sphere* bounds() const override { return nullptr; }
  void update(const base::Camera&, const StreamedLook&) override {}
  base::Result<void> draw(const base::Camera&, const StreamedLook&) override { return {}; }
  base::Camera drawnCamera() const override { return {}; }
  std::optional<glm::vec3> surfaceAt(const base::Camera&, double, double) const override { return std::nullopt; }
  bool isMultisampled() const override { return false; }
  bool complete() const override { return true; }
  bool busy() const override { return false; }
  void setQuality(const StreamedQuality& quality) override {
    quality_ = quality;
    ++times;
  }
  const StreamedQuality& quality() const override { return quality_; }
  void contextLost() override {}
  StreamedStats stats() const override { return {}; }

  int times = 0;

 private:
  StreamedQuality quality_{lod::draw::SplatKernel::kSquare, 3.0F, 0.5};  // as a command line may have set it
};

TEST_F(AppTest, settingsOfSplatsTakeEffectAtOnceAndKeepTheCommandLinesValues) {
  open({}, Method::kQsplat);
  const auto splats = std::make_shared<PlainSplats>();
  app->viewer().setStreamed(splats);
  EXPECT_EQ(splats->times, 0);
  ASSERT_TRUE(bool(app->changeSetting("cutoff", 2.0)));
  EXPECT_EQ(splats->quality(), (StreamedQuality{lod::draw::SplatKernel::kSquare, 2.0F, 0.5}));
  ASSERT_TRUE(bool(app->changeSetting("splat", 3.0)));
  ASSERT_TRUE(bool(app->changeSetting("frame_rate", 20.0)));
  EXPECT_EQ(splats->quality(), (StreamedQuality{lod::draw::SplatKernel::kEllipse, 2.0F, 0.05}));
  ASSERT_TRUE(bool(app->changeSetting("tolerance", 2.5)));
  EXPECT_EQ(splats->quality().tolerance, 2.5F);
  ASSERT_TRUE(bool(app->changeSetting("error_px", 0.25)));
  EXPECT_EQ(splats->quality().error_px, 0.25F);
  EXPECT_EQ(splats->times, 5);
  ASSERT_TRUE(bool(app->changeSetting("orbit_speed", 2.0)));
  ASSERT_TRUE(bool(app->changeSetting("frame_rate", 20.0)));
  EXPECT_EQ(splats->times, 5) << "nothing changed for them";
  for (const char* name : {"splat", "cutoff", "tolerance", "error_px", "frame_rate"})
    EXPECT_FALSE(findSetting(name)->from_next_start) << name;
}

TEST_F(AppTest, shadowsComeFromTheSettingUntilALinkNamesOthers) {
  using lod::hlod::Shadows;
  Settings settings;
  settings.shadows = 1.0;
  open(settings);
  EXPECT_EQ(app->view().shadows, Shadows::kNone) << "images have none";
  open(settings, Method::kHlod);
  const auto nodes = std::make_shared<PlainSplats>();
  app->viewer().setStreamed(nodes);
  app->contextLost();  // frames call no function of GL
  const auto frame = [&] { EXPECT_TRUE(bool(app->drawFrame(now += 0.05))); };
  welcome();
  frame();
  EXPECT_EQ(nodes->quality().shadows, Shadows::kHard);
  EXPECT_NE(app->permalink().find("&s=hard"), std::string::npos);
  ASSERT_TRUE(bool(app->changeSetting("shadows", 2.0)));
  EXPECT_TRUE(app->wantsFrame());
  frame();
  EXPECT_EQ(nodes->quality().shadows, Shadows::kSoft);
  EXPECT_EQ(nodes->times, 2);
  std::string link = app->permalink();
  link.erase(link.find("&s=soft"), 7);
  ASSERT_TRUE(bool(app->openPermalink(link)));
  frame();
  EXPECT_EQ(nodes->quality().shadows, Shadows::kNone);
  ASSERT_TRUE(bool(app->changeSetting("shadows", 2.0)));
  frame();
  EXPECT_EQ(nodes->quality().shadows, Shadows::kSoft) << "the setting was that before";
  EXPECT_FALSE(findSetting("shadows")->from_next_start);
}

}  // namespace
}  // namespace client
