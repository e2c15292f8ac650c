// A flat side of a building or machine is shaded alike all over, though its corners have normals that other sides
// share: the whole way of the programs.
#include <algorithm>
#include <array>
#include <cstdlib>
#include <glm/glm.hpp>
#include <string>
#include <vector>

#include "base/png/png.h"
#include "tests/programs/run_program.h"

namespace programs {
namespace {

constexpr glm::dvec3 kSize(20.0, 3.0, 9.0);

class HardEdges : public ProgramTest {
 protected:
  /// Writes a box of this many squares along each edge, and builds it.
  void buildBox(int cells) {
    std::string text;
    int vertices = 0;
    for (int axis = 0; axis < 3; ++axis)
      for (int side = 0; side < 2; ++side) {
        std::string faces;
        for (int i = 0; i <= cells; ++i)
          for (int j = 0; j <= cells; ++j) {
            glm::dvec3 at;
            at[axis] = side;
            at[(axis + 1) % 3] = static_cast<double>(i) / cells;
            at[(axis + 2) % 3] = static_cast<double>(j) / cells;
            at *= kSize;
            text += "v " + std::to_string(at.x) + " " + std::to_string(at.y) + " " + std::to_string(at.z) + "\n";
            ++vertices;
            if (i == cells || j == cells) continue;
            const std::string a = std::to_string(vertices), b = std::to_string(vertices + cells + 1),
                              c = std::to_string(vertices + cells + 2), d = std::to_string(vertices + 1);
            faces += side == 1 ? "f " + a + " " + b + " " + c + " " + d + "\n"
                               : "f " + a + " " + d + " " + c + " " + b + "\n";
          }
        text += faces;
      }
    writeText(path("box.obj"), text);
    const Outcome built =
        run("lumigrid", {"build", path("box.obj"), "-o", path("scene"), "--methods", "patch", "--quiet", "--force"});
    ASSERT_EQ(built.status, 0) << built.err;
  }

  /// Shades of the three sides that the camera sees, sorted, one list a side; a pixel is a side's if its ray meets it
  /// at least `margin` of its length from all of its edges.
  std::array<std::vector<int>, 3> shades(const std::vector<std::string>& cut, double margin) {
    // Rays are parallel, so that it is easy to say which side a pixel shows.
    const glm::dvec3 direction = glm::normalize(glm::dvec3(-1.0, 1.6, -0.9));
    const glm::dvec3 right = glm::normalize(glm::cross(direction, glm::dvec3(0.0, 0.0, 1.0)));
    const glm::dvec3 above = glm::cross(right, direction);
    const glm::dvec3 eye = 0.5 * kSize - 60.0 * direction;
    constexpr int kWidth = 640, kHeight = 480;
    constexpr double kShown = 20.0;
    const auto list = [](const glm::dvec3& v) {
      return "[" + std::to_string(v.x) + "," + std::to_string(v.y) + "," + std::to_string(v.z) + "]";
    };
    writeText(path("camera.json"), R"({"position":)" + list(eye) + R"(,"direction":)" + list(direction) +
                                       R"(,"up":[0,0,1],"ortho_height":)" + std::to_string(kShown) +
                                       R"(,"width":640,"height":480})");
    std::vector<std::string> command{"render", path("scene"), "--camera", path("camera.json"), "-o", path("p.png")};
    command.insert(command.end(), cut.begin(), cut.end());
    const Outcome rendered = run("lumigrid", command);
    EXPECT_EQ(rendered.status, 0) << rendered.err;
    const auto picture = base::readPng(path("p.png"));
    std::array<std::vector<int>, 3> sides;
    if (!picture || picture->width != kWidth || picture->height != kHeight) return sides;
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        const double unit = kShown / kHeight;
        const glm::dvec3 from =
            eye + (x + 0.5 - 0.5 * kWidth) * unit * right - (y + 0.5 - 0.5 * kHeight) * unit * above;
        for (int axis = 0; axis < 3; ++axis) {
          const double plane = direction[axis] < 0.0 ? kSize[axis] : 0.0;
          const glm::dvec3 at = (from + (plane - from[axis]) / direction[axis] * direction) / kSize;
          const double u = at[(axis + 1) % 3], v = at[(axis + 2) % 3];
          if (std::min({u, 1.0 - u, v, 1.0 - v}) < margin) continue;
          sides[static_cast<std::size_t>(axis)].push_back(picture->at(x, y)[0]);
        }
      }
    for (auto& side : sides) std::sort(side.begin(), side.end());
    return sides;
  }
};

TEST_F(HardEdges, sidesOfFewTrianglesAreShadedAlikeAllOver) {
  buildBox(1);
  const auto sides = shades({}, 0.03);
  std::vector<int> middles;
  for (const auto& side : sides) {
    ASSERT_GT(side.size(), 1000U);
    EXPECT_LE(side.back() - side.front(), 1) << "around " << side[side.size() / 2];
    middles.push_back(side[side.size() / 2]);
  }
  std::sort(middles.begin(), middles.end());
  EXPECT_GT(middles[1] - middles[0], 10) << "each side has a light of its own";
  EXPECT_GT(middles[2] - middles[1], 10);
}

// A cut of few triangles was made from many, by collapses that mix the normals of edges and sides.
TEST_F(HardEdges, sidesOfCoarseCutsAreShadedAlikeAllOver) {
  buildBox(60);
  for (const std::vector<std::string>& cut : {std::vector<std::string>{},
                                              {"--method", "patches", "--tolerance", "1"},
                                              {"--method", "patches", "--tolerance", "8"}}) {
    for (const auto& side : shades(cut, 0.03)) {
      ASSERT_GT(side.size(), 1000U);
      const int low = side[side.size() / 20], high = side[side.size() - 1 - side.size() / 20];
      EXPECT_LE(high - low, cut.empty() ? 0 : 6) << (cut.empty() ? "leaves" : cut.back());
      EXPECT_LE(side.back() - side.front(), cut.empty() ? 0 : 18) << (cut.empty() ? "leaves" : cut.back());
    }
  }
}

}  // namespace
}  // namespace programs
