// `lumigrid sample` writes what its shapes promise, and says what is wrong with its options.
#include "tests/programs/run_program.h"

namespace {

using programs::expectOneLineError;
using programs::run;

class Sample : public programs::ProgramTest {};

TEST_F(Sample, texturedShapesBringMaterialsAndPictures) {
  for (const std::string shape : {"facade", "terrain"}) {
    const std::vector<std::string> command{"sample",   "--shape", shape, "--triangles",       "200",
                                           "--texels", "50",      "-o",  path(shape + ".obj")};
    ASSERT_EQ(run("lumigrid", command).status, 0);
    for (const char* end : {".obj", ".mtl", "_0.jpg"}) EXPECT_TRUE(std::filesystem::exists(path(shape + end))) << end;
    EXPECT_NE(programs::readText(path(shape + ".obj")).find("mtllib " + shape + ".mtl"), std::string::npos);
    EXPECT_NE(programs::readText(path(shape + ".mtl")).find("map_Kd " + shape + "_0.jpg"), std::string::npos);

    // Nothing is replaced, not even a picture alone.
    std::filesystem::remove(path(shape + ".obj"));
    std::filesystem::remove(path(shape + ".mtl"));
    expectOneLineError(run("lumigrid", command), 1, {shape + "_0.jpg", "exists already", "--force"});
    auto forced = command;
    forced.push_back("--force");
    EXPECT_EQ(run("lumigrid", forced).status, 0);
  }
}

TEST_F(Sample, texturedShapesAreWrittenAsObjOnly) {
  for (const std::string name : {"out.ply", "out", "out.OBJ.jpg"})
    expectOneLineError(run("lumigrid", {"sample", "--shape", "facade", "-o", path(name)}), 2, {name, "NAME.obj"});
  EXPECT_TRUE(std::filesystem::is_empty(directory_));
}

TEST_F(Sample, eachShapeHasItsRangeOfTriangles) {
  const auto sample = [&](const std::string& shape, const std::string& triangles, const std::string& name) {
    return run("lumigrid", {"sample", "--shape", shape, "--triangles", triangles, "-o", path(name)});
  };
  expectOneLineError(sample("statue", "9999", "a.ply"), 2, {"--triangles", "10000", "1000000000"});
  expectOneLineError(sample("terrain", "127", "a.obj"), 2, {"--triangles", "128", "100000000"});
  expectOneLineError(sample("facade", "100000001", "a.obj"), 2, {"--triangles", "128", "100000000"});
  EXPECT_EQ(sample("relief", "10000", "a.ply").status, 0);
  EXPECT_EQ(sample("terrain", "128", "a.obj").status, 0);
}

TEST_F(Sample, optionsOfTheOtherKindOfShapeAreRefused) {
  expectOneLineError(run("lumigrid", {"sample", "--shape", "facade", "--points", "-o", path("a.obj")}), 2,
                     {"facade", "--points"});
  expectOneLineError(run("lumigrid", {"sample", "--texels", "9", "-o", path("a.ply")}), 2, {"statue", "--texels"});
}

}  // namespace
