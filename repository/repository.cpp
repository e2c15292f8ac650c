#include "repository/repository.h"

#include <algorithm>
#include <filesystem>
#include <mutex>
#include <shared_mutex>
#include <utility>

#include "base/file.h"
#include "repository/sampling/parameters.h"

namespace repository {
namespace {

using base::Error;
using base::ErrorCode;
using base::Result;

// A reader may map thousands of shards, so each begins with 1 GiB of address space and grows to its file's size.
constexpr LmdbOptions kShardMap{std::uint64_t{1} << 30};

Error mixed(const std::string& images, const std::string& problem) {
  return {ErrorCode::kInvalidInput,
          images + ": " + problem +
              "; remove the directories that do not belong here, or run the same `lumigrid build` again"};
}

Error otherParameters(const std::string& images, const Shard& shard, const std::string& meta, const std::string& own) {
  return mixed(images, "its shards were built with different parameters: " + firstDifference(meta, own) + " in " +
                           directoryNameOf(shard));
}

// The number of shards that the directories show; 0 where the repository is not divided.
Result<std::uint32_t> shardCountOf(const std::string& images) {
  LUMIGRID_ASSIGN_OR_RETURN(auto layout, layoutOf(images));
  if (layout.shards.empty()) return std::uint32_t{0};
  const std::uint32_t count = layout.shards.front().count;
  if (layout.undivided)
    return mixed(images, "holds both an undivided repository and one in " + std::to_string(count) + " shards");
  if (layout.shards.back().count != count)
    return mixed(images,
                 "holds shards of " + std::to_string(count) + " and of " + std::to_string(layout.shards.back().count));
  return count;
}

// Reads all shards of a repository as one store and opens each of them when it appears. Safe from any thread.
class ShardedStore final : public Store {
 public:
  ShardedStore(std::string images, std::uint32_t count) : images_(std::move(images)), stores_(count) {}

  // Opens all shards that exist; kNotFound when there are none.
  Result<void> openAll() {
    for (std::uint32_t i = 0; i < stores_.size(); ++i) {
      if (auto opened = shard(i); !opened) return opened.error();
    }
    if (meta_.empty())
      return Error{ErrorCode::kNotFound, images_ + ": the image repository is empty; build it with lumigrid build"};
    return {};
  }

  Result<std::optional<base::Bytes>> get(const FaceKey& key) const override {
    LUMIGRID_ASSIGN_OR_RETURN(auto store, storeOf(key));
    return store == nullptr ? Result<std::optional<base::Bytes>>(std::optional<base::Bytes>()) : store->get(key);
  }
  Result<std::optional<std::uint64_t>> valueBytes(const FaceKey& key) const override {
    LUMIGRID_ASSIGN_OR_RETURN(auto store, storeOf(key));
    return store == nullptr ? Result<std::optional<std::uint64_t>>(std::nullopt) : store->valueBytes(key);
  }

  Result<void> forEach(const std::function<bool(const FaceKey&, base::ByteView)>& visit) const override {
    return inEachShard([&](const Store& store, std::uint32_t index, bool& going) {
      return store.forEach([&](const FaceKey& key, base::ByteView value) {
        return !belongs(key, index) || (going = visit(key, value));
      });
    });
  }
  Result<void> forEachKey(const std::function<bool(const FaceKey&)>& visit) const override {
    return inEachShard([&](const Store& store, std::uint32_t index, bool& going) {
      return store.forEachKey([&](const FaceKey& key) { return !belongs(key, index) || (going = visit(key)); });
    });
  }
  Result<std::uint64_t> size() const override {
    std::uint64_t sum = 0;
    LUMIGRID_TRY(inEachShard([&](const Store& store, std::uint32_t, bool&) -> Result<void> {
      LUMIGRID_ASSIGN_OR_RETURN(auto one, store.size());
      sum += one;
      return {};
    }));
    return sum;
  }
  Result<std::optional<std::string>> readMeta() const override {
    const std::shared_lock lock(mutex_);
    return meta_.empty() ? std::optional<std::string>() : std::optional(meta_);
  }

 private:
  Error readOnlyError() const override {
    return {ErrorCode::kUnsupported, images_ + ": shards are written one by one; this opens all of them for reading"};
  }

  bool belongs(const FaceKey& key, std::uint32_t index) const {
    return grid_.contains(key) && lookup_->shardOf(key) == index;
  }

  // Calls body(store, index, going) for each shard that exists, until it sets `going` to false.
  template <class Body>
  Result<void> inEachShard(const Body& body) const {
    bool going = true;
    for (std::uint32_t i = 0; going && i < stores_.size(); ++i) {
      LUMIGRID_ASSIGN_OR_RETURN(auto store, shard(i));
      if (store != nullptr) LUMIGRID_TRY(body(*store, i, going));
    }
    return {};
  }

  Result<const Store*> storeOf(const FaceKey& key) const {
    {
      const std::shared_lock lock(mutex_);
      if (!grid_.contains(key)) return static_cast<const Store*>(nullptr);
    }
    return shard(lookup_->shardOf(key));
  }

  // The shard's store; null as long as its file does not exist. Opens it when the file has appeared.
  Result<const Store*> shard(std::uint32_t index) const {
    {
      const std::shared_lock lock(mutex_);
      if (stores_[index] != nullptr) return static_cast<const Store*>(stores_[index].get());
    }
    const std::string path = storeDirectory(images_, static_cast<std::uint32_t>(stores_.size()), index);
    if (!isLmdbStore(path)) return static_cast<const Store*>(nullptr);

    const std::unique_lock lock(mutex_);
    if (stores_[index] == nullptr) LUMIGRID_TRY(open(index, path));
    return static_cast<const Store*>(stores_[index].get());
  }

  // Opens a shard whose parameters equal those of the others. A shard that was made a moment ago has no parameters yet
  // and stays closed.
  Result<void> open(std::uint32_t index, const std::string& path) const {
    auto store = openLmdbStore(path, StoreMode::kRead, kShardMap);
    if (!store) return store.error().code == ErrorCode::kNotFound ? Result<void>() : Result<void>(store.error());
    LUMIGRID_ASSIGN_OR_RETURN(auto meta, (*store)->readMeta());
    if (!meta) return {};
    if (meta_.empty()) {
      LUMIGRID_ASSIGN_OR_RETURN(grid_, gridFromMeta(*meta, path));
      lookup_.emplace(grid_, static_cast<std::uint32_t>(stores_.size()));
      meta_ = std::move(*meta);
    } else if (meta_ != *meta) {
      return otherParameters(images_, {index, static_cast<std::uint32_t>(stores_.size())}, meta_, *meta);
    }
    stores_[index] = std::move(*store);
    return {};
  }

  const std::string images_;
  mutable std::shared_mutex mutex_;
  mutable std::vector<std::unique_ptr<Store>> stores_;
  mutable std::string meta_;  // parameters of all shards; empty before the first one is open
  mutable Grid grid_;         // set together with meta_ and lookup_, and never changed again
  mutable std::optional<ShardLookup> lookup_;
};

// Checks a store's parameters: they must equal those of the other stores, `meta`, and record the scene's grid.
Result<void> checkMeta(const std::string& own, const Grid& grid, const std::string& images, const Shard& shard,
                       std::string& meta) {
  if (!meta.empty()) return meta == own ? Result<void>() : Result<void>(otherParameters(images, shard, meta, own));
  LUMIGRID_ASSIGN_OR_RETURN(auto recorded, gridFromMeta(own, images));
  meta = own;
  if (recorded == grid) return {};
  return Error{ErrorCode::kInvalidInput,
               images + ": holds images of another grid than the scene's; build the scene again with --force"};
}

// Finds the gaps of one store after the other for findMissing().
class MissingFinder {
 public:
  MissingFinder(const std::string& images, const Grid& grid, const SampleTree* tree, bool to_replace)
      : images_(images), grid_(grid), tree_(tree), to_replace_(to_replace) {}

  Result<ShardGaps> findGaps(const std::string& directory, const Shard& shard) {
    ShardGaps missing{shard, 0, isBeingWritten(directory), {}};
    std::unique_ptr<Store> store;
    if (!missing.being_written) {
      auto opened = openLmdbStore(directory, StoreMode::kRead, kShardMap);
      if (!opened && opened.error().code != ErrorCode::kNotFound) return opened.error();
      if (opened) store = std::move(*opened);
    }
    LUMIGRID_ASSIGN_OR_RETURN(const auto own_tree, treeOf(store.get(), shard));
    const ExpectedPoints points(grid_, shard, own_tree ? &*own_tree : tree_);
    GapFinder finder(points);
    if (store && !to_replace_)
      LUMIGRID_TRY(store->forEachKey([&](const FaceKey& key) {
        if (grid_.contains(key)) finder.addPresentKey(key);
        return true;
      }));
    finder.finish();
    missing.gaps = finder.gaps();
    for (const Gap& gap : missing.gaps) missing.faces += gap.faces;
    return missing;
  }

 private:
  // The tree in a store's parameters; nothing for a store that was made a moment ago and has no parameters yet.
  Result<std::optional<SampleTree>> treeOf(const Store* store, const Shard& shard) {
    if (store == nullptr) return std::optional<SampleTree>();
    LUMIGRID_ASSIGN_OR_RETURN(auto own, store->readMeta());
    if (!own) return std::optional<SampleTree>();
    LUMIGRID_TRY(checkMeta(*own, grid_, images_, shard, meta_));
    return treeFromText(*own, grid_, images_);
  }

  const std::string& images_;
  const Grid& grid_;
  const SampleTree* tree_;
  const bool to_replace_;
  std::string meta_;  // parameters of all stores; empty before the first store that has any
};

}  // namespace

Result<Layout> layoutOf(const std::string& images) {
  Layout layout;
  layout.undivided = isLmdbStore(images);
  std::error_code error;
  for (std::filesystem::directory_iterator it(images, error), end; !error && it != end; it.increment(error)) {
    if (const auto shard = shardOfDirectoryName(it->path().filename().string())) layout.shards.push_back(*shard);
  }
  if (error && error != std::errc::no_such_file_or_directory) return base::systemError(images, "list", error.value());
  std::sort(layout.shards.begin(), layout.shards.end(),
            [](const Shard& a, const Shard& b) { return std::pair(a.count, a.index) < std::pair(b.count, b.index); });
  return layout;
}

std::string storeDirectory(const std::string& images, std::uint32_t shards, std::uint32_t index) {
  return shards == 0 ? images : images + "/" + directoryNameOf({index, shards});
}

Result<std::unique_ptr<Store>> openRepository(const std::string& images, std::optional<std::uint32_t> shards) {
  if (!shards) {
    LUMIGRID_ASSIGN_OR_RETURN(shards, shardCountOf(images));
  }
  if (*shards == 0) return openLmdbStore(images, StoreMode::kRead);
  auto store = std::make_unique<ShardedStore>(images, *shards);
  LUMIGRID_TRY(store->openAll());
  return std::unique_ptr<Store>(std::move(store));
}

Result<std::vector<ShardGaps>> findMissing(const std::string& images, std::uint32_t shards, const Grid& grid,
                                           const SampleTree* tree, bool to_replace) {
  const std::uint32_t count = std::max(shards, 1U);
  std::vector<ShardGaps> missing;
  MissingFinder finder(images, grid, tree, to_replace);
  for (std::uint32_t i = 0; i < count; ++i) {
    LUMIGRID_ASSIGN_OR_RETURN(auto one, finder.findGaps(storeDirectory(images, shards, i), {i, count}));
    if (one.faces > 0) missing.push_back(std::move(one));
  }
  return missing;
}

}  // namespace repository
