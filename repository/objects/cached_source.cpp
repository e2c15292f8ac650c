#include "repository/objects/cached_source.h"

#include <algorithm>
#include <cstring>
#include <optional>

#include "base/hash/sha256.h"

namespace repository {

using base::Bytes;
using base::Error;
using base::ErrorCode;
using base::Result;

// A block that a read needs. It is found in the cache, fetched by this thread, or fetched by another one.
struct CachedSource::BlockRequest {
  std::uint64_t number = 0;
  Block block;                                       // null until it is found or fetched
  std::optional<std::promise<FetchResult>> promise;  // set while this thread fetches it: others wait for it
  std::shared_future<FetchResult> result;
};

Result<std::unique_ptr<CachedSource>> CachedSource::open(std::shared_ptr<const ObjectSource> source,
                                                         const std::string& directory,
                                                         const RangeCacheOptions& options) {
  LUMIGRID_ASSIGN_OR_RETURN(auto cache, RangeCache::open(directory, options));
  return std::unique_ptr<CachedSource>(new CachedSource(std::move(source), std::move(cache)));
}

CacheKey CachedSource::keyOf(const std::string& name, const std::string& entry) const {
  const base::Sha256Digest digest = base::sha256(base::viewOfText(source_->place() + "\n\n" + name + "\n" + entry));
  CacheKey key;
  std::copy_n(digest.begin(), key.size(), key.begin());
  return key;
}

CachedSource::Block CachedSource::findBlock(const std::string& name, std::uint64_t block) const {
  auto bytes = cache_->get(keyOf(name, std::to_string(block)));
  if (!bytes) return nullptr;
  return std::make_shared<const Bytes>(std::move(*bytes));
}

Result<std::uint64_t> CachedSource::size(const std::string& name) const {
  {
    const std::lock_guard lock(mutex_);
    if (const auto it = sizes_.find(name); it != sizes_.end()) return it->second;
  }
  const CacheKey key = keyOf(name, "size");
  std::uint64_t bytes = 0;
  if (const auto cached = cache_->get(key); cached && cached->size() == sizeof(bytes)) {
    std::memcpy(&bytes, cached->data(), sizeof(bytes));
  } else {
    LUMIGRID_ASSIGN_OR_RETURN(bytes, source_->size(name));
    cache_->put({{key, {reinterpret_cast<const std::uint8_t*>(&bytes), sizeof(bytes)}}});
  }
  const std::lock_guard lock(mutex_);
  return sizes_.emplace(name, bytes).first->second;
}

Result<Bytes> CachedSource::read(const std::string& name, std::uint64_t offset, std::uint64_t length) const {
  if (length > kMaxCachedRead) return source_->read(name, offset, length);
  LUMIGRID_ASSIGN_OR_RETURN(const auto whole, size(name));
  if (offset > whole || length > whole - offset) return tooShortError(place() + "/" + name, whole, offset, length);
  if (length == 0) return Bytes();

  // The blocks of the range, and those of them that are in the cache.
  const std::uint64_t first = offset / kBlockBytes;
  std::vector<BlockRequest> requests((offset + length - 1) / kBlockBytes - first + 1);
  for (std::size_t i = 0; i < requests.size(); ++i) {
    requests[i].number = first + i;
    requests[i].block = findBlock(name, first + i);
  }

  // A thread fetches the blocks it has claimed before it waits for those of others, so no two threads wait for each
  // other.
  claimMissing(name, requests);
  fetchClaimed(name, whole, requests);
  for (BlockRequest& request : requests) {
    if (request.block != nullptr) continue;
    const FetchResult& result = request.result.get();
    if (!result) return result.error();
    request.block = *result;
  }

  Bytes bytes;
  bytes.reserve(length);
  for (const BlockRequest& request : requests) {
    const std::uint64_t start = request.number * kBlockBytes;
    const std::uint64_t begin = std::max(offset, start) - start;
    const std::uint64_t end = std::min(offset + length - start, kBlockBytes);
    // A block too short was cached when a shorter object had this name.
    if (request.block->size() < end) return source_->read(name, offset, length);
    bytes.insert(bytes.end(), request.block->begin() + static_cast<std::ptrdiff_t>(begin),
                 request.block->begin() + static_cast<std::ptrdiff_t>(end));
  }
  return bytes;
}

// Claims each missing block, unless another thread is fetching it already.
void CachedSource::claimMissing(const std::string& name, std::vector<BlockRequest>& requests) const {
  const std::lock_guard lock(mutex_);
  for (BlockRequest& request : requests) {
    if (request.block != nullptr) continue;
    auto& result = in_flight_[{name, request.number}];
    if (result.valid()) {
      ++shared_;
    } else {
      request.promise.emplace();
      result = request.promise->get_future().share();
    }
    request.result = result;
  }
}

void CachedSource::fetchClaimed(const std::string& name, std::uint64_t size,
                                std::vector<BlockRequest>& requests) const {
  // Another thread may have cached a block between our look-up and our claim.
  for (BlockRequest& request : requests)
    if (request.promise)
      if (const Block block = findBlock(name, request.number); block != nullptr) deliver(name, request, block);

  const auto is_claimed = [](const BlockRequest& request) { return request.promise.has_value(); };
  BlockRequest* const end = requests.data() + requests.size();
  for (BlockRequest* run = requests.data(); (run = std::find_if(run, end, is_claimed)) != end;) {
    BlockRequest* const run_end = std::find_if_not(run, end, is_claimed);
    fetchRun(name, size, run, run_end);
    run = run_end;
  }
}

// Fetches neighbouring blocks by one read.
void CachedSource::fetchRun(const std::string& name, std::uint64_t size, BlockRequest* first, BlockRequest* end) const {
  const std::uint64_t offset = first->number * kBlockBytes;
  const std::uint64_t length = std::min(size - offset, static_cast<std::uint64_t>(end - first) * kBlockBytes);
  const auto bytes = source_->read(name, offset, length);
  if (!bytes) {
    for (BlockRequest* request = first; request != end; ++request) deliver(name, *request, bytes.error());
    return;
  }
  std::vector<std::pair<CacheKey, base::ByteView>> blocks;
  for (BlockRequest* request = first; request != end; ++request) {
    const std::uint64_t at = (request->number - first->number) * kBlockBytes;
    blocks.emplace_back(keyOf(name, std::to_string(request->number)),
                        base::ByteView(*bytes).subspan(at, std::min(kBlockBytes, length - at)));
  }
  // The blocks are cached before they are delivered, so that a thread that asks in between finds them.
  cache_->put(blocks);
  fetched_ += blocks.size();
  for (std::size_t i = 0; i < blocks.size(); ++i)
    deliver(name, first[i], std::make_shared<const Bytes>(blocks[i].second.begin(), blocks[i].second.end()));
}

void CachedSource::deliver(const std::string& name, BlockRequest& request, const FetchResult& result) const {
  if (result) request.block = *result;
  request.promise->set_value(result);
  request.promise.reset();
  const std::lock_guard lock(mutex_);
  in_flight_.erase({name, request.number});
}

CacheCounts CachedSource::counts() const {
  return {fetched_.load(), shared_.load()};
}

}  // namespace repository
