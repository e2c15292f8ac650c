#include "client/render/choose.h"

#include <gtest/gtest.h>

#include <deque>

namespace {

using client::SampleGeometry;

base::Camera cameraAt(const glm::vec3& eye, const glm::vec3& target, int size, float fov_degrees) {
  base::ViewCamera view;
  view.position = glm::dvec3(eye);
  view.direction = glm::normalize(glm::dvec3(target - eye));
  view.up = std::abs(view.direction.z) > 0.99 ? glm::dvec3(0, 1, 0) : glm::dvec3(0, 0, 1);
  view.fov_y = glm::radians(static_cast<double>(fov_degrees));
  view.width = view.height = size;
  return base::cameraFromView(view, glm::dvec3(0.0), 0.05F, 50.0F);
}

struct Samples {
  std::deque<SampleGeometry> geometry;
  std::vector<const SampleGeometry*> pointers;
  void add(const base::Camera& camera) {
    geometry.emplace_back(camera);
    pointers.push_back(&geometry.back());
  }
};

const base::Aabb kBox{glm::vec3(-0.5F), glm::vec3(0.5F)};

std::vector<std::size_t> choose(const Samples& samples, const base::Camera& view, std::size_t limit) {
  const client::ProxyError error{0.001F, 0.1F};
  return client::chooseSamples(samples.pointers, std::span(&kBox, 1), std::span(&error, 1), view, limit, {});
}

TEST(ChooseSamples, theNearestRayComesFirst) {
  Samples samples;
  samples.add(cameraAt({0, 4, 0}, glm::vec3(0.0F), 256, 90));
  samples.add(cameraAt({4, 0.2F, 0}, glm::vec3(0.0F), 256, 90));
  samples.add(cameraAt({3, 3, 0}, glm::vec3(0.0F), 256, 90));
  EXPECT_EQ(choose(samples, cameraAt({4, 0, 0}, glm::vec3(0.0F), 256, 90), 3), (std::vector<std::size_t>{1, 2, 0}));
}

TEST(ChooseSamples, samplesThatLookElsewhereAreLeftOut) {
  Samples samples;
  samples.add(cameraAt({4, 0, 0}, {8, 0, 0}, 256, 90));
  samples.add(cameraAt({0, 4, 0}, glm::vec3(0.0F), 256, 90));
  EXPECT_EQ(choose(samples, cameraAt({4, 0, 0}, glm::vec3(0.0F), 256, 90), 3), (std::vector<std::size_t>{1}));
}

TEST(ChooseSamples, atTheSameAngleTheSharperOneComesFirst) {
  Samples samples;
  samples.add(cameraAt({4, 1, 0}, glm::vec3(0.0F), 64, 90));
  samples.add(cameraAt({4, -1, 0}, glm::vec3(0.0F), 256, 90));
  EXPECT_EQ(choose(samples, cameraAt({4, 0, 0}, glm::vec3(0.0F), 512, 60), 1), (std::vector<std::size_t>{1}));
}

TEST(BorderFloors, facesOfACubeGoOnIntoEachOther) {
  Samples samples;
  const glm::vec3 eye(1, 2, 3);
  for (const glm::vec3 d : {glm::vec3(1, 0, 0), glm::vec3(-1, 0, 0), glm::vec3(0, 1, 0), glm::vec3(0, -1, 0),
                            glm::vec3(0, 0, 1), glm::vec3(0, 0, -1)})
    samples.add(cameraAt(eye, eye + d, 128, 90));
  const std::vector<float> fades(6, 1.0F);
  for (const glm::vec4& floor : client::borderFloors(samples.pointers, fades)) EXPECT_EQ(floor, glm::vec4(1.0F));
}

TEST(BorderFloors, onlyTheSharedSideKeepsItsWeight) {
  // Looking along +x with +z up, +y is at the left.
  Samples samples;
  samples.add(cameraAt(glm::vec3(0.0F), {1, 0, 0}, 128, 90));
  samples.add(cameraAt(glm::vec3(0.0F), {0, 1, 0}, 128, 90));
  const std::vector<float> fades{1.0F, 0.25F};
  const auto floors = client::borderFloors(samples.pointers, fades);
  EXPECT_EQ(floors[0], glm::vec4(0.25F, 0, 0, 0)) << "sinks to the weight of the neighbour that is still coming in";
  EXPECT_EQ(floors[1], glm::vec4(0, 1, 0, 0));
}

TEST(BorderFloors, facesOfAnotherPointAreNoNeighbours) {
  Samples samples;
  samples.add(cameraAt(glm::vec3(0.0F), {1, 0, 0}, 128, 90));
  samples.add(cameraAt({0, 0, 1}, {0, 1, 1}, 128, 90));
  const std::vector<float> fades(2, 1.0F);
  for (const glm::vec4& floor : client::borderFloors(samples.pointers, fades)) EXPECT_EQ(floor, glm::vec4(0.0F));
}

}  // namespace
