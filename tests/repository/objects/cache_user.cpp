// Reads through a cache, for tests that kill this process, share its cache or fill its disk.
//
//   cache_user DIRECTORY BUDGET SEED READS [FILE-SIZE-LIMIT]
//
// It prints a line with a number every ten reads. The exit status is 0, or 1 when a read returned other bytes than the
// source's, or 2 when the cache warned. With a limit on the size of files exactly one warning must come.
#include <sys/resource.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <random>
#include <string>

#include "repository/objects/cached_source.h"
#include "tests/repository/made_object.h"

int main(int argc, char** argv) {
  using namespace repository;
  if (argc < 5) return 3;
  RangeCacheOptions options;
  options.bytes = std::strtoull(argv[2], nullptr, 10);
  int warnings = 0;
  options.warn = [&](const std::string& line) {
    std::fprintf(stderr, "%s\n", line.c_str());
    ++warnings;
  };
  std::mt19937 random(static_cast<unsigned>(std::atoi(argv[3])));
  if (argc > 5) {
    const rlim_t bytes = std::strtoull(argv[5], nullptr, 10);
    const rlimit limit{bytes, bytes};
    ::setrlimit(RLIMIT_FSIZE, &limit);
    std::signal(SIGXFSZ, SIG_IGN);
  }

  const auto far = std::make_shared<test::MadeObject>(std::uint64_t{32} << 20);
  const auto cached = CachedSource::open(far, argv[1], options);
  if (!cached) return std::fprintf(stderr, "%s\n", cached.error().message.c_str()), 3;
  for (int i = 0, reads = std::atoi(argv[4]); i < reads; ++i) {
    const std::uint64_t offset = random() % (std::uint64_t{31} << 20);
    const std::uint64_t length = 1 + random() % 200000;
    const auto bytes = (*cached)->read("object", offset, length);
    if (!bytes || *bytes != *far->read("object", offset, length)) return 1;
    if (i % 10 == 9) std::printf("%d\n", i), std::fflush(stdout);
  }
  return warnings == (argc > 5 ? 1 : 0) ? 0 : 2;
}
