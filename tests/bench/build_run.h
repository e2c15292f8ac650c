#pragma once
// `lumigrid build` as a process of its own, and the peer that builds are judged by in the same run.
#include <meshoptimizer.h>
#include <sched.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/bench/bench.h"
#include "tests/support/mesh.h"

namespace bench {

struct Run {
  double wall = 0.0;
  double cpu = 0.0;
  double peak_mb = 0.0;
};

/// Runs a build on the first `threads` cores, and ends the benchmark when it fails.
inline Run runBuild(const std::string& program, const std::string& methods, const std::string& mesh,
                    const std::string& scene, int threads, const std::vector<std::string>& more) {
  std::vector<std::string> arguments{program, "build",   mesh,      "-o",     scene,       "--methods",
                                     methods, "--quiet", "--force", "--json", "--threads", std::to_string(threads)};
  arguments.insert(arguments.end(), more.begin(), more.end());
  const double start = seconds(CLOCK_MONOTONIC);
  std::fflush(stdout);  // or the child prints it again
  const pid_t child = fork();
  if (child == 0) {
    cpu_set_t cores;
    CPU_ZERO(&cores);
    for (int c = 0; c < threads; ++c) CPU_SET(static_cast<std::size_t>(c), &cores);
    sched_setaffinity(0, sizeof(cores), &cores);
    if (std::freopen("/dev/null", "w", stdout) == nullptr) _exit(1);
    std::vector<char*> pointers;
    for (std::string& a : arguments) pointers.push_back(a.data());
    pointers.push_back(nullptr);
    execv(pointers[0], pointers.data());
    _exit(127);
  }
  int status = 0;
  rusage usage{};
  if (child < 0 || wait4(child, &status, 0, &usage) < 0 || status != 0) stop("lumigrid build " + mesh + " failed");
  const auto time = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return {seconds(CLOCK_MONOTONIC) - start, time(usage.ru_utime) + time(usage.ru_stime),
          static_cast<double>(usage.ru_maxrss) / 1e3};
}

/// Returns one level of at most so many triangles of the mesh's vertices.
inline std::vector<unsigned> simplifyByMeshopt(const support::Mesh& mesh, std::size_t triangles) {
  std::vector<unsigned> out(mesh.indices.size());
  const std::size_t left = meshopt_simplify(out.data(), mesh.indices.data(), mesh.indices.size(), &mesh.positions[0].x,
                                            mesh.positions.size(), sizeof(glm::vec3), 3 * triangles, 1.0F, 0, nullptr);
  out.resize(left);
  return out;
}

}  // namespace bench
