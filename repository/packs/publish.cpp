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

namespace repository {
namespace {

using base::Bytes;
using base::ByteView;
using base::Error;
using base::ErrorCode;
using base::Result;

constexpr const char* kBinary = "application/octet-stream";
constexpr std::uint64_t kTableBytes = 6;  // about what an entry takes in its pack's table

ObjectId idOf(const base::Sha256Digest& digest) {
  ObjectId id{};
  std::copy_n(digest.begin(), id.size(), id.begin());
  return id;
}

// Faces on their way into a pack.
struct Portion {
  std::vector<PackEntry> entries;
  Bytes values;

  std::uint64_t bytes() const { return kPackHeaderBytes + values.size() + kTableBytes * entries.size(); }

  // Where to end a pack before an entry of code `next`: in the second half, at the border of the largest octree cell,
  // the last one of those. Nothing there: at the end.
  std::size_t cut(std::uint64_t next) const {
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
  // Takes the first `count` entries off.
  Portion takeFront(std::size_t count) {
    std::size_t bytes_of_front = 0;
    for (std::size_t i = 0; i < count; ++i) bytes_of_front += entries[i].length;
    Portion front{std::move(entries), std::move(values)};
    entries.assign(front.entries.begin() + static_cast<std::ptrdiff_t>(count), front.entries.end());
    values.assign(front.values.begin() + static_cast<std::ptrdiff_t>(bytes_of_front), front.values.end());
    front.entries.resize(count);
    front.values.resize(bytes_of_front);
    return front;
  }
};

// Puts an object of a hashed name there, unless it is. Returns whether it was written.
Result<bool> putOnce(ObjectSink& sink, const std::string& name, ByteView bytes, bool rewrite) {
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
        store_.forEach([&](const FaceKey& key, ByteView value) { return !stopped() && take(key, value); });
    if (walked && !stopped() && !portion_.entries.empty()) emit(portion_.takeFront(portion_.entries.size()));
    pool_.drain();
    if (!walked) return walked.error();
    if (failure_) return *failure_;
    return putIndex(meta.value_or(""));
  }

 private:
  bool take(const FaceKey& key, ByteView bytes) {
    const auto value = decodeFaceValue(bytes);
    if (!value) return fail(damaged(key, value.error()));
    if (bytes.size() > kMaxValueBytes)
      return fail({ErrorCode::kUnsupported, nameOf(key) + ": has " + std::to_string(bytes.size()) +
                                                " bytes, packs hold values of up to 64 MiB"});
    const std::uint64_t code = key.code();
    const std::uint32_t length = value->empty ? 0 : static_cast<std::uint32_t>(bytes.size());
    if (!portion_.entries.empty() && portion_.bytes() + kTableBytes + length > options_.pack_bytes)
      emit(portion_.takeFront(portion_.cut(code)));
    // What was left behind the cut may still leave too little room.
    if (!portion_.entries.empty() && portion_.bytes() + kTableBytes + length > options_.pack_bytes)
      emit(portion_.takeFront(portion_.entries.size()));

    portion_.entries.push_back({code, length});
    ++progress_.keys_done;
    result_.empty += value->empty ? 1U : 0U;
    if (length != 0) {
      portion_.values.insert(portion_.values.end(), bytes.begin(), bytes.end());
      totals_.value_bytes += length;
      totals_.jpeg_bytes += value->jpeg.size();
      totals_.coverage_bytes += value->coverage.size();
    }
    return true;
  }

  // Hands a pack over to be made, hashed and written.
  void emit(Portion portion) {
    builder_.add(portion.entries);
    const std::size_t number = packs_++;
    progress_.bytes += portion.bytes();
    auto shared = std::make_shared<Portion>(std::move(portion));
    pool_.submit([this, number, shared] { writePack(number, *shared); });
    if (go_on_ && !go_on_(progress_))
      fail({ErrorCode::kCancelled,
            sink_.place() + ": stopped before all was published; the same command goes on from here"});
  }

  void writePack(std::size_t number, Portion& portion) {
    if (stopped()) return;
    const Bytes pack = encodePack(portion.entries, portion.values);
    portion.values = {};
    const PackRow row{idOf(base::sha256(pack)), pack.size(), portion.entries.front().code, portion.entries.back().code,
                      portion.entries.size()};
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
    LUMIGRID_ASSIGN_OR_RETURN(auto index, builder_.build(rows_, parameters, totals_));
    const base::Sha256Digest digest = base::sha256(index);
    result_.index = indexName(idOf(digest));
    result_.index_sha256 = base::hexOf(digest);
    result_.index_bytes = index.size();
    result_.keys = progress_.keys_done;
    for (const PackRow& row : rows_) result_.pack_names.push_back(packName(row.id));
    LUMIGRID_ASSIGN_OR_RETURN(const auto written, putOnce(sink_, result_.index, index, options_.rewrite));
    result_.bytes_written += written ? index.size() : 0U;
    return std::move(result_);
  }

  static Error damaged(const FaceKey& key, const Error& error) {
    return {error.code, nameOf(key) + ": " + error.message +
                            "; nothing was published: `lumigrid verify` lists what is damaged, `lumigrid build` makes "
                            "it again"};
  }

  // Keeps the first failure; false, so that a walk ends.
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
  Portion portion_;
  IndexBuilder builder_;
  std::size_t packs_ = 0;
  PublishProgress progress_;
  ValueTotals totals_;
  std::mutex mutex_;  // of the rest
  std::optional<Error> failure_;
  std::vector<PackRow> rows_;
  PublishedImages result_;
  base::ThreadPool pool_;  // last: its threads end before what they use
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
