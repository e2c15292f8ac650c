// Measures what publishing costs, and compares reading packs with reading LMDB: the same values, from the same disk, in
// one run.
//
//   pack_bench [--faces N] [--bytes N] [--work DIRECTORY] [--pack-size BYTES]
//
// Publishing is compared with a copy of the store's file (read, write, fsync), and reads of single faces and of
// neighbourhoods with those from LMDB. Everything has been read once before it is timed, so the times are those of CPU
// and system calls, not of the disk.
#include <cstdio>
#include <filesystem>
#include <random>
#include <string>
#include <vector>

#include "base/file.h"
#include "repository/faces/face_value.h"
#include "repository/packs/pack_store.h"
#include "repository/packs/publish.h"
#include "repository/store.h"
#include "tests/bench/bench.h"

namespace {

using bench::must;
using bench::stop;
using repository::FaceKey;

struct Arguments {
  std::uint32_t faces = 60000;
  std::uint32_t bytes = 20000;
  std::string work = std::filesystem::temp_directory_path().string();
  repository::PublishOptions publish;
};

Arguments parse(int argc, char** argv) {
  bench::Arguments given(argc, argv,
                         "[--faces 48 or more] [--bytes N] [--work DIRECTORY] [--pack-size BYTES, 1 to 64 MiB]");
  Arguments a;
  a.faces = given.number("--faces", a.faces, 48U, 1'000'000'000U);
  a.bytes = given.number("--bytes", a.bytes, 1U, 1U << 24);
  a.work = given.text("--work", a.work);
  a.publish.pack_bytes =
      given.number("--pack-size", a.publish.pack_bytes, repository::kMinPackTarget, repository::kMaxPackTarget);
  given.finish();
  if (!given.input().empty()) given.wrong();
  return a;
}

// The points of a cube with all six faces. Values have half to one and a half times the length asked for, and one in
// five is empty.
std::uint32_t sideOf(std::uint32_t faces) {
  std::uint32_t side = 2;
  while ((side + 1) * (side + 1) * (side + 1) * 6 <= faces) ++side;
  return side;
}

std::uint64_t fill(repository::Store& store, std::uint32_t side, std::uint32_t bytes) {
  std::mt19937 random(1);
  std::uint64_t total = 0;
  for (std::uint32_t z = 0; z < side; ++z) {
    std::vector<std::pair<FaceKey, base::Bytes>> batch;
    for (std::uint32_t i = 0; i < side * side * 6; ++i) {
      repository::FaceValue value;
      base::Bytes jpeg(bytes / 2 + random() % bytes + 1);
      value.empty = random() % 5 == 0;
      for (std::size_t at = 0; at < jpeg.size(); at += 64) jpeg[at] = static_cast<std::uint8_t>(random());
      if (!value.empty) value.picture = jpeg;
      batch.emplace_back(FaceKey{i / 6 % side, i / 6 / side, z, i % 6}, repository::encodeFaceValue(value));
      total += batch.back().second.size();
    }
    must(store.putBatch(batch));
  }
  return total;
}

// A durable copy of the same bytes from one file to another is the lower limit.
double copySeconds(const std::string& from, const std::string& to) {
  const double start = bench::seconds();
  const base::MappedFile source = must(base::MappedFile::open(from));
  auto file = must(base::AtomicFile::create(to));
  must(file.write(source.bytes()));
  must(file.commit());
  return bench::seconds() - start;
}

std::vector<std::vector<FaceKey>> randomKeys(std::uint32_t side, std::size_t groups, bool neighbourhoods) {
  std::mt19937 random(7);
  std::vector<std::vector<FaceKey>> keys(groups);
  for (auto& group : keys) {
    const FaceKey corner{static_cast<std::uint32_t>(random() % (side - 1)),
                         static_cast<std::uint32_t>(random() % (side - 1)),
                         static_cast<std::uint32_t>(random() % (side - 1)), static_cast<std::uint32_t>(random() % 6)};
    if (!neighbourhoods) group.push_back(corner);
    for (std::uint32_t i = 0; neighbourhoods && i < 48; ++i)
      group.push_back({corner.x + (i / 6 & 1), corner.y + (i / 12 & 1), corner.z + i / 24, i % 6});
  }
  return keys;
}

// Returns the seconds that all groups take, after one round that warms caches.
double readSeconds(const repository::Store& store, const std::vector<std::vector<FaceKey>>& groups) {
  double seconds = 0.0;
  for (int round = 0; round < 2; ++round) {
    const double start = bench::seconds();
    for (const auto& keys : groups)
      for (auto& value : store.getMany(keys))
        if (!value || !value->has_value()) stop(value ? "a face is missing" : value.error().message);
    seconds = bench::seconds() - start;
  }
  return seconds;
}

// Reads from LMDB and checks each value's checksum, as a session does.
double checkedSeconds(const repository::Store& store, const std::vector<std::vector<FaceKey>>& groups) {
  const double start = bench::seconds();
  for (const auto& keys : groups)
    for (auto& value : store.getMany(keys))
      if (!value || !value->has_value() || !repository::decodeFaceValue(**value)) stop("a face is missing or damaged");
  return bench::seconds() - start;
}

// Counts the ranges that are read.
class CountingSource final : public repository::ObjectSource {
 public:
  explicit CountingSource(std::unique_ptr<ObjectSource> source) : source_(std::move(source)) {}
  base::Result<base::Bytes> read(const std::string& name, std::uint64_t offset, std::uint64_t length) const override {
    ++reads;
    return source_->read(name, offset, length);
  }
  base::Result<std::uint64_t> size(const std::string& name) const override { return source_->size(name); }
  const std::string& place() const override { return source_->place(); }
  mutable std::uint64_t reads = 0;

 private:
  std::unique_ptr<ObjectSource> source_;
};

void compareReads(const repository::Store& lmdb, const repository::PackStore& packs, const CountingSource& source,
                  std::uint32_t side, bool neighbourhoods) {
  const auto groups = randomKeys(side, neighbourhoods ? 400 : 10000, neighbourhoods);
  const double count = static_cast<double>(groups.size());
  readSeconds(lmdb, groups);
  const double theirs = checkedSeconds(lmdb, groups);
  readSeconds(packs, groups);
  const std::uint64_t before = source.reads;
  const double ours = readSeconds(packs, groups);
  const double ranges = static_cast<double>(source.reads - before) / 2.0 / count;
  std::printf("%s: LMDB %.1f us, packs %.1f us: %.2f times as long; %.2f ranges each\n",
              neighbourhoods ? "48 faces around a cell" : "one face", theirs / count * 1e6, ours / count * 1e6,
              ours / theirs, ranges);
}

void run(const Arguments& a, const bench::WorkDirectory& work) {
  const std::uint32_t side = sideOf(a.faces);
  auto lmdb = must(repository::openLmdbStore(work / "images", repository::StoreMode::kWrite));
  const std::uint64_t bytes = fill(*lmdb, side, a.bytes);
  const double megabytes = static_cast<double>(bytes) / 1e6;
  std::printf("%u faces, %.0f MB\n", side * side * side * 6, megabytes);

  copySeconds(work / "images/data.mdb", work / "copy");
  const double copy = copySeconds(work / "images/data.mdb", work / "copy");
  auto sink = must(repository::openDirectorySink(work / "out"));
  double start = bench::seconds();
  const auto published = must(repository::publishImages(*lmdb, *sink, a.publish));
  const double first = bench::seconds() - start;
  start = bench::seconds();
  must(repository::publishImages(*lmdb, *sink, a.publish));
  const double again = bench::seconds() - start;
  std::printf(
      "publish: %.0f MB/s in %zu packs, %.2f of a durable copy of the store (%.0f MB/s); again, nothing new: "
      "%.0f MB/s\n",
      megabytes / first, published.pack_names.size(), copy / first, megabytes / copy, megabytes / again);
  std::printf("index: %.1f bytes a face\n",
              static_cast<double>(published.index_bytes) / static_cast<double>(published.keys));

  auto source = std::make_shared<CountingSource>(must(repository::openDirectorySource(work / "out")));
  auto packs = must(repository::PackStore::open(source, published.index));
  compareReads(*lmdb, *packs, *source, side, false);
  compareReads(*lmdb, *packs, *source, side, true);
}

}  // namespace

int main(int argc, char** argv) {
  const Arguments a = parse(argc, argv);
  run(a, bench::WorkDirectory(a.work));
  return 0;
}
