#include <algorithm>
#include <cmath>

#include "client/render/pixel_blend.h"
#include "tests/client/render/lumigraph_fixture.h"

namespace {

using namespace testing_scene;  // NOLINT: only these tests use it

Color constant(const glm::vec3& color) {
  return [color](const glm::vec3&) { return color; };
}
const Color kRed = constant({0.9F, 0.05F, 0.05F});
const Color kGreen = constant({0.05F, 0.8F, 0.05F});

TEST_F(Lumigraph, aViewAtASamplingPointShowsItsFace) {
  makeBall();
  addCube(kEye, 0);
  addCube(kEye + glm::vec3(1.0F, 0.3F, 0.0F), 10);
  const base::Camera camera = cubeCameras(kEye, kFace)[2];
  const base::Image face = castRays(scene_, camera);
  const base::Image drawn = draw(camera);
  EXPECT_GE(psnrOnCovered(face, drawn), 40.0);
  EXPECT_GE(coverageOverlap(face, drawn), 0.99);
}

TEST_F(Lumigraph, noSeamShowsWhereTheFacesOfAPointMeet) {
  // The edge between the faces +x and +y runs through the middle of the picture.
  makeBall();
  const glm::vec3 eye(-1.5F, -1.5F, 0.0F);
  addCube(eye, 0);
  const base::Camera camera = lookAt(eye, glm::vec3(0.0F), 200, 200, 60.0F);
  EXPECT_GE(psnrOnCovered(castRays(scene_, camera), draw(camera)), 38.0);
}

TEST_F(Lumigraph, viewsBetweenSamplingPointsAreBlended) {
  makeBall();
  addCube({-0.5F, -3.0F, 0.0F}, 0);
  addCube({0.7F, -2.8F, 0.2F}, 10);
  const base::Camera camera = lookAt(kEye, glm::vec3(0.0F), 200, 200, 50.0F);
  const base::Image truth = castRays(scene_, camera);
  options_.use_images = false;
  const double shaded = psnrOnCovered(truth, draw(camera));
  options_.use_images = true;
  EXPECT_GE(psnrOnCovered(truth, draw(camera)), std::max(32.0, shaded + 3.0));
}

TEST_F(Lumigraph, orthographicViewsAreBlendedFromTheSamePerspectiveImages) {
  makeBall();
  addCube({-0.5F, -3.0F, 0.0F}, 0);
  addCube({0.7F, -2.8F, 0.2F}, 10);
  for (const glm::vec3& eye : {kEye, glm::vec3(0.0F, -30.0F, 0.0F), glm::vec3(0.0F, -0.1F, 0.0F)}) {
    const base::Camera camera = lookAlong(eye, glm::vec3(0.0F), 200, 200, 2.4F);
    const base::Image truth = castRays(scene_, camera);
    const base::Image drawn = draw(camera);
    EXPECT_GE(psnrOnCovered(truth, drawn), 28.0) << "wherever along the axis the viewer stands";
    EXPECT_GE(coverageOverlap(truth, drawn), 0.98);
    // A ball of radius 1 in a picture 2.4 high is 200 × 2 / 2.4 pixels wide.
    EXPECT_EQ(pixel(drawn, 100 - 82, 100).w, 255);
    EXPECT_EQ(pixel(drawn, 100 - 85, 100).w, 0);
  }
}

TEST_F(Lumigraph, anOrthographicFarViewLooksLikeAPerspectiveOneFromAfar) {
  makeBall();
  addCube({-0.5F, -3.0F, 0.0F}, 0);
  addCube({0.7F, -2.8F, 0.2F}, 10);
  base::ViewCamera view;
  view.position = {0.0, -200.0, 0.0};
  view.direction = {0.0, 1.0, 0.0};
  view.up = {0.0, 0.0, 1.0};
  view.fov_y = 2.0 * std::atan(1.2 / 200.0);
  view.width = view.height = 200;
  const base::Image far = draw(base::cameraForScene(view, glm::dvec3(0.0), {glm::vec3(0.0F), 1.5F}));
  view.ortho_height = 2.4;
  const base::Image parallel = draw(base::cameraForScene(view, glm::dvec3(0.0), {glm::vec3(0.0F), 1.5F}));
  EXPECT_GE(psnrOnCovered(far, parallel), 36.0) << "rays differ by up to 6 mrad, and so do the images' weights";
  EXPECT_GE(coverageOverlap(far, parallel), 0.98);
}

TEST_F(Lumigraph, aSectionShowsTheInsideOfWhatItCutsOpen) {
  makeBall();
  addCube(kEye, 0);
  base::Camera camera = lookAlong(kEye, glm::vec3(0.0F), 200, 200, 2.4F);
  const base::Image whole = draw(camera);
  camera.section = {0.0F, -1.0F, 0.0F, 0.0F};  // the viewer's half goes
  const base::Image open = draw(camera);
  EXPECT_EQ(coverageOverlap(whole, open), 1.0) << "a half ball has the ball's outline";
  for (const glm::ivec2 at : {glm::ivec2(100, 100), glm::ivec2(60, 100), glm::ivec2(100, 150)})
    EXPECT_EQ(pixel(open, at.x, at.y), opaque(lod::draw::kSectionColor));
  EXPECT_NE(pixel(whole, 100, 100), opaque(lod::draw::kSectionColor));
}

TEST_F(Lumigraph, aSectionLeavesTheOtherSideAsItWas) {
  makeBall();
  addCube(kEye, 0);
  base::Camera camera = lookAlong(kEye, glm::vec3(0.0F), 200, 200, 2.4F);
  const base::Image whole = draw(camera);
  camera.section = {0.0F, 0.0F, 1.0F, 0.1F};  // above 0.1, which is row 100 − 0.1 × 200 / 2.4 = 91.7
  const base::Image cut = draw(camera);
  for (int x = 0; x < 200; x += 3) {
    EXPECT_EQ(pixel(cut, x, 89).w, 0) << x;
    EXPECT_EQ(pixel(cut, x, 95), pixel(whole, x, 95)) << x;
    EXPECT_EQ(pixel(cut, x, 160), pixel(whole, x, 160)) << x;
  }
  camera.section = {0.0F, 0.0F, 1.0F, 5.0F};
  EXPECT_EQ(draw(camera).pixels, whole.pixels) << "a plane beyond the model cuts nothing";
  camera.section = {0.0F, 0.0F, 1.0F, -5.0F};
  EXPECT_EQ(coverageOverlap(draw(camera), whole), 0.0) << "nothing is left";
}

TEST_F(Lumigraph, doesNotProjectImagesOnSurfacesThatASectionUncovers) {
  // Images show a red ball. In it, uncovered by the cut, is one whose proxy is white.
  scene_.balls = {{glm::vec3(0.0F), 1.0F, kRed}};
  addPatch(ballPatch(glm::vec3(0.0F), 1.0F, 60, kWhite));
  addPatch(ballPatch(glm::vec3(0.0F), 0.4F, 30, kWhite));
  addCube(kEye, 0);
  base::Camera camera = lookAt(kEye, glm::vec3(0.0F), 200, 200, 50.0F);
  EXPECT_EQ(pixel(draw(camera), 100, 100), pixel(castRays(scene_, camera), 100, 100));
  camera.section = {0.0F, -1.0F, 0.0F, 0.6F};
  const base::Image cut = draw(camera);
  EXPECT_EQ(pixel(cut, 100, 100), glm::ivec4(255)) << "unlit white";
  EXPECT_EQ(pixel(cut, 100, 130), opaque(lod::draw::kSectionColor)) << "the far wall, from within";
}

TEST_F(Lumigraph, aFrameDrawnWithTheSectionShowsWhatItUncovers) {
  // The frame shows the green ball that the cut uncovers within the red one, from a little aside.
  addPatch(ballPatch(glm::vec3(0.0F), 1.0F, 60, kWhite));
  addPatch(ballPatch(glm::vec3(0.0F), 0.4F, 30, kWhite));
  base::Camera camera = lookAt(kEye, glm::vec3(0.0F), 200, 200, 50.0F);
  camera.section = {0.0F, -1.0F, 0.0F, 0.6F};
  base::Camera frame = lookAt(kEye + glm::vec3(0.2F, 0.0F, 0.0F), glm::vec3(0.0F), 200, 200, 50.0F);
  frame.section = camera.section;
  scene_.balls = {{glm::vec3(0.0F), 0.4F, kGreen}};
  addImage(7, frame);
  EXPECT_EQ(pixel(draw(camera), 100, 100), pixel(castRays(scene_, camera), 100, 100));
  renderer_->removeSample(7);
  frame.section = base::kNoSection;
  addImage(7, frame);
  EXPECT_EQ(pixel(draw(camera), 100, 100), glm::ivec4(255)) << "where the front hides it, an image does not show it";
}

TEST_F(Lumigraph, coloursByResolutionSayHowCoarseThePatchesAre) {
  // Three white rectangles side by side, whose patches are 0.5, 3 and 20 pixels off.
  for (int i = 0; i < 3; ++i)
    addPatch(rectanglePatch({glm::vec3(0.7F * static_cast<float>(i - 1), 0.0F, 0.0F),
                             glm::vec3(0.3F, 0.0F, 0.0F),
                             glm::vec3(0.0F, 0.0F, 0.3F),
                             kRed,
                             {}},
                            4, kWhite));
  errors_px_ = {0.5F, 3.0F, 20.0F};
  options_.modes.resolution_colors = true;
  const base::Camera camera = lookAlong(kEye, glm::vec3(0.0F), 240, 80, 0.8F);
  const base::Image image = draw(camera);
  EXPECT_EQ(pixel(image, 50, 40), opaque(lod::draw::kResolutionLegend[0].color));
  EXPECT_EQ(pixel(image, 120, 40), opaque(lod::draw::kResolutionLegend[2].color));
  EXPECT_EQ(pixel(image, 190, 40), opaque(lod::draw::kResolutionLegend[4].color));
}

TEST_F(Lumigraph, coloursByResolutionSayHowCoarseTheImagesAre) {
  // A white wall seen straight on, by an image from where the viewer stands: of the view's size, and of a tenth of it.
  scene_.rectangles = {
      {glm::vec3(0.0F), glm::vec3(1.0F, 0.0F, 0.0F), glm::vec3(0.0F, 0.0F, 1.0F), constant(glm::vec3(1.0F)), {}}};
  addPatch(rectanglePatch(scene_.rectangles[0], 8, kWhite));
  errors_px_ = {20.0F};
  options_.modes.resolution_colors = true;
  const base::Camera camera = lookAt(kEye, glm::vec3(0.0F), 160, 160, 30.0F);
  addImage(0, lookAt(kEye, glm::vec3(0.0F), 160, 160, 30.0F));
  EXPECT_EQ(pixel(draw(camera), 80, 80), opaque(lod::draw::kResolutionLegend[0].color));
  renderer_->removeSample(0);
  addImage(1, lookAt(kEye, glm::vec3(0.0F), 16, 16, 30.0F));
  EXPECT_EQ(pixel(draw(camera), 80, 80), opaque(lod::draw::kResolutionLegend[4].color));
  renderer_->removeSample(1);
  addImage(2, lookAt(kEye, glm::vec3(0.0F), 50, 50, 30.0F));
  EXPECT_EQ(pixel(draw(camera), 80, 80), opaque(lod::draw::kResolutionLegend[2].color)) << "3.2 pixels";
}

TEST_F(Lumigraph, coloursByDisagreementShowWhereImagesContradictEachOther) {
  // A white wall; the second image shows a dark one.
  scene_.rectangles = {
      {glm::vec3(0.0F), glm::vec3(1.0F, 0.0F, 0.0F), glm::vec3(0.0F, 0.0F, 1.0F), constant(glm::vec3(1.0F)), {}}};
  addPatch(rectanglePatch(scene_.rectangles[0], 8, kWhite));
  options_.show_disagreement = true;
  const base::Camera camera = lookAt(kEye, glm::vec3(0.0F), 160, 160, 30.0F);
  const base::Camera beside = lookAt(kEye + glm::vec3(0.5F, 0.0F, 0.0F), glm::vec3(0.0F), 160, 160, 30.0F);
  const base::Camera opposite = lookAt(kEye - glm::vec3(0.5F, 0.0F, 0.0F), glm::vec3(0.0F), 160, 160, 30.0F);
  addImage(0, beside);
  addImage(1, opposite);
  EXPECT_EQ(pixel(draw(camera), 80, 80), opaque(lod::draw::kResolutionLegend[0].color)) << "they agree";
  renderer_->removeSample(1);
  scene_.rectangles[0].color = constant(glm::vec3(0.5F));
  addImage(1, opposite);
  const glm::ivec4 tint = pixel(draw(camera), 80, 80);
  const auto& agreeing = lod::draw::kResolutionLegend[0].color;
  EXPECT_GT(tint.r * agreeing[2], 2 * tint.b * agreeing[0]) << "another hue: by more than they are expected to err";
}

TEST_F(Lumigraph, fewPointsAPatchBlendItsBestImages) {
  // The wall is white to the nearest image and grey to two others.
  scene_.rectangles = {
      {glm::vec3(0.0F), glm::vec3(1.0F, 0.0F, 0.0F), glm::vec3(0.0F, 0.0F, 1.0F), constant(glm::vec3(1.0F)), {}}};
  addPatch(rectanglePatch(scene_.rectangles[0], 8, kWhite));
  const base::Camera camera = lookAt(kEye, glm::vec3(0.0F), 160, 160, 30.0F);
  addImage(0, lookAt(kEye + glm::vec3(0.3F, 0.0F, 0.0F), glm::vec3(0.0F), 160, 160, 30.0F));
  scene_.rectangles[0].color = constant(glm::vec3(0.9F));
  for (const float x : {-1.0F, 1.0F})
    addImage(x < 0.0F ? 1 : 2, lookAt(kEye + glm::vec3(x, 0.0F, 0.0F), glm::vec3(0.0F), 160, 160, 30.0F));
  EXPECT_LT(pixel(draw(camera), 80, 80).r, 252);
  options_.max_points_a_patch = 1;
  EXPECT_GE(pixel(draw(camera), 80, 80).r, 254);
}

// An image from aside says that a wall is darker than its proxy. Half of the proxy is even, the other half is not, and
// its error is that of both.
TEST_F(Lumigraph, aProxyIsBelievedMoreWhereItsColoursAreEven) {
  const Rectangle wall{
      glm::vec3(0.0F), glm::vec3(1.0F, 0.0F, 0.0F), glm::vec3(0.0F, 0.0F, 1.0F), constant(glm::vec3(0.92F)), {}};
  scene_.rectangles = {wall};
  lod::patch::PatchGeometry proxy = rectanglePatch(wall, 40, kWhite);
  std::int64_t middle = 0;
  for (const glm::ivec3& position : proxy.positions) middle += position.x;
  middle /= static_cast<std::int64_t>(proxy.positions.size());
  for (std::size_t i = 0; i < proxy.positions.size(); ++i)
    if (proxy.positions[i].x > middle && i % 2 == 0) proxy.colors[i] = {225, 225, 225, 255};
  addPatch(proxy);
  addImage(0, lookAt(kEye + glm::vec3(0.5F, 0.0F, 0.0F), glm::vec3(0.0F), 160, 160, 30.0F));
  options_.tuning.shade_weight = client::BlendTuning{}.shade_weight;
  options_.tuning.agreement = 0.0F;  // a single image would be believed
  const base::Camera camera = lookAt(kEye, glm::vec3(0.0F), 160, 160, 30.0F);
  /// Means of red left and right of the middle.
  const auto halves = [&](float error, float even_error) {
    proxy_errors_ = {{0.001F, error}};
    options_.tuning.even_error = even_error;
    const base::Image image = draw(camera);
    EXPECT_TRUE(renderer_->stats().blended_once);
    double sums[2] = {};
    for (int y = 60; y < 100; ++y)
      for (int x = 0; x < 40; ++x) sums[0] += image.at(35 + x, y)[0], sums[1] += image.at(85 + x, y)[0];
    return std::array{sums[0] / 1600.0, sums[1] / 1600.0};
  };
  const auto alike = halves(0.04F, 1.0F), even = halves(0.04F, 0.5F);
  EXPECT_LT(alike[0], 238.0) << "near the image's 235";
  EXPECT_GT(even[0], alike[0] + 10.0);
  EXPECT_NEAR(even[1], alike[1], 1.0) << "where the proxy's colours differ by as much as they err";
}

// All triangles of a painted wall may lack what is painted on it.
TEST_F(Lumigraph, aProxyOfWideTrianglesIsNotBelievedForItsOneColour) {
  const Rectangle wall{
      glm::vec3(0.0F), glm::vec3(1.0F, 0.0F, 0.0F), glm::vec3(0.0F, 0.0F, 1.0F), constant(glm::vec3(0.92F)), {}};
  scene_.rectangles = {wall};
  addPatch(rectanglePatch(wall, 4, kWhite));
  addImage(0, lookAt(kEye + glm::vec3(0.5F, 0.0F, 0.0F), glm::vec3(0.0F), 320, 320, 30.0F));
  options_.tuning.shade_weight = client::BlendTuning{}.shade_weight;
  proxy_errors_ = {{0.001F, 0.08F}};
  EXPECT_LT(pixel(draw(lookAt(kEye, glm::vec3(0.0F), 160, 160, 30.0F)), 80, 80).r, 242);
}

// A ball before a wall and beside a thin wire, in triangles smaller than a pixel.
TEST_F(Lumigraph, pixelsThatAreBlendedOnceLookLikeFragmentsThatAreBlendedEach) {
  makeBall(1.0F, 200);
  const Rectangle wall{{0, 3, 0}, {4, 0, 0}, {0, 0, 4}, pattern, {}};
  const Rectangle wire{{1.4F, -0.5F, 0}, {0.01F, 0, 0}, {0, 0, 1.5F}, kRed, {}};
  scene_.rectangles = {wall, wire};
  addPatch(rectanglePatch(wall, 60, kWhite));
  addPatch(rectanglePatch(wire, 20, {230, 13, 13, 255}));
  addCube(kEye, 0);
  addCube(kEye + glm::vec3(0.8F, -0.5F, 0.3F), 10);
  const base::Camera camera = lookAt({0.3F, -3.4F, 0.2F}, glm::vec3(0.0F), 160, 120, 60.0F);
  options_.tuning.shade_weight = client::BlendTuning{}.shade_weight;
  options_.tuning.even_error = 1.0F;  // fragments know nothing of the pixels beside theirs
  const auto both = [&](auto&& picture) {
    options_.blend_once = true;
    const base::Image once = picture();
    EXPECT_TRUE(renderer_->stats().blended_once);
    options_.blend_once = false;
    const base::Image each = picture();
    EXPECT_FALSE(renderer_->stats().blended_once);
    EXPECT_GE(coverageOverlap(each, once), 0.999);
    return psnrOnCovered(each, once);
  };
  EXPECT_GE(both([&] { return draw(camera); }), 40.0) << "but for the rounding of normals";
  EXPECT_GE(both([&] { return drawMultisampled(camera); }), 34.0)
      << "places that no middle of a pixel shows are shaded";
}

// Each image shows a ninth of a patch that fills the picture.
TEST_F(Lumigraph, eachPartOfALargePatchHasTheImagesThatShowIt) {
  const Rectangle wall{{0, 1, 0}, {3, 0, 0}, {0, 0, 3}, pattern, {}};
  scene_.rectangles = {wall};
  addPatch(rectanglePatch(wall, 40, kWhite));
  for (int i = 0; i < 9; ++i) {
    const glm::vec3 target(1.2F * static_cast<float>(i % 3 - 1), 1.0F, 1.2F * static_cast<float>(i / 3 - 1));
    addImage(static_cast<SampleId>(i), lookAt({0.0F, -2.0F, 0.0F}, target, 96, 96, 25.0F));
  }
  options_.tuning.even_error = 1.0F;
  const base::Camera camera = lookAt({0.2F, -2.2F, 0.1F}, {0, 1, 0}, 240, 240, 60.0F);
  const base::Image once = draw(camera);
  EXPECT_TRUE(renderer_->stats().blended_once);
  options_.blend_once = false;
  const base::Image each = draw(camera);
  EXPECT_FALSE(renderer_->stats().blended_once);
  EXPECT_GE(psnrOnCovered(each, once), 40.0) << "but for the rounding of normals";
  options_.use_images = false;
  EXPECT_LT(psnrOnCovered(each, draw(camera)), 20.0);
}

TEST_F(Lumigraph, tintsNeedEachFragmentAndGiveTheMemoryBack) {
  makeBall();
  addCube(kEye, 0);
  const base::Camera camera = lookAt({0.3F, -3.4F, 0.2F}, glm::vec3(0.0F), 160, 120, 60.0F);
  draw(camera);
  const std::uint64_t with = renderer_->heldBytes().textures;
  options_.modes.resolution_colors = true;
  draw(camera);
  EXPECT_FALSE(renderer_->stats().blended_once);
  EXPECT_EQ(with - renderer_->heldBytes().textures,
            LumigraphRenderer::bytesToBlendOnce(160, 120) - LumigraphRenderer::bytesToBlendOnce(1, 1));
}

TEST_F(Lumigraph, imagesCoarserThanTheProxyDoNotBlurIt) {
  // The only image has 40 × 40 pixels and is four times as far away as the eye; the ball's proxy (white) has triangles
  // of a few pixels.
  makeBall();
  addImage(0, lookAt({6.0F, -10.0F, 0.0F}, glm::vec3(0.0F), 40, 40, 60.0F));
  const base::Camera camera = lookAt(kEye, glm::vec3(0.0F), 200, 200, 50.0F);
  options_.use_images = false;
  const base::Image shaded = draw(camera);
  options_.use_images = true;
  const double images_alone = psnrOnCovered(shaded, draw(camera));
  options_.tuning.shade_weight = client::BlendTuning{}.shade_weight;
  EXPECT_GE(psnrOnCovered(shaded, draw(camera)), std::max(30.0, images_alone + 10.0));
}

TEST_F(Lumigraph, trianglesSmallerThanAPixelKeepTheirColoursUnderSeveralSamples) {
  // Vertices are black or white in no order, and a third of a pixel apart.
  lod::patch::PatchGeometry patch = rectanglePatch({{0, 0, 0}, {0.3F, 0, 0}, {0, 0, 0.3F}, kRed, {}}, 180, kWhite);
  std::uint32_t state = 1;
  for (glm::u8vec4& color : patch.colors) {
    state = state * 1664525U + 1013904223U;
    color = state >> 31U != 0 ? kWhite : glm::u8vec4(0, 0, 0, 255);
  }
  addPatch(patch);
  const auto camera = [](int times) { return lookAlong(kEye, glm::vec3(0.0F), 60 * times, 60 * times, 0.5F); };
  const base::Image fine = draw(camera(8));
  base::Image mean(60, 60, 4);
  for (int y = 0; y < 60; ++y)
    for (int x = 0; x < 60; ++x)
      for (int c = 0; c < 4; ++c) {
        int sum = 0;
        for (int i = 0; i < 64; ++i) sum += fine.at(8 * x + i % 8, 8 * y + i / 8)[c];
        mean.at(x, y)[c] = static_cast<std::uint8_t>(sum / 64);
      }
  const double one_sample = psnrOnCovered(mean, draw(camera(1)));

  EXPECT_GE(psnrOnCovered(mean, drawMultisampled(camera(1))), one_sample + 5.0);
}

TEST_F(Lumigraph, aWallAtASlantShowsTheMeanOfWhatItsPixelsCover) {
  // Grey stripes of 5 texels of the only image, which looks straight at them. At a slant of 60 degrees each still spans
  // 2.5 pixels; at 80 degrees a pixel covers almost three.
  const auto stripes = [](const glm::vec3& p) { return glm::vec3(0.5F + 0.3F * std::sin(230.0F * p.x)); };
  scene_.rectangles = {{{}, {1.0F, 0.0F, 0.0F}, {0.0F, 0.0F, 1.0F}, stripes, {}}};
  addPatch(rectanglePatch(scene_.rectangles[0], 8, kWhite));
  proxy_errors_ = {{-1.0F, 0.2F}};  // a texture is all that it lacks
  addImage(0, lookAt(kEye, glm::vec3(0.0F), 400, 400, 40.0F));
  const auto psnrAt = [&](float degrees, int pixels) {
    const float slant = glm::radians(degrees);
    const glm::vec3 eye{3.0F * std::sin(slant), -3.0F * std::cos(slant), 0.4F};
    const base::Camera camera = lookAt(eye, glm::vec3(0.0F), pixels, pixels, 40.0F);
    return psnrOnCovered(castRays(scene_, camera, 8), draw(camera));
  };
  EXPECT_GE(psnrAt(60.0F, 400), 32.0);
  EXPECT_GE(psnrAt(80.0F, 160), 25.0);
}

TEST_F(Lumigraph, anImageCountsForLessTheMoreItsCodingErrs) {
  makeBall();
  proxy_errors_ = {{0.001F, 0.002F}};  // so little that images differ by their coding alone
  const base::Camera camera = lookAt(kEye, glm::vec3(0.0F), 120, 120, 30.0F);
  const base::Image truth = castRays(scene_, camera);
  addImage(0, lookAt({-0.1F, -3.0F, 0.0F}, glm::vec3(0.0F), kFace, kFace, 50.0F));
  scene_.balls[0].color = kGreen;
  const base::Camera other = lookAt({0.1F, -3.0F, 0.0F}, glm::vec3(0.0F), kFace, kFace, 50.0F);
  const base::Image wrong = castRays(scene_, other);
  double last = 0.0;
  for (const float error : {0.0F, 0.03F, 0.07F}) {
    EXPECT_TRUE(renderer_->addSample(1, other, wrong, 0.0, {.coding_error = error}));
    const double now = psnrOnCovered(truth, draw(camera));
    EXPECT_GT(now, last + 6.0) << error;
    last = now;
  }
  EXPECT_GE(last, 30.0);
}

TEST_F(Lumigraph, anExactFrameAtItsOwnViewIsReproduced) {
  makeBall();
  addCube({-0.5F, -3.0F, 0.0F}, 0);
  addCube({0.7F, -2.8F, 0.2F}, 10);
  const base::Camera camera = lookAt(kEye, {0.3F, 0.0F, 0.1F}, 300, 170, 30.0F);
  addImage(99, camera);
  EXPECT_GE(psnrOnCovered(castRays(scene_, camera), draw(camera)), 40.0);
}

class Occluder : public Lumigraph {
 protected:
  // A red square before a green wall; the sample sees it from the left, the viewer from the right.
  void SetUp() override {
    Lumigraph::SetUp();
    show({{0, 1, 0}, {3, 0, 0}, {0, 0, 3}, kGreen, {}}, {{0, 0, 0}, {0.4F, 0, 0}, {0, 0, 0.4F}, kRed, {}});
    addImage(0, lookAt({-1.5F, -2.0F, 0.0F}, {0, 0, 0}, kFace, kFace, 90.0F));
    camera_ = lookAt({1.0F, -2.5F, 0.0F}, {0, 0, 0}, 240, 240, 60.0F);
  }
  void show(const Rectangle& wall, const Rectangle& square) {
    scene_.rectangles = {wall, square};
    addPatch(rectanglePatch(wall, 30, {10, 200, 10, 255}));
    addPatch(rectanglePatch(square, 10, {230, 10, 10, 255}));
  }
  /// Pixels that are red where the truth and all its neighbours are green.
  int redOnGreen(const base::Image& drawn) const {
    const base::Image truth = castRays(scene_, camera_);
    int count = 0;
    for (int y = 2; y < truth.height - 2; ++y)
      for (int x = 2; x < truth.width - 2; ++x) {
        bool green = true;
        for (int v = -2; v <= 2; ++v)
          for (int u = -2; u <= 2; ++u) green = green && truth.at(x + u, y + v)[0] < 60;
        count += green && drawn.at(x, y)[0] > 80;
      }
    return count;
  }
  base::Camera camera_;
};

TEST_F(Occluder, itsColourDoesNotLeakOnWhatLiesBehind) {
  EXPECT_EQ(redOnGreen(draw(camera_)), 0);
}

TEST_F(Occluder, withoutItInTheDepthMapItsColourWouldLeak) {
  occluders_ = {0};
  EXPECT_GT(redOnGreen(draw(camera_)), 300);
}

// The viewer stands behind the square, where the sample's rays to the wall are the viewer's own.
TEST_F(Occluder, behindTheViewerDoesNotColourWhereRaysCoincide) {
  camera_ = lookAt({0.375F, 0.5F, 0.0F}, {0.75F, 1.0F, 0.0F}, 240, 240, 60.0F);
  EXPECT_EQ(redOnGreen(draw(camera_)), 0);
}

// The sample stands so near to the viewer that their rays coincide at the wall. Past the square, which is nearer still,
// they do not.
class NearOccluder : public Occluder {
 protected:
  void SetUp() override {
    Lumigraph::SetUp();
    show({{0, 10, 0}, {15, 0, 0}, {0, 0, 15}, kGreen, {}}, {{0, 0, 0}, {0.1F, 0, 0}, {0, 0, 0.1F}, kRed, {}});
    addImage(0, lookAt({0.02F, -0.3F, 0.0F}, {0.02F, 0, 0}, kFace, kFace, 90.0F));
    camera_ = lookAt({0.0F, -0.3F, 0.0F}, {0, 0, 0}, 240, 240, 60.0F);
  }
};

TEST_F(NearOccluder, doesNotColourWhatIsFar) {
  EXPECT_EQ(redOnGreen(draw(camera_)), 0);
}

TEST_F(NearOccluder, itsEdgeStaysWhereTheSampleSeesItAsTheViewerDoes) {
  addImage(1, lookAt({0.0F, -0.3F, 0.0F}, {0, 0, 0}, 2 * kFace, 2 * kFace, 60.0F));
  EXPECT_GE(psnrOnCovered(castRays(scene_, camera_), draw(camera_)), 30.0);
}

TEST_F(Occluder, outsideTheDrawnCutStillHidesWhenNamedAsOccluder) {
  occluders_ = {0, 1};
  cut_ = {0};
  EXPECT_EQ(redOnGreen(draw(camera_)), 0);
}

TEST_F(Lumigraph, theOtherSideOfAThinSheetDoesNotColourThisOne) {
  const Rectangle sheet{{0, 0, 0}, {1, 0, 0}, {0, 0, 1}, kRed, kGreen};
  scene_.rectangles = {sheet};
  addPatch(rectanglePatch(sheet, 20, kWhite));
  addImage(0, lookAt({-0.4F, 2.0F, 0.5F}, {0, 0, 0}, kFace, kFace, 70.0F));
  addImage(1, lookAt({1.5F, -2.0F, 0.0F}, {0, 0, 0}, kFace, kFace, 70.0F));
  const base::Camera camera = lookAt({-0.4F, -2.0F, 0.5F}, {0, 0, 0}, 160, 160, 40.0F);
  EXPECT_GE(psnrOnCovered(castRays(scene_, camera), draw(camera)), 40.0);
}

TEST_F(Lumigraph, carvingGivesACoarseProxyTheSilhouetteOfTheImages) {
  makeBall(1.05F, 12);
  for (int i = 0; i < 6; ++i)
    addImage(static_cast<SampleId>(i), lookAt({-0.75F + 0.3F * static_cast<float>(i), -3.0F, i % 2 == 0 ? 0.3F : -0.3F},
                                              glm::vec3(0.0F), 256, 256, 45.0F));
  options_.max_samples = 32;
  const base::Camera camera = lookAt({0.1F, -3.1F, 0.0F}, glm::vec3(0.0F), 240, 240, 45.0F);
  const base::Image truth = castRays(scene_, camera);
  options_.carve = false;
  const double uncarved = coverageOverlap(truth, draw(camera, 0.0, 4.0F));
  options_.carve = true;
  const double carved = coverageOverlap(truth, draw(camera, 0.0, 4.0F));
  EXPECT_LT(uncarved, 0.93);
  EXPECT_GE(carved, 0.95);
}

// A proxy of radius 1.1 around a red ball of radius 1, which six images carve.
class CarvedEdge : public Lumigraph {
 protected:
  void SetUp() override {
    Lumigraph::SetUp();
    scene_.balls = {{glm::vec3(0.0F), 1.0F, kRed}};
    addPatch(ballPatch(glm::vec3(0.0F), 1.1F, 40, {230, 13, 13, 255}));
  }
  /// Adds images whose eyes lie around the viewer's.
  void addImages() {
    for (int i = 0; i < 6; ++i) {
      const glm::vec3 apart(0.05F * static_cast<float>(i) - 0.125F, 0.0F, i % 2 == 0 ? 0.05F : -0.05F);
      addImage(static_cast<SampleId>(i), lookAt(camera_.eye + apart, glm::vec3(0.0F), 256, 256, 45.0F));
    }
  }
  /// Returns the pixels that the rows of the middle cover from the left border to the middle of the picture.
  static std::vector<double> coverageOfRows(const base::Image& image) {
    std::vector<double> rows;
    for (int y = image.height / 2 - 40; y < image.height / 2 + 40; ++y) {
      rows.push_back(0.0);
      for (int x = 0; x < image.width / 2; ++x) rows.back() += image.at(x, y)[3] / 255.0;
    }
    return rows;
  }
  const base::Camera camera_ = lookAt({0.1F, -3.1F, 0.0F}, glm::vec3(0.0F), 240, 240, 45.0F);
};

TEST_F(CarvedEdge, coversAPartOfItsPixelsAndLiesWhereTheImagesHaveIt) {
  addImages();
  options_.tuning.carve_below = 0.5F;  // in the middle of an image's edge
  const base::Image drawn = drawMultisampled(camera_, 4.0F);
  const std::vector<double> rows = coverageOfRows(drawn), truth = coverageOfRows(castRays(scene_, camera_, 8));
  double inside = 0.0;
  int in_part = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    EXPECT_NEAR(rows[i], truth[i], 1.0) << i;
    inside += (rows[i] - truth[i]) / static_cast<double>(rows.size());
    in_part += rows[i] != std::floor(rows[i]) ? 1 : 0;
  }
  EXPECT_NEAR(inside, 0.0, 0.5);
  EXPECT_GE(in_part, 40) << "of 80 rows";
  for (int y = 0; y < 240; ++y)
    for (int x = 0; x < 240; ++x) {
      const glm::ivec4 p = pixel(drawn, x, y);
      // Where images have little of the model in a pixel, bytes tell its colour to no more than a fourth.
      EXPECT_NEAR(p.x, 0.9 * p.w, 20.0) << "premultiplied by the share of its samples, " << x << " " << y;
    }
}

// The images look up from below, so past the ball's upper edge they see the sky, where the viewer sees the wall.
TEST_F(CarvedEdge, showsWhatLiesBehindItAndNoBackground) {
  const Rectangle wall{{0, 7, 0}, {6, 0, 0}, {0, 0, 3.5F}, kGreen, {}};
  scene_.rectangles = {wall};
  addPatch(rectanglePatch(wall, 30, {13, 204, 13, 255}));
  for (int i = 0; i < 6; ++i)
    addImage(static_cast<SampleId>(i),
             lookAt({-0.5F + 0.2F * static_cast<float>(i), -3.0F, -0.2F}, glm::vec3(0.0F), 256, 256, 70.0F));
  const base::Image drawn = drawMultisampled(lookAt({0.0F, -3.1F, 0.2F}, glm::vec3(0.0F), 240, 240, 45.0F), 4.0F);
  int mixed = 0;
  for (int x = 100; x < 140; ++x) {
    int green = 0;
    for (int y = 119; y >= 0 && drawn.at(x, y)[3] == 255; --y) {
      const glm::ivec4 p = pixel(drawn, x, y);
      const float red = static_cast<float>(p.x - 13) / (230 - 13);
      EXPECT_NEAR(static_cast<float>(p.y), glm::mix(204.0F, 13.0F, red), 5.0F) << x << " " << y;
      mixed += red > 0.2F && red < 0.8F ? 1 : 0;
      green += red < 0.1F ? 1 : 0;
    }
    EXPECT_GE(green, 8) << x;
  }
  EXPECT_GE(mixed, 10) << "of 40 columns";
}

TEST_F(Lumigraph, shadesSurfacesWithoutImagesOrLeavesTheBackground) {
  scene_.balls = {{glm::vec3(0.0F), 1.0F, kRed}};
  addPatch(ballPatch(glm::vec3(0.0F), 1.0F, 60, {40, 80, 160, 255}));
  addCube(kEye, 0);
  const base::Camera behind = lookAt({0, 3, 0}, glm::vec3(0.0F), 64, 64, 50.0F);
  const base::Image shaded = draw(behind);
  EXPECT_EQ(shaded.at(32, 32)[0], 40);
  EXPECT_EQ(shaded.at(32, 32)[2], 160);
  options_.fill_holes = false;
  options_.background[1] = 1.0F;
  EXPECT_EQ(draw(behind).at(32, 32)[1], 255);
}

TEST_F(Lumigraph, withoutImagesTheSurfaceIsShadedAsElsewhere) {
  makeBall();
  shading_.unlit = false;
  const base::Camera camera = lookAt(kEye, glm::vec3(0.0F), 120, 120, 50.0F);
  const base::Image none = draw(camera);
  addCube(kEye, 0);
  options_.use_images = false;
  EXPECT_EQ(draw(camera).pixels, none.pixels);
  // Half-Lambert at the pixel in the middle: its normal is −y.
  const glm::vec3 light = glm::normalize(shading_.light_direction);
  const float half = 0.5F - 0.5F * light.y;
  EXPECT_NEAR(none.at(60, 60)[0], 255.0F * (0.15F + 0.85F * half * half), 4.0F);
}

TEST_F(Lumigraph, removingASampleEqualsNeverHavingAddedIt) {
  makeBall();
  const base::Camera camera = lookAt(kEye, glm::vec3(0.0F), 120, 120, 50.0F);
  addCube({-0.5F, -3.0F, 0.0F}, 0);
  const base::Image before = draw(camera);
  addCube({0.7F, -2.8F, 0.2F}, 10);
  EXPECT_NE(draw(camera).pixels, before.pixels);
  for (SampleId id = 10; id < 16; ++id) renderer_->removeSample(id);
  EXPECT_EQ(draw(camera).pixels, before.pixels);
}

TEST_F(Lumigraph, layersSurviveTheGrowthOfTheirArray) {
  // The first allocation has room for four.
  makeBall();
  const base::Camera camera = lookAt(kEye, glm::vec3(0.0F), 120, 120, 50.0F);
  const base::Camera front = cubeCameras(kEye, kFace)[2];
  addImage(0, front);
  const base::Image alone = draw(camera);
  for (SampleId id = 1; id < 12; ++id) addImage(id, lookAt(kEye, {0, -9, 0}, kFace, kFace, 60.0F));
  EXPECT_EQ(draw(camera).pixels, alone.pixels);
  EXPECT_EQ(renderer_->stats().depth_maps_drawn, 0U) << "the depth map has moved with its layer";
}

TEST_F(Lumigraph, depthMapsAreRedrawnOnlyWhenTheirOwnPatchesChange) {
  makeBall();
  addPatch(ballPatch({0, -6, 0}, 0.5F, 20, kWhite));
  scene_.balls.push_back({{0, -6, 0}, 0.5F, kRed});
  addImage(0, cubeCameras(kEye, kFace)[2]);  // sees the ball at the origin only
  const base::Camera camera = lookAt(kEye, glm::vec3(0.0F), 64, 64, 50.0F);
  occluders_ = {0, 1};
  draw(camera);
  EXPECT_EQ(renderer_->stats().depth_maps_drawn, 1U);
  occluders_ = {0};
  draw(camera);
  EXPECT_EQ(renderer_->stats().depth_maps_drawn, 0U);
  cut_ = occluders_ = {1};
  draw(camera);
  cut_ = {0};
  occluders_ = {0, 1};
  draw(camera);
  EXPECT_EQ(renderer_->stats().depth_maps_drawn, 0U);
}

TEST_F(Lumigraph, picturesSettleAndThenEqualTheFinalOne) {
  makeBall();
  addCube({-0.5F, -3.0F, 0.0F}, 0);
  addCube({0.7F, -2.8F, 0.2F}, 10);
  const base::Camera camera = lookAt(kEye, glm::vec3(0.0F), 120, 120, 50.0F);
  const base::Image final = draw(camera);
  EXPECT_FALSE(renderer_->settling());
  for (SampleId id = 0; id < 16; ++id) renderer_->removeSample(id);
  addCube({-0.5F, -3.0F, 0.0F}, 0);
  addCube({0.7F, -2.8F, 0.2F}, 10);
  options_.fade_seconds = 0.25F;
  base::Image image = draw(camera, 1.0);
  EXPECT_TRUE(renderer_->settling());
  EXPECT_NE(image.pixels, final.pixels);
  double now = 1.0;
  for (int i = 0; i < 40 && renderer_->settling(); ++i) image = draw(camera, now += 0.05);
  EXPECT_FALSE(renderer_->settling());
  EXPECT_EQ(image.pixels, final.pixels);
}

// A coarse proxy lacks the letters on a wall, which all images show. Past the edge of a hidden place each image shows
// something else. While a scene arrives few images are there.
TEST_F(Lumigraph, imagesThatAgreeAreBelievedHoweverFarTheProxyIsFromThem) {
  const auto redOf = [&](std::size_t first, std::size_t images, bool agree, float agreement) {
    SetUp();
    cut_.clear();
    const Rectangle wall{{0, 0, 0}, {4, 0, 0}, {0, 0, 4}, constant(glm::vec3(0.1F)), {}};
    addPatch(rectanglePatch(wall, 40, kWhite));
    proxy_errors_ = {{0.001F, 0.02F}};
    for (std::size_t i = first; i < first + images; ++i) {
      scene_.rectangles = {wall};
      if (!agree && i % 2 == 0) scene_.rectangles[0].color = kGreen;
      if (!agree && i % 4 == 1) scene_.rectangles[0].color = kRed;
      const glm::vec3 eye(-0.75F + 0.5F * static_cast<float>(i % 4), -2.0F, -0.75F + 0.5F * static_cast<float>(i / 4));
      addImage(i, lookAt(eye, eye + glm::vec3(0, 1, 0), kFace, kFace, 90.0F));
    }
    options_.tuning = {};
    options_.tuning.agreement = agreement;
    const base::Image image = draw(lookAt({0, -1.6F, 0}, {0, 0, 0}, 96, 54, 40.0F));
    return int{pixel(image, 48, 27).r};
  };
  const float usual = client::BlendTuning{}.agreement;
  EXPECT_LT(redOf(0, 16, true, usual), 80) << "the images' 0.1, as four share most of the weight";
  EXPECT_GT(redOf(0, 16, true, 0.0F), 200) << "each is doubted by itself";
  EXPECT_GT(redOf(0, 16, false, usual), 200) << "the proxy's white";
  EXPECT_LT(redOf(5, 2, true, usual), 150) << "the proxy has the rest of the weight";
  EXPECT_GT(redOf(5, 2, true, 0.0F), 200);
}

class Continuity : public Lumigraph {
 protected:
  // A wall that fills the picture, seen by four samples whose images differ in colour, so that any jump of a weight
  // shows.
  void SetUp() override {
    Lumigraph::SetUp();
    const Rectangle wall{{0, 0, 0}, {4, 0, 0}, {0, 0, 4}, kGreen, {}};
    addPatch(rectanglePatch(wall, 40, kWhite));
    const std::array<Color, 4> colors{kRed, kGreen, constant({0.1F, 0.1F, 0.9F}), constant({0.8F, 0.8F, 0.1F})};
    for (std::size_t i = 0; i < colors.size(); ++i) {
      scene_.rectangles = {wall};
      scene_.rectangles[0].color = colors[i];
      // Faces of 60° reach 1.15 to either side: borders cross the picture.
      const glm::vec3 eye(-1.5F + static_cast<float>(i), -2.0F, 0.0F);
      addImage(i, lookAt(eye, eye + glm::vec3(0, 1, 0), kFace, kFace, 60.0F));
    }
  }
  /// Largest change of a channel from frame to frame, and between the first and the last.
  std::pair<int, int> walk(float start, int max_samples, float fade_seconds) {
    options_.max_samples = max_samples;
    options_.fade_seconds = fade_seconds;
    const auto frameAt = [&](int i) {
      const glm::vec3 eye(start + 0.0025F * static_cast<float>(i), -1.5F, 0.0F);
      return draw(lookAt(eye, eye + glm::vec3(0, 1, 0), 96, 54, 40.0F), 10.0 + i / 60.0);
    };
    for (int i = 0; i < 20; ++i) draw(lookAt({start, -1.5F, 0}, {start, 0, 0}, 96, 54, 40.0F), 9.0 + 0.05 * i);
    const base::Image first = frameAt(0);
    base::Image previous = first;
    int largest = 0;
    for (int i = 1; i < 200; ++i) {
      base::Image next = frameAt(i);
      largest = std::max(largest, difference(previous, next));
      previous = std::move(next);
    }
    return {largest, difference(first, previous)};
  }
  static int difference(const base::Image& a, const base::Image& b) {
    int largest = 0;
    for (std::size_t i = 0; i < a.pixels.size(); ++i)
      largest = std::max(largest, std::abs(int{a.pixels[i]} - int{b.pixels[i]}));
    return largest;
  }
};

TEST_F(Continuity, smallStepsAcrossBordersChangePixelsALittle) {
  const auto [step, total] = walk(-1.2F, 16, 0.0F);
  EXPECT_GE(total, 100);
  EXPECT_LE(step, 24);
}

TEST_F(Continuity, fadesHideThatOtherSamplesAreChosen) {
  const auto [step, total] = walk(-0.2F, 3, 0.25F);
  EXPECT_GE(total, 100);
  const int faded = step;
  const auto [popped, same] = walk(-0.2F, 3, 0.0F);
  EXPECT_LE(faded, 24);
  EXPECT_GT(popped, faded);
}

}  // namespace
