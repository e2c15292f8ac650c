#include "lod/draw/shadow_map.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "base/egl/headless.h"
#include "lod/draw/hlod_nodes.h"
#include "tests/lod/draw/shadow_truth.h"
#include "tests/support/failure_meshes.h"
#include "tests/support/test_meshes.h"

namespace lod::draw {
namespace {

using support::Mesh;

constexpr int kWidth = 240, kHeight = 180;  // pixels

/// Flat sides keep their normals: each triangle has vertices of its own.
Mesh faceted(const Mesh& mesh) {
  Mesh flat;
  for (std::size_t i = 0; i < mesh.indices.size(); ++i) {
    flat.positions.push_back(mesh.positions[mesh.indices[i]]);
    flat.indices.push_back(static_cast<std::uint32_t>(i));
  }
  flat.normals = support::vertexNormals(flat);
  return flat;
}

Mesh square(float side, float z) {
  Mesh mesh;
  for (const glm::vec2 corner : {glm::vec2(-1, -1), {1, -1}, {1, 1}, {-1, 1}})
    mesh.positions.emplace_back(0.5F * side * corner, z);
  mesh.indices = {0, 1, 2, 0, 2, 3};
  return mesh;
}

/// A post, and an arch of two posts and a beam, on a square of 4 × 4.
Mesh postAndArch() {
  Mesh mesh = square(4.0F, 0.0F);
  support::append(mesh, support::box({-1.1F, -0.1F, 0.0F}, {-0.95F, 0.05F, 1.0F}, 1));
  support::append(mesh, support::box({0.2F, 0.3F, 0.0F}, {0.4F, 0.5F, 0.8F}, 1));
  support::append(mesh, support::box({0.9F, 0.3F, 0.0F}, {1.1F, 0.5F, 0.8F}, 1));
  support::append(mesh, support::box({0.1F, 0.3F, 0.8F}, {1.2F, 0.5F, 0.95F}, 1));
  return faceted(mesh);
}

Mesh bumpyBall() {
  Mesh mesh = square(4.0F, 0.0F);
  support::append(mesh, support::bumpySphere(80, 160, 0.12F, {0.0F, 0.0F, 0.9F}, 0.7F));
  mesh.normals = support::vertexNormals(mesh);
  return mesh;
}

base::Camera sceneCamera(const glm::dvec3& position, bool orthographic = false) {
  base::ViewCamera view;
  view.position = position;
  view.direction = glm::normalize(glm::dvec3(0.0, 0.0, 0.4) - position);
  view.up = {0.0, 0.0, 1.0};
  view.width = kWidth, view.height = kHeight;
  if (orthographic) view.ortho_height = 3.5;
  return base::cameraForScene(view, glm::dvec3(0.0), {glm::vec3(0.0F), 3.0F});
}

/// A view from the light that holds a sphere around the scenes here.
base::Camera lightCamera(const hlod::ShadowLight& light, int texels) {
  constexpr float kRadius = 3.0F;
  const glm::vec3 towards(light.place);
  const float distance = light.place.w > 0.0F ? glm::length(towards) : 2.0F * kRadius;
  const glm::vec3 eye = light.place.w > 0.0F ? towards : distance * towards;
  base::Camera camera;
  camera.eye = eye;
  camera.eye_from_scene = glm::lookAt(eye, glm::vec3(0.0F), glm::vec3(0.0F, 1.0F, 0.1F));
  const float near_plane = std::max(distance - kRadius, 0.05F), far_plane = distance + kRadius;
  const float half_angle = std::asin(std::min(kRadius / distance, 0.9F));
  camera.clip_from_eye = light.place.w > 0.0F ? glm::perspective(2.0F * half_angle, 1.0F, near_plane, far_plane)
                                              : glm::ortho(-kRadius, kRadius, -kRadius, kRadius, near_plane, far_plane);
  camera.width = camera.height = texels;
  return camera;
}

hlod::ShadowLight sun(const glm::vec3& direction, double degrees = 0.0) {
  return {glm::vec4(glm::normalize(direction), 0.0F), static_cast<float>(degrees * std::numbers::pi / 180.0)};
}
hlod::ShadowLight lamp(const glm::vec3& place, float size = 0.0F) {
  return {glm::vec4(place, 1.0F), size};
}

class ShadowMapTest : public testing::Test {
 protected:
  void SetUp() override {
    auto context = base::HeadlessContext::create();
    ASSERT_TRUE(context) << context.error().message;
    context_ = std::move(*context);
    auto renderer = NodeRenderer::create(100'000'000);
    ASSERT_TRUE(renderer) << renderer.error().message;
    renderer_ = std::move(*renderer);
    auto target = base::gl::RenderTarget::create(kWidth, kHeight);
    ASSERT_TRUE(target);
    target_ = std::move(*target);
  }
  void TearDown() override {
    EXPECT_EQ(base::gl::takeError(), "");
    renderer_.reset();
    target_ = {};
  }

  /// Makes the mesh a leaf that is drawn.
  void add(const Mesh& mesh) {
    hlod::NodePicture picture;
    hlod::CasterPicture caster;
    picture.node = caster.node = static_cast<std::uint32_t>(rows_.size());
    for (std::size_t v = 0; v < mesh.positions.size(); ++v)
      picture.vertices.push_back(surfaceVertex(mesh.positions[v], mesh.normals[v], glm::u8vec3(255)));
    caster.positions = mesh.positions;
    picture.triangles = caster.triangles = mesh.indices;
    hlod::Node row;
    row.box = mesh.box();
    rows_.push_back(row);
    nodes_.push_back({0.0F, false, std::make_shared<const hlod::NodePicture>(std::move(picture))});
    casters_.push_back({std::make_shared<const hlod::CasterPicture>(std::move(caster))});
  }

  /// `map`: the one map of all nodes.
  base::Image draw(const base::Camera& camera, const hlod::ShadowLight& light, const base::Camera& map) {
    NodeShadows shadows;
    shadows.light = light;
    shadows.nodes = rows_;
    NodeShadowMap& one = shadows.maps.emplace_back();
    one.plan.camera = map;
    one.casters = casters_;
    for (std::uint32_t i = 0; i < nodes_.size(); ++i) one.plan.receivers.push_back(i);
    NodeView view;
    view.camera = camera;
    target_.bind();
    glClearColor(0, 0, 0, 0);
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    const auto count = renderer_->draw(nodes_, view, {target_.framebuffer(), kWidth, kHeight}, &shadows);
    EXPECT_TRUE(count) << count.error().message;
    return target_.read();
  }

  std::unique_ptr<base::HeadlessContext> context_;
  std::unique_ptr<NodeRenderer> renderer_;
  base::gl::RenderTarget target_;
  std::vector<hlod::Node> rows_;
  std::vector<hlod::DrawnNode> nodes_;
  std::vector<DrawnCaster> casters_;
};

const std::vector<hlod::ShadowLight> kHardLights{sun({0.3F, 0.5F, 0.8F}), sun({-0.8F, 0.2F, 0.5F}),
                                                 sun({0.1F, -0.9F, 0.6F}), lamp({1.0F, 2.0F, 4.0F}),
                                                 lamp({-4.0F, 3.0F, 3.5F})};

TEST_F(ShadowMapTest, hardShadowsEndWhereRaysSay) {
  for (const Mesh& mesh : {postAndArch(), bumpyBall()}) {
    rows_.clear(), nodes_.clear(), casters_.clear();
    add(mesh);
    const support::ShadowTruth truth(mesh);
    for (const bool orthographic : {false, true})
      for (const hlod::ShadowLight& light : kHardLights) {
        const base::Camera camera = sceneCamera({1.5, -3.5, 3.0}, orthographic);
        // A pixel of this view is as long as three texels or more.
        const base::Image picture = draw(camera, light, lightCamera(light, 2048));
        const support::EdgeCount count = support::compareEdges(picture, camera, truth, light, 0.4);
        EXPECT_GT(count.edges, 100);
        EXPECT_LE(count.wrong, count.edges / 100)
            << "of " << count.edges << " edges and " << count.checked << " pixels; light at " << light.place.x << ' '
            << light.place.y << ' ' << light.place.z << ' ' << light.place.w;
      }
  }
}

TEST_F(ShadowMapTest, softShadowsAreNearToThoseOfManySamples) {
  const std::vector<hlod::ShadowLight> lights{sun({0.3F, 0.5F, 0.8F}, 4.0), sun({-0.8F, 0.2F, 0.5F}, 12.0),
                                              lamp({1.0F, 2.0F, 4.0F}, 0.5F), lamp({-2.0F, 1.0F, 2.5F}, 1.0F)};
  for (const Mesh& mesh : {postAndArch(), bumpyBall()}) {
    rows_.clear(), nodes_.clear(), casters_.clear();
    add(mesh);
    const support::ShadowTruth truth(mesh);
    for (const hlod::ShadowLight& light : lights) {
      const base::Camera camera = sceneCamera({1.5, -3.5, 3.0});
      const base::Image picture = draw(camera, light, lightCamera(light, 1024));
      const support::PenumbraError error = support::comparePenumbrae(picture, camera, truth, light);
      EXPECT_GT(error.pixels, 400);
      EXPECT_LT(error.mean, 4.0) << error.pixels << " pixels, largest " << error.largest << "; light at "
                                 << light.place.x << ' ' << light.place.y;
    }
  }
}

TEST_F(ShadowMapTest, mapsOfUnlikeSizesTakeNoMoreThanTwiceTheLargest) {
  const auto map = ShadowMap::create(1000);
  ASSERT_TRUE(map) << map.error().message;
  const hlod::ShadowLight hard = sun({0.3F, 0.5F, 0.8F}), soft = sun({0.3F, 0.5F, 0.8F}, 20.0);
  constexpr std::uint64_t kHardBytes = 4 * 1024 * 1024, kSoftBytes = 4 * 16 * 256 * 256;
  for (const auto& [light, texels, bytes] :
       {std::tuple(hard, 1024, kHardBytes), {soft, 256, kSoftBytes}, {hard, 1024, kHardBytes}}) {
    ASSERT_TRUE((*map)->draw({lightCamera(light, texels), light, {glm::vec3(-1.0F), glm::vec3(1.0F)}}, {}));
    EXPECT_GE((*map)->gpuBytes(), bytes);
    EXPECT_LE((*map)->gpuBytes(), 2 * std::max(kHardBytes, kSoftBytes));
  }
}

}  // namespace
}  // namespace lod::draw
