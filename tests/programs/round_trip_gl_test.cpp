// A scene that is exported as 3D Tiles and built again shows the same picture, with its texture.
#include <cmath>
#include <cstdlib>

#include "base/png/png.h"
#include "tests/programs/run_program.h"

namespace programs {
namespace {

class RoundTrip : public ProgramTest {
 protected:
  void done(const std::string& command, const std::vector<std::string>& arguments) {
    const Outcome outcome = run(command, arguments);
    ASSERT_EQ(outcome.status, 0) << outcome.err;
  }
  base::Image picture(const std::string& scene) {
    done("lumigrid", {"render", path(scene), "--camera", path("camera.json"), "-o", path(scene + ".png")});
    auto image = base::readPng(path(scene + ".png"));
    EXPECT_TRUE(image);
    return image ? std::move(*image) : base::Image();
  }
};

TEST_F(RoundTrip, tilesThatAreReadBackShowTheSamePicture) {
  done("lumigrid", {"sample", "--shape", "facade", "--triangles", "5000", "--texels", "300", "-o", path("facade.obj")});
  done("lumigrid", {"build", path("facade.obj"), "-o", path("scene"), "--methods", "patch", "--up", "y", "--quiet"});
  done("lumigrid", {"export", path("scene"), "--3dtiles", path("tiles")});
  done("lumigrid", {"build", path("tiles/tileset.json"), "-o", path("again"), "--methods", "patch", "--quiet"});
  writeText(path("camera.json"), R"({"position":[6,5,16],"target":[10,6,0],"up":[0,1,0],"width":640,"height":360})");
  const base::Image first = picture("scene"), second = picture("again");
  ASSERT_EQ(first.pixels.size(), second.pixels.size());

  double difference = 0.0, inside = 0.0;
  int outlines = 0;
  for (std::size_t i = 0; i + 3 < first.pixels.size(); i += 4) {
    if ((first.pixels[i + 3] > 0) != (second.pixels[i + 3] > 0)) ++outlines;
    if (first.pixels[i + 3] < 255 || second.pixels[i + 3] < 255) continue;
    for (std::size_t k = 0; k < 3; ++k) difference += std::abs(first.pixels[i + k] - second.pixels[i + k]);
    inside += 3.0;
  }
  ASSERT_GT(inside, 0.2 * 3.0 * 640.0 * 360.0);
  EXPECT_LT(difference / inside, 1.0);
  EXPECT_LE(outlines, 20);
}

}  // namespace
}  // namespace programs
