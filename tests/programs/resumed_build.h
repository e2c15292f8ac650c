#pragma once
// Builds that are killed on their way and run again: they end with the bytes of an uninterrupted build.
#include <gtest/gtest.h>
#include <sys/types.h>
#include <sys/wait.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "tests/programs/run_program.h"

namespace programs {

/// Whether LUMIGRID_LONG_TESTS asks for more kills and larger meshes.
inline bool longTests() {
  return std::getenv("LUMIGRID_LONG_TESTS") != nullptr;
}

/// 0 where there is no such file.
inline std::uintmax_t sizeOf(const std::string& file) {
  std::error_code error;
  const auto size = std::filesystem::file_size(file, error);
  return error ? 0 : size;
}

class ResumedBuild : public ProgramTest {
 protected:
  using Arguments = std::vector<std::string>;

  std::string sample(const std::string& triangles) {
    const std::string mesh = path("mesh.ply");
    const auto made = run("lumigrid", {"sample", "--triangles", triangles, "-o", mesh});
    EXPECT_EQ(made.status, 0) << made.err;
    return mesh;
  }

  /// The method that is built, the options of every build, and the file that it becomes.
  std::string method_ = "patch";
  Arguments options_;
  std::string file_ = "patch.lgp";

  std::string workFile(const std::string& scene, const std::string& name) const {
    return scene + "/" + file_ + ".work/" + name;
  }
  /// A rerun goes on from a stage once its file is there, a while after the stage is done.
  bool hasStage(const std::string& scene, int stage) const {
    return std::filesystem::exists(workFile(scene, "stage" + std::to_string(stage)));
  }
  Arguments build(const std::string& mesh, const std::string& scene, const Arguments& more = {}) const {
    Arguments arguments{"build", mesh, "-o", scene, "--methods", method_, "--quiet"};
    arguments.insert(arguments.end(), options_.begin(), options_.end());
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }

  /// Builds without interruption; returns the bytes of the file.
  std::string uninterrupted(const std::string& mesh, const Arguments& more = {}) {
    const std::string scene = path("uninterrupted");
    const auto built = run("lumigrid", build(mesh, scene, more));
    EXPECT_EQ(built.status, 0) << built.err;
    description_ = readText(scene + "/scene.json");
    std::string bytes = readText(scene + "/" + file_);
    EXPECT_FALSE(bytes.empty());
    std::filesystem::remove_all(scene);
    return bytes;
  }

  void expectFinished(const std::string& scene, const std::string& bytes, const std::string& what) {
    EXPECT_TRUE(readText(scene + "/" + file_) == bytes) << what << ": other bytes than an uninterrupted build";
    EXPECT_EQ(readText(scene + "/scene.json"), description_) << what;  // counts of repairs among it
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(scene)) names.push_back(entry.path().filename());
    std::erase(names, "build.json");  // tells of the last run that built anything
    std::sort(names.begin(), names.end());
    EXPECT_EQ(names, (std::vector<std::string>{file_, "scene.json"})) << what << ": work files stayed";
  }

  void expectRerunFinishes(const std::string& mesh, const std::string& scene, const std::string& bytes,
                           const std::string& what) {
    const auto rerun = run("lumigrid", build(mesh, scene));
    ASSERT_EQ(rerun.status, 0) << what << ": " << rerun.err;
    expectFinished(scene, bytes, what);
  }

  /// Starts a build and kills it as soon as `now` says so. False: it ended before.
  bool killWhen(const Arguments& arguments, const std::function<bool()>& now) {
    const pid_t pid = start("lumigrid", arguments, path("killed"));
    int status = 0;
    while (!now()) {
      if (::waitpid(pid, &status, WNOHANG) == pid) {
        EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << readText(path("killed.err"));
        return false;
      }
      std::this_thread::sleep_for(std::chrono::microseconds(200));
    }
    ::kill(pid, SIGKILL);
    ::waitpid(pid, &status, 0);
    return WIFSIGNALED(status);
  }

  /// Leaves a scene whose build, on one thread, was killed when `now` said so. A busy machine may look too late, so a
  /// build that is killed once a stage counts has to take a good deal longer than stages take to reach the disk.
  void killedWhen(const std::string& mesh, const std::string& scene, const std::function<bool()>& now,
                  Arguments more = {}) {
    more.insert(more.end(), {"--threads", "1"});
    for (int attempt = 0; attempt < 10; ++attempt) {
      if (killWhen(build(mesh, scene, more), now)) return;
      std::filesystem::remove_all(scene);
    }
    FAIL() << "every build ended before it was killed";
  }

  std::string description_;  // scene.json of the uninterrupted build
};

}  // namespace programs
