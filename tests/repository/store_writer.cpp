// Writes batches into a store until it is killed, and prints the number of each committed batch on a line.
//
//   store_writer DIRECTORY FIRST COUNT [MAP_BYTES]
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <string>

#include "repository/store.h"
#include "tests/repository/sample_values.h"

int main(int argc, char** argv) {
  if (argc < 4) return 2;
  repository::LmdbOptions options;
  if (argc > 4) options.map_bytes = std::strtoull(argv[4], nullptr, 10);
  auto store = repository::openLmdbStore(argv[1], repository::StoreMode::kWrite, options);
  if (!store) {
    std::fprintf(stderr, "%s\n", store.error().message.c_str());
    return 1;
  }
  const auto first = static_cast<std::uint32_t>(std::strtoul(argv[2], nullptr, 10));
  const auto count = static_cast<std::uint32_t>(std::strtoul(argv[3], nullptr, 10));
  for (std::uint32_t batch = first; batch < first + count; ++batch) {
    if (const auto put = (*store)->putBatch(repository::test::batchOf(batch)); !put) {
      std::fprintf(stderr, "%s\n", put.error().message.c_str());
      return 1;
    }
    const std::string line = std::to_string(batch) + "\n";
    if (::write(STDOUT_FILENO, line.data(), line.size()) < 0) return 1;
  }
  return 0;
}
