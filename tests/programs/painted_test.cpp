// Plans of buildings and machines are painted in a few colours, which say nothing of their shape without a light.
#include <nlohmann/json.hpp>
#include <string>

#include "tests/programs/run_program.h"

namespace {

using programs::readText;
using programs::run;

class PaintedModel : public programs::ProgramTest {
 protected:
  /// Builds a row of cubes, as many as colours, and returns its scene.json.
  nlohmann::json sceneOf(int colors, const std::vector<std::string>& more = {}) {
    std::string vertices, faces, library;
    const int corners[6][4] = {{1, 3, 4, 2}, {5, 6, 8, 7}, {1, 2, 6, 5}, {3, 7, 8, 4}, {1, 5, 7, 3}, {2, 4, 8, 6}};
    for (int i = 0; i < colors; ++i) {
      library += "newmtl m" + std::to_string(i) + "\nKd " + std::to_string((i % 20) / 20.0) + " " +
                 std::to_string((i / 20) / 20.0) + " 0.5\n";
      for (int k = 0; k < 8; ++k)
        vertices += "v " + std::to_string(2 * i + (k & 1)) + " " + std::to_string(k >> 1 & 1) + " " +
                    std::to_string(k >> 2) + "\n";
      faces += "usemtl m" + std::to_string(i) + "\n";
      for (const auto& face : corners) {
        faces += "f";
        for (const int k : face) faces += " " + std::to_string(8 * i + k);
        faces += "\n";
      }
    }
    programs::writeText(path("paint.mtl"), library);
    programs::writeText(path("cubes.obj"), "mtllib paint.mtl\n" + vertices + faces);
    std::vector<std::string> command{"build",     path("cubes.obj"), "-o",      path("scene"),
                                     "--methods", "patch",           "--quiet", "--force"};
    command.insert(command.end(), more.begin(), more.end());
    const auto built = run("lumigrid", command);
    EXPECT_EQ(built.status, 0) << built.err;
    return nlohmann::json::parse(readText(path("scene/scene.json")));
  }
};

TEST_F(PaintedModel, isShadedUnlessItsColoursAreManyOrTheUserSaysOtherwise) {
  const auto few = sceneOf(12);
  EXPECT_EQ(few["has_colors"], true);
  EXPECT_EQ(few["light"]["mode"], "soft");
  EXPECT_EQ(sceneOf(12, {"--light", "unlit"})["light"]["mode"], "unlit");
  const auto many = sceneOf(300);
  EXPECT_EQ(many["has_colors"], true);
  EXPECT_EQ(many["light"]["mode"], "unlit");
}

}  // namespace
