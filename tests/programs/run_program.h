#pragma once
// Runs the built programs as a user would, in a directory of the test's own.
#include <gtest/gtest.h>
#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace programs {

struct Outcome {
  int status = 0;  ///< exit status; 128 + n when killed by signal n
  std::string out, err;
  /// Most resident memory of the process, by the kernel's account (wait4). The test's own memory when it started the
  /// process is a lower bound.
  std::uint64_t peak_memory_bytes = 0;
};

/// Runs bin/<program> with arguments and waits.
Outcome run(const std::string& program, const std::vector<std::string>& arguments);

/// Starts the program with standard output and error into files `<log>.out`, `<log>.err`; the caller waits.
pid_t start(const std::string& program, const std::vector<std::string>& arguments, const std::string& log);
/// Waits; the status as in Outcome. `peak_memory_bytes`: where to put it, or null.
int wait(pid_t pid, std::uint64_t* peak_memory_bytes = nullptr);

std::string readText(const std::string& path);
void writeText(const std::string& path, const std::string& text);

/// Gives each test a directory that lives as long as it.
class ProgramTest : public ::testing::Test {
 protected:
  void SetUp() override;
  void TearDown() override { std::filesystem::remove_all(directory_); }
  std::string path(const std::string& name) const { return (directory_ / name).string(); }
  /// Generates a small mesh (10,000 triangles); its path.
  std::string smallMesh();
  /// Builds a small scene of it (grid 3, faces of 64 pixels); its path.
  std::string smallScene();
  std::filesystem::path directory_;
};

/// Expects status, exactly one line on standard error that contains every given piece.
void expectOneLineError(const Outcome& outcome, int status, const std::vector<std::string>& pieces);

}  // namespace programs
