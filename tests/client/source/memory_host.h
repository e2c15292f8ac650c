#pragma once
// PublishedScene holds a published scene in memory; MemoryHost hands out ranges of it as a test wants: in any order,
// late, or wrong.
#include <algorithm>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/file.h"
#include "client/source/static_source.h"
#include "lod/patch/group_records.h"
#include "plan/opening_ranges.h"
#include "repository/packs/pack_format.h"
#include "tests/server/session/memory_store.h"
#include "tests/support/byte_ranges.h"
#include "tests/support/sample_points.h"

namespace client {

/// The objects at the host, made from the same scene that a server::Session is given.
struct PublishedScene {
  /// `values_a_pack` is the number of faces in each pack. With a tree only its points have images.
  explicit PublishedScene(const server::TestScene& from, std::size_t values_a_pack = 100,
                          const repository::SampleTree* tree = nullptr)
      : points{from.data.welcome.grid, std::nullopt} {
    if (tree != nullptr) points.tree = *tree;
    scene.place = "https://host/scene";
    scene.welcome = from.data.welcome;
    scene.welcome.group_count = scene.welcome.patch_count = 0;  // the file gives these
    scene.welcome.grid = {};

    const auto patches = base::readFile(from.path);
    LUMIGRID_CHECK(bool(patches));
    scene.patches = {"patch-0123456789abcdef0123456789abcdef.lgp", patches->size()};
    objects[scene.patches.name] = *patches;
    const lod::patch::Hierarchy& hierarchy = from.patches->hierarchy();
    base::Bytes records = lod::patch::encodeRecords(hierarchy, patches->size());
    scene.records = {"records-0123456789abcdef0123456789abcdef.lgr", records.size()};
    auto opening = plan::openingRanges(hierarchy, records);
    LUMIGRID_CHECK(bool(opening));
    scene.records.opening = {opening->records};
    scene.patches.opening = std::move(opening->blocks);
    objects[scene.records.name] = std::move(records);
    addImages(from, values_a_pack);
  }

  ReadParameters readParameters() const {
    return [points = points](const std::string& text) -> base::Result<repository::SampledPoints> {
      if (text != kParameters) return base::Error{base::ErrorCode::kInvalidInput, "other parameters"};
      return points;
    };
  }
  std::string indexName() const { return scene.index->name; }
  std::vector<std::string> packNames() const {
    std::vector<std::string> names;
    for (const auto& [name, bytes] : objects)
      if (repository::idOfPackName(name)) names.push_back(name);
    return names;
  }

  static constexpr const char* kParameters = "{\"grid\": \"as the test says\"}";
  StaticScene scene;
  repository::SampledPoints points;
  std::map<std::string, base::Bytes> objects;

 private:
  void addImages(const server::TestScene& from, std::size_t values_a_pack) {
    std::map<std::uint64_t, base::Bytes> values;
    for (const auto& [key, value] : from.store.values)
      if (points.treeOrNull() == nullptr || support::hasPoint(*points.tree, points.grid, {key.x, key.y, key.z}))
        values[key.code()] = value;
    repository::IndexBuilder builder;
    std::vector<repository::PackRow> rows;
    std::vector<repository::PackEntry> entries;
    base::Bytes bytes;
    const auto flush = [&] {
      if (entries.empty()) return;
      repository::ObjectId id{};
      id[0] = static_cast<std::uint8_t>(rows.size());
      id[1] = 0x77;
      const base::Bytes pack = repository::encodePack(entries, bytes);
      rows.push_back({id, pack.size(), entries.front().code, entries.back().code, entries.size()});
      builder.addPack(entries);
      objects[repository::packName(id)] = pack;
      entries.clear();
      bytes.clear();
    };
    for (const auto& [code, value] : values) {
      const bool empty = value == repository::encodeFaceValue({});
      entries.push_back({code, empty ? 0U : static_cast<std::uint32_t>(value.size())});
      if (!empty) bytes.insert(bytes.end(), value.begin(), value.end());
      if (entries.size() == values_a_pack) flush();
    }
    flush();
    auto index = builder.build(rows, kParameters, {});
    LUMIGRID_CHECK(bool(index));
    scene.index = StaticObject{
        repository::indexName({9, 9, 9}), index->size(), {{0, repository::decodeIndexRoot(*index)->frontBytes()}}};
    objects[scene.index->name] = std::move(*index);
  }
};

struct HostRequest {
  std::string name;
  std::uint64_t offset = 0, length = 0;
};

class MemoryHost final : public RangeFetcher {
 public:
  explicit MemoryHost(const PublishedScene& published) : objects(published.objects) {}

  void submit(std::uint64_t id, const std::string& name, std::uint64_t offset, std::uint64_t length) override {
    LUMIGRID_CHECK(length > 0 && length < (1U << 20));
    requests.push_back({name, offset, length});
    waiting_.push_back({id, requests.back()});
    most_under_way = std::max(most_under_way, waiting_.size());
  }
  /// Returns all waiting answers, or the next `answers_a_take` in random order when a seed was given.
  std::vector<FetchAnswer> takeAnswers() override {
    std::vector<FetchAnswer> out;
    if (held) return out;
    if (random) std::shuffle(waiting_.begin(), waiting_.end(), *random);
    while (!waiting_.empty() && out.size() < answers_a_take) {
      out.push_back(answer(waiting_.front().first, waiting_.front().second));
      waiting_.pop_front();
    }
    if (!out.empty()) ++round_trips;
    return out;
  }
  void cancel(std::uint64_t id) override {
    std::erase_if(waiting_, [id](const auto& one) { return one.first == id; });
  }

  /// Returns the number of bytes that were sent more than once, over all objects.
  std::uint64_t bytesRepeated() const { return support::bytesRepeated(sent_); }
  std::size_t waiting() const { return waiting_.size(); }

  std::map<std::string, base::Bytes> objects;
  std::vector<HostRequest> requests;
  std::uint64_t bytes_sent = 0;
  std::size_t round_trips = 0, most_under_way = 0;
  std::size_t answers_a_take = 1000;
  bool held = false;  ///< keeps all answers back
  std::optional<std::mt19937> random;
  /// Returns the failure that a request meets.
  std::function<std::optional<FetchOutcome>(const HostRequest&)> trouble;

 private:
  FetchAnswer answer(std::uint64_t id, const HostRequest& request) {
    if (const auto outcome = trouble ? trouble(request) : std::nullopt) {
      const std::map<FetchOutcome, int> statuses{{FetchOutcome::kNotFound, 404},     {FetchOutcome::kForbidden, 403},
                                                 {FetchOutcome::kRangeIgnored, 200}, {FetchOutcome::kCompressed, 206},
                                                 {FetchOutcome::kChanged, 206},      {FetchOutcome::kTooShort, 416},
                                                 {FetchOutcome::kServer, 503}};
      const auto status = statuses.find(*outcome);
      return {id, *outcome, {}, status == statuses.end() ? 0 : status->second, "made up"};
    }
    const auto it = objects.find(request.name);
    if (it == objects.end()) return {id, FetchOutcome::kNotFound, {}, 404, ""};
    if (request.offset + request.length > it->second.size()) return {id, FetchOutcome::kTooShort, {}, 416, ""};
    bytes_sent += request.length;
    sent_[request.name].emplace_back(request.offset, request.offset + request.length);
    const auto first = it->second.begin() + static_cast<std::ptrdiff_t>(request.offset);
    return {id, FetchOutcome::kBytes, {first, first + static_cast<std::ptrdiff_t>(request.length)}, 206, ""};
  }

  std::deque<std::pair<std::uint64_t, HostRequest>> waiting_;
  support::ByteRanges sent_;
};

}  // namespace client
