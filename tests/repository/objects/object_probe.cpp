// Reads and writes objects from the command line, for tests/cluster/objectstore.sh. Places are those of
// openObjectSource; endpoint and keys come from the environment (AWS_…).
//
//   object_probe make-bucket s3://BUCKET
//   object_probe put|put-parts PLACE NAME FILE     put-parts: in parts of 5 MiB
//   object_probe size|remove PLACE NAME            size: as a reader sees it
//   object_probe list PLACE PREFIX
//   object_probe mirror PLACE NAME DIRECTORY SHA256
//   object_probe check PLACE NAME FILE COUNT [CACHE]  COUNT random ranges are those of FILE; says so every 100
//
// An error gives one line and exit status 1.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "base/file.h"
#include "repository/objects/cached_source.h"
#include "repository/objects/mirror.h"
#include "repository/objects/open_objects.h"
#include "repository/objects/s3_bucket.h"
#include "repository/objects/s3_objects.h"

namespace {

using namespace repository;
using base::Result;
using Words = std::vector<std::string>;

Result<void> makeBucket(const Words& words) {
  const auto config = readS3Config();
  if (!config) return config.error();
  const auto bucket = S3Bucket::open(words.at(1), *config);
  if (!bucket) return bucket.error();
  const auto response = bucket->send({"PUT", "", {}, {}, {}, 1 << 20});
  if (!response) return response.error();
  if (response->head.status >= 300) return bucket->refusal("", *response);
  return {};
}

Result<std::unique_ptr<ObjectSink>> openSink(const std::string& command, const std::string& place) {
  if (command != "put-parts") return openObjectSink(place);
  auto config = readS3Config();
  if (!config) return config.error();
  config->part_bytes = 5 << 20;
  return openS3Sink(place, *config);
}

Result<void> write(const Words& words) {
  auto sink = openSink(words[0], words.at(1));
  if (!sink) return sink.error();
  if (words[0] == "remove") return (*sink)->remove(words.at(2));
  if (words[0] != "list") return (*sink)->putFile(words.at(2), words.at(3), "application/octet-stream");
  const auto names = (*sink)->list(words.at(2));
  if (!names) return names.error();
  for (const std::string& name : *names) std::printf("%s\n", name.c_str());
  return {};
}

Result<void> checkRanges(const ObjectSource& source, const Words& words) {
  const auto file = base::MappedFile::open(words.at(3));
  if (!file) return file.error();
  const base::ByteView whole = file->bytes();
  std::minstd_rand random(1);
  const int count = std::atoi(words.at(4).c_str());
  for (int i = 1; i <= count; ++i) {
    const std::uint64_t offset = random() % whole.size();
    const std::uint64_t length = std::min<std::uint64_t>(1 + random() % 40000, whole.size() - offset);
    const auto bytes = source.read(words.at(2), offset, length);
    if (!bytes) return bytes.error();
    if (!std::equal(bytes->begin(), bytes->end(), whole.begin() + static_cast<std::ptrdiff_t>(offset)))
      return base::Error{base::ErrorCode::kInvalidInput, "other bytes from " + std::to_string(offset) + " on"};
    if (i % 100 == 0) std::printf("%d\n", i), std::fflush(stdout);
  }
  return {};
}

Result<void> read(const Words& words) {
  auto opened = openObjectSource(words.at(1));
  if (!opened) return opened.error();
  std::shared_ptr<const ObjectSource> source = std::move(*opened);
  if (words[0] == "size") {
    const auto size = source->size(words.at(2));
    if (!size) return size.error();
    std::printf("%llu\n", static_cast<unsigned long long>(*size));
    return {};
  }
  if (words[0] == "mirror") {
    const auto path = mirrorObject(*source, words.at(2), words.at(3), words.at(4));
    return path ? Result<void>() : path.error();
  }
  if (words.size() < 6) return checkRanges(*source, words);
  const auto cached = CachedSource::open(source, words[5], {});
  if (!cached) return cached.error();
  return checkRanges(**cached, words);
}

Result<void> run(const Words& words) {
  for (const char* command : {"put", "put-parts", "remove", "list"})
    if (words[0] == command) return write(words);
  if (words[0] == "make-bucket") return makeBucket(words);
  return read(words);
}

}  // namespace

int main(int argc, char** argv) {
  const Words words(argv + 1, argv + argc);
  if (words.size() < 2) return std::fprintf(stderr, "see the head of object_probe.cpp\n"), 2;
  const auto done = run(words);
  if (!done) return std::fprintf(stderr, "%s\n", done.error().message.c_str()), 1;
  return 0;
}
