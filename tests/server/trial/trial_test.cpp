#include "server/trial/trial.h"

#include <gtest/gtest.h>

#include "tests/support/failure_meshes.h"
#include "tests/support/made_scene.h"
#include "tests/support/mesh_reader.h"
#include "tests/support/temporary_directory.h"

namespace server {
namespace {

class TrialOfMethods : public testing::Test {
 protected:
  /// Tries the methods on a scene of this mesh, with a grid of 5 and faces of 256.
  base::Result<Trial> tryOn(const support::Mesh& mesh) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto scene, support::makeScene(mesh, directory_.path()));
    LUMIGRID_ASSIGN_OR_RETURN(const auto patches, lod::patch::PatchFile::open(directory_ / "patch.lgp"));
    BakeOptions options;
    options.grid = support::gridOf(scene, {.points = 5});
    return tryMethods(scene, patches, options, [this](double done) {
      EXPECT_GE(done, progress_);
      progress_ = done;
      return !stop_;
    });
  }

  const support::TemporaryDirectory directory_;
  double progress_ = 0.0;
  bool stop_ = false;
};

TEST_F(TrialOfMethods, aSmoothModelWithoutColoursGetsNoImages) {
  mesh::generate::SampleOptions sample;
  sample.triangles = 50'000;
  sample.colors = false;
  const auto trial = tryOn(support::makeSample(sample));
  ASSERT_TRUE(trial) << trial.error().message;
  EXPECT_EQ(trial->views, 10U);
  EXPECT_FALSE(trial->imagesPay()) << trial->gainDb();
  EXPECT_GT(trial->patches.mean_psnr_db, 35.0);
  EXPECT_GT(trial->images.mean_psnr_db, 35.0) << "they are no worse either";
  EXPECT_LT(trial->patches.worst_psnr_db, trial->patches.mean_psnr_db);
  EXPECT_LT(trial->patches.bytes, trial->images.bytes);
  EXPECT_GT(progress_, 0.9);
}

// Pictures of a scan with many triangles a pixel are smoother than triangles drawn with one sample a pixel.
TEST_F(TrialOfMethods, aScanFinerThanItsPixelsGetsImages) {
  mesh::generate::SampleOptions sample;
  sample.triangles = 500'000;
  sample.shape = mesh::generate::SampleShape::kRelief;
  const auto trial = tryOn(support::makeSample(sample));
  ASSERT_TRUE(trial) << trial.error().message;
  EXPECT_TRUE(trial->imagesPay()) << trial->gainDb();
  EXPECT_GT(trial->gainDb(), 1.0);
}

// Patches are refined for their colours, so vertices show what a face of that size shows, and no edge is blurred.
TEST_F(TrialOfMethods, coloursThatVerticesShowGetNoImages) {
  const auto trial = tryOn(support::speckledPlate());
  ASSERT_TRUE(trial) << trial.error().message;
  EXPECT_FALSE(trial->imagesPay()) << trial->gainDb();
}

TEST_F(TrialOfMethods, stopsWhenAsked) {
  stop_ = true;
  const auto trial = tryOn(support::bumpySphere(40, 80, 0.05F));
  ASSERT_FALSE(trial);
  EXPECT_EQ(trial.error().code, base::ErrorCode::kCancelled);
}

}  // namespace
}  // namespace server
