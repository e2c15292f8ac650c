#include "tests/client/render/ray_scene.h"

#include <cmath>
#include <optional>

namespace testing_scene {
namespace {

struct Ray {
  glm::vec3 origin, direction;
};

void hitBall(const Ray& ray, const Ball& ball, float& nearest, glm::vec3& color) {
  const glm::vec3 to = ray.origin - ball.center;
  const float half = glm::dot(to, ray.direction);
  const float root = half * half - glm::dot(to, to) + ball.radius * ball.radius;
  if (root < 0.0F) return;
  const float t = -half - std::sqrt(root);
  if (t <= 0.0F || t >= nearest) return;
  nearest = t;
  color = ball.color(ray.origin + t * ray.direction);
}

void hitRectangle(const Ray& ray, const Rectangle& r, float& nearest, glm::vec3& color) {
  const glm::vec3 normal = glm::cross(r.a, r.b);
  const float down = glm::dot(normal, ray.direction);
  if (down == 0.0F) return;
  const float t = glm::dot(normal, r.center - ray.origin) / down;
  if (t <= 0.0F || t >= nearest) return;
  const glm::vec3 point = ray.origin + t * ray.direction;
  const glm::vec3 in = point - r.center;
  if (std::abs(glm::dot(in, r.a)) > glm::dot(r.a, r.a) || std::abs(glm::dot(in, r.b)) > glm::dot(r.b, r.b)) return;
  nearest = t;
  color = down > 0.0F && r.back ? r.back(point) : r.color(point);
}

std::optional<glm::vec3> cast(const Scene& scene, const Ray& ray) {
  float nearest = 1e30F;
  glm::vec3 color(0.0F);
  for (const Ball& ball : scene.balls) hitBall(ray, ball, nearest, color);
  for (const Rectangle& rectangle : scene.rectangles) hitRectangle(ray, rectangle, nearest, color);
  if (nearest >= 1e30F) return std::nullopt;
  return color;
}

glm::ivec3 quantized(const glm::vec3& p) {
  return glm::ivec3(glm::round((glm::dvec3(p) - kLattice.origin) / kLattice.step));
}

void addCells(lod::patch::PatchGeometry& patch, int columns, int rows) {
  for (int y = 0; y < rows; ++y)
    for (int x = 0; x < columns; ++x) {
      const auto at = [&](int i, int j) { return static_cast<std::uint16_t>(j * (columns + 1) + i); };
      for (const std::uint16_t v : {at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y), at(x + 1, y + 1), at(x, y + 1)})
        patch.indices.push_back(v);
    }
}

}  // namespace

base::Image castRays(const Scene& scene, const base::Camera& camera, int rays) {
  base::Image image(camera.width, camera.height, 4);
  const glm::mat4 scene_from_clip = glm::inverse(camera.clipFromScene());
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) {
      glm::vec3 sum(0.0F);
      int hits = 0;
      for (int k = 0; k < rays * rays; ++k) {
        const float u = (static_cast<float>(x) + (static_cast<float>(k % rays) + 0.5F) / static_cast<float>(rays)) /
                        static_cast<float>(image.width);
        const float v = (static_cast<float>(y) + (static_cast<float>(k / rays) + 0.5F) / static_cast<float>(rays)) /
                        static_cast<float>(image.height);
        // Rays run from the near plane to the far one, which is right for parallel ones, too.
        const glm::vec4 near = scene_from_clip * glm::vec4(2.0F * u - 1.0F, 1.0F - 2.0F * v, -1.0F, 1.0F);
        const glm::vec4 far = scene_from_clip * glm::vec4(2.0F * u - 1.0F, 1.0F - 2.0F * v, 1.0F, 1.0F);
        const glm::vec3 origin = camera.orthographic() ? glm::vec3(near) / near.w : camera.eye;
        const auto color = cast(scene, {origin, glm::normalize(glm::vec3(far) / far.w - origin)});
        if (!color) continue;
        sum += *color;
        ++hits;
      }
      std::uint8_t* pixel = image.at(x, y);
      for (int c = 0; c < 3; ++c)
        pixel[c] = hits == 0 ? 0 : static_cast<std::uint8_t>(std::lround(255.0F * sum[c] / static_cast<float>(hits)));
      pixel[3] = 2 * hits >= rays * rays ? 255 : 0;
    }
  return image;
}

lod::patch::PatchGeometry ballPatch(const glm::vec3& center, float radius, int rings, glm::u8vec4 color) {
  lod::patch::PatchGeometry patch;
  const int columns = 2 * rings;
  for (int j = 0; j <= rings; ++j)
    for (int i = 0; i <= columns; ++i) {
      const float theta = 3.14159265F * static_cast<float>(j) / static_cast<float>(rings);
      const float phi = 6.2831853F * static_cast<float>(i % columns) / static_cast<float>(columns);
      const glm::vec3 n(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), -std::cos(theta));
      patch.positions.push_back(quantized(center + radius * n));
      patch.normals.push_back(n);
      patch.colors.push_back(color);
    }
  addCells(patch, columns, rings);
  return patch;
}

lod::patch::PatchGeometry rectanglePatch(const Rectangle& rectangle, int cells, glm::u8vec4 color) {
  lod::patch::PatchGeometry patch;
  for (int j = 0; j <= cells; ++j)
    for (int i = 0; i <= cells; ++i) {
      const float u = 2.0F * static_cast<float>(i) / static_cast<float>(cells) - 1.0F;
      const float v = 2.0F * static_cast<float>(j) / static_cast<float>(cells) - 1.0F;
      patch.positions.push_back(quantized(rectangle.center + u * rectangle.a + v * rectangle.b));
      patch.normals.push_back(glm::normalize(glm::cross(rectangle.a, rectangle.b)));
      patch.colors.push_back(color);
    }
  addCells(patch, cells, cells);
  return patch;
}

base::Camera lookAt(const glm::vec3& eye, const glm::vec3& target, int width, int height, float fov_y_degrees) {
  base::ViewCamera view;
  view.position = glm::dvec3(eye);
  view.direction = glm::normalize(glm::dvec3(target - eye));
  view.up = std::abs(view.direction.z) > 0.99 ? glm::dvec3(0, 1, 0) : glm::dvec3(0, 0, 1);
  view.fov_y = glm::radians(static_cast<double>(fov_y_degrees));
  view.width = width;
  view.height = height;
  return base::cameraFromView(view, glm::dvec3(0.0), 0.05F, 50.0F);
}

base::Camera lookAlong(const glm::vec3& eye, const glm::vec3& target, int width, int height, float ortho_height) {
  base::ViewCamera view;
  view.position = glm::dvec3(eye);
  view.direction = glm::normalize(glm::dvec3(target - eye));
  view.up = std::abs(view.direction.z) > 0.99 ? glm::dvec3(0, 1, 0) : glm::dvec3(0, 0, 1);
  view.ortho_height = static_cast<double>(ortho_height);
  view.width = width;
  view.height = height;
  return base::cameraForScene(view, glm::dvec3(0.0), {glm::vec3(0.0F), 4.0F});
}

std::vector<base::Camera> cubeCameras(const glm::vec3& eye, int size) {
  std::vector<base::Camera> cameras;
  for (int axis = 0; axis < 3; ++axis)
    for (const float sign : {1.0F, -1.0F}) {
      glm::vec3 direction(0.0F);
      direction[axis] = sign;
      cameras.push_back(lookAt(eye, eye + direction, size, size, 90.0F));
    }
  return cameras;
}

double psnrOnCovered(const base::Image& a, const base::Image& b) {
  double sum = 0.0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < a.pixels.size(); i += 4) {
    if (a.pixels[i + 3] != 255 || b.pixels[i + 3] != 255) continue;
    for (std::size_t c = 0; c < 3; ++c) {
      const double d = static_cast<double>(a.pixels[i + c]) - static_cast<double>(b.pixels[i + c]);
      sum += d * d;
    }
    count += 3;
  }
  if (count == 0) return 0.0;
  return sum == 0.0 ? 99.0 : 10.0 * std::log10(255.0 * 255.0 * static_cast<double>(count) / sum);
}

double coverageOverlap(const base::Image& a, const base::Image& b) {
  std::size_t both = 0, either = 0;
  for (std::size_t i = 3; i < a.pixels.size(); i += 4) {
    both += a.pixels[i] != 0 && b.pixels[i] != 0;
    either += a.pixels[i] != 0 || b.pixels[i] != 0;
  }
  return either == 0 ? 1.0 : static_cast<double>(both) / static_cast<double>(either);
}

}  // namespace testing_scene
