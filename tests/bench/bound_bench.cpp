// bound_bench MESH [ROUNDS] measures the time of the error bound beside that of simplification, round by round to half
// of the triangles, in CPU seconds of one thread, and prints the largest bound in lattice steps (16 bits).
#include <algorithm>
#include <cstdio>
#include <cstdlib>

#include "lod/patch/builder/distance_bound.h"
#include "tests/bench/bench.h"
#include "tests/lod/patch/builder/simplify_in_place.h"
#include "tests/support/mesh_reader.h"

int main(int count, char** arguments) {
  using namespace lod::patch::builder;
  if (count < 2) return std::fprintf(stderr, "usage: bound_bench MESH [ROUNDS]\n"), 2;
  const int rounds = count > 2 ? std::max(1, std::atoi(arguments[2])) : 5;
  const support::Mesh mesh = bench::must(support::readMesh(arguments[1])).mesh;
  const glm::vec3 size = mesh.box().size();
  const float scale = 65535.0F / std::max({size.x, size.y, size.z});
  GroupMesh group;
  for (const glm::vec3& p : mesh.positions) group.positions.push_back(glm::round((p - mesh.box().min) * scale));
  group.normals.assign(group.positions.size(), glm::vec3(0.0F, 0.0F, 1.0F));
  group.locked.assign(group.positions.size(), 0);
  group.indices = mesh.indices;
  SurfaceError error;
  for (int round = 0; round < rounds; ++round) {
    const std::vector<glm::vec3> positions = group.positions;
    const std::vector<std::uint32_t> indices = group.indices;
    const double start = bench::seconds(CLOCK_THREAD_CPUTIME_ID);
    const CollapseHistory made = simplifyInPlace(group, indices.size() / 6);
    const double middle = bench::seconds(CLOCK_THREAD_CPUTIME_ID);
    FacetSurface surface;
    surface.reset({positions, indices});
    TypicalError typical;
    error = carryError(surface, error, {group.positions, made.indices}, made, 0.5F, &typical);
    const double end = bench::seconds(CLOCK_THREAD_CPUTIME_ID);
    group.indices = made.indices;
    std::printf(
        "%9zu triangles to %9zu: simplify %.3f s, bound %.3f s (%.2f); toward %.1f, from %.1f, typically %.2f steps\n",
        indices.size() / 3, made.indices.size() / 3, middle - start, end - middle, (end - middle) / (middle - start),
        *std::max_element(error.toward.begin(), error.toward.end()),
        *std::max_element(error.from.begin(), error.from.end()), static_cast<double>(typical.distance));
  }
  return 0;
}
