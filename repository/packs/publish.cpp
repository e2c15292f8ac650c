#include "repository/packs/publish.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "base/check.h"
#include "base/hash/sha256.h"
#include "base/parallel.h"
#include "repository/faces/face_value.h"
#include "repository/packs/pack_format.h"
#include "repository/sampling/parameters.h"

namespace repository {
namespace {

using base::Error;
using base::ErrorCode;
using base::Result;

constexpr const char* kBinary = "application/octet-stream";
constexpr std::uint64_t kTableBytes = 6;  // a pack's table takes 3 to 6 bytes an entry (docs/formats/packs.md, "Sizes")

ObjectId idOf(const base::Sha256Digest& digest) {
  ObjectId id{};
  std::copy_n(digest.begin(), id.size(), id.begin());
  return id;
}

// Faces that are collected for the next pack.
struct PendingPack {
  std::vector<PackEntry> entries;
  base::Bytes values;

  std::uint64_t bytes() const { return kPackHeaderBytes + values.size() + kTableBytes * entries.size(); }

  // The number of entries after which the pack ends when an entry of code `next` would follow. It is the last border of
  // the largest octree cell in the pack's second half, or the end where no border is larger than that one.
  std::size_t entriesBeforeCut(std::uint64_t next) const {
    std::size_t best = entries.size();
    int best_level = std::bit_width(entries.back().code ^ next);
    std::uint64_t left = bytes();
    for (std::size_t i = entries.size() - 1; i > 0; --i) {
      left -= entries[i].length + kTableBytes;
      if (left < bytes() / 2) break;
      const int level = std::bit_width(entries[i - 1].code ^ entries[i].code);
      if (level > best_level) {
        best = i;
        best_level = level;
      }
    }
    return best;
  }
  // Removes and returns the first `count` entries.
  PendingPack takeFront(std::size_t count) {
    std::size_t bytes_of_front = 0;
    for (std::size_t i = 0; i < count; ++i) bytes_of_front += entries[i].length;
    PendingPack front{std::move(entries), std::move(values)};
    entries.assign(front.entries.begin() + static_cast<std::ptrdiff_t>(count), front.entries.end());
    values.assign(front.values.begin() + static_cast<std::ptrdiff_t>(bytes_of_front), front.values.end());
    front.entries.resize(count);
    front.values.resize(bytes_of_front);
    return front;
  }
};

// Writes an object whose name is its hash, unless it is there already. Returns whether it was written.
Result<bool> putOnce(ObjectSink& sink, const std::string& name, base::ByteView bytes, bool rewrite) {
  if (!rewrite) {
    LUMIGRID_ASSIGN_OR_RETURN(auto there, sink.size(name));
    if (there == bytes.size()) return false;
  }
  LUMIGRID_TRY(sink.put(name, bytes, kBinary));
  return true;
}

class Publisher {
 public:
  Publisher(const Store& store, ObjectSink& sink, const PublishOptions& options,
            const std::function<bool(const PublishProgress&)>& go_on)
      : store_(store), sink_(sink), options_(options), go_on_(go_on), pool_(options.jobs, 1) {}

  Result<PublishedImages> run() {
    LUMIGRID_ASSIGN_OR_RETURN(auto total, store_.size());
    LUMIGRID_ASSIGN_OR_RETURN(auto meta, store_.readMeta());
    progress_.keys_total = total;

    const auto walked =
        store_.forEach([&](const FaceKey& key, base::ByteView value) { return !stopped() && addFace(key, value); });
    if (walked && !stopped() && !pending_.entries.empty()) submitPack(pending_.takeFront(pending_.entries.size()));
    pool_.drain();
    if (!walked) return walked.error();
    if (failure_) return *failure_;
    return putIndex(meta.value_or(""));
  }

 private:
  bool addFace(const FaceKey& key, base::ByteView bytes) {
    const auto value = decodeFaceValue(bytes);
    if (!value) return fail(damagedError(key, value.error()));
    if (bytes.size() > kMaxValueBytes)
      return fail({ErrorCode::kUnsupported, nameOf(key) + ": has " + std::to_string(bytes.size()) +
                                                " bytes, packs hold values of up to 64 MiB"});
    const std::uint64_t code = key.code();
    const std::uint32_t length = value->empty ? 0 : static_cast<std::uint32_t>(bytes.size());
    if (!pending_.entries.empty() && pending_.bytes() + kTableBytes + length > options_.pack_bytes)
      submitPack(pending_.takeFront(pending_.entriesBeforeCut(code)));
    // The entries behind the cut may still leave too little room.
    if (!pending_.entries.empty() && pending_.bytes() + kTableBytes + length > options_.pack_bytes)
      submitPack(pending_.takeFront(pending_.entries.size()));

    pending_.entries.push_back({code, length});
    ++progress_.keys_done;
    result_.empty += value->empty ? 1U : 0U;
    if (length != 0) {
      pending_.values.insert(pending_.values.end(), bytes.begin(), bytes.end());
      totals_.value_bytes += length;
      totals_.jpeg_bytes += value->picture.size();
      totals_.coverage_bytes += value->coverage.size();
    }
    return true;
  }

  // Hands a pack to the thread pool, which encodes, hashes and writes it.
  void submitPack(PendingPack pending) {
    builder_.addPack(pending.entries);
    const std::size_t number = packs_++;
    progress_.bytes += pending.bytes();
    auto shared = std::make_shared<PendingPack>(std::move(pending));
    pool_.submit([this, number, shared] { writePack(number, *shared); });
    if (go_on_ && !go_on_(progress_))
      fail({ErrorCode::kCancelled,
            sink_.place() + ": stopped before all was published; the same command goes on from here"});
  }

  void writePack(std::size_t number, PendingPack& pending) {
    if (stopped()) return;
    const base::Bytes pack = encodePack(pending.entries, pending.values);
    pending.values = {};
    const PackRow row{idOf(base::sha256(pack)), pack.size(), pending.entries.front().code, pending.entries.back().code,
                      pending.entries.size()};
    const auto written = putOnce(sink_, packName(row.id), pack, options_.rewrite);
    if (!written) {
      fail(written.error());
      return;
    }
    const std::lock_guard guard(mutex_);
    if (rows_.size() <= number) rows_.resize(number + 1);
    rows_[number] = row;
    result_.pack_bytes += pack.size();
    result_.packs_written += *written ? 1U : 0U;
    result_.bytes_written += *written ? pack.size() : 0U;
  }

  Result<PublishedImages> putIndex(const std::string& parameters) {
    LUMIGRID_ASSIGN_OR_RETURN(auto index, builder_.build(rows_, publishedParameters(parameters), totals_));
    const base::Sha256Digest digest = base::sha256(index);
    result_.index = indexName(idOf(digest));
    result_.index_sha256 = base::hexOf(digest);
    result_.index_bytes = index.size();
    LUMIGRID_ASSIGN_OR_RETURN(const auto root, decodeIndexRoot(index));
    result_.index_front_bytes = root.frontBytes();
    result_.keys = progress_.keys_done;
    for (const PackRow& row : rows_) result_.pack_names.push_back(packName(row.id));
    LUMIGRID_ASSIGN_OR_RETURN(const auto written, putOnce(sink_, result_.index, index, options_.rewrite));
    result_.bytes_written += written ? index.size() : 0U;
    return std::move(result_);
  }

  static Error damagedError(const FaceKey& key, const Error& error) {
    return {error.code, nameOf(key) + ": " + error.message +
                            "; nothing was published: `lumigrid verify` lists what is damaged, `lumigrid build` makes "
                            "it again"};
  }

  // Keeps the first failure and returns false, which ends the walk.
  bool fail(Error error) {
    const std::lock_guard guard(mutex_);
    if (!failure_) failure_ = std::move(error);
    return false;
  }
  bool stopped() {
    const std::lock_guard guard(mutex_);
    return failure_.has_value();
  }

  const Store& store_;
  ObjectSink& sink_;
  const PublishOptions& options_;
  const std::function<bool(const PublishProgress&)>& go_on_;
  PendingPack pending_;
  IndexBuilder builder_;
  std::size_t packs_ = 0;
  PublishProgress progress_;
  ValueTotals totals_;
  std::mutex mutex_;  // guards the members below
  std::optional<Error> failure_;
  std::vector<PackRow> rows_;
  PublishedImages result_;
  base::ThreadPool pool_;  // the last member, so that its threads end before the members that they use
};

}  // namespace

Result<PublishedImages> publishImages(const Store& store, ObjectSink& sink, const PublishOptions& options,
                                      const std::function<bool(const PublishProgress&)>& go_on) {
  LUMIGRID_CHECK_LE(kMinPackTarget, options.pack_bytes);
  LUMIGRID_CHECK_LE(options.pack_bytes, kMaxPackTarget);
  LUMIGRID_CHECK(options.jobs != 0);
  return Publisher(store, sink, options, go_on).run();
}

}  // namespace repository
