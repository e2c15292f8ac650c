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

// A block that a read needs, and how it comes: found, fetched by us, or by another thread.
struct CachedSource::Wanted {
  std::uint64_t number = 0;
  Block block;
  std::optional<std::promise<Fetched>> ours;  // claimed: others wait for it
  std::shared_future<Fetched> coming;
};

Result<std::unique_ptr<CachedSource>> CachedSource::open(std::shared_ptr<const ObjectSource> source,
                                                         const std::string& directory,
                                                         const CachedSourceOptions& options) {
  LUMIGRID_ASSIGN_OR_RETURN(auto cache, RangeCache::open(directory, options.cache));
  return std::unique_ptr<CachedSource>(new CachedSource(std::move(source), std::move(cache), options));
}

PieceId CachedSource::idOf(const std::string& name, const std::string& piece) const {
  const base::Sha256Digest digest =
      base::sha256(base::viewOfText(source_->place() + "\n" + options_.version + "\n" + name + "\n" + piece));
  PieceId id;
  std::copy_n(digest.begin(), id.size(), id.begin());
  return id;
}

CachedSource::Block CachedSource::find(const std::string& name, std::uint64_t block) const {
  auto bytes = cache_->get(idOf(name, std::to_string(block)));
  if (!bytes) return nullptr;
  ++found_;
  return std::make_shared<const Bytes>(std::move(*bytes));
}

Result<std::uint64_t> CachedSource::size(const std::string& name) const {
  if (isMutable(name)) return source_->size(name);
  {
    const std::lock_guard lock(mutex_);
    if (const auto it = sizes_.find(name); it != sizes_.end()) return it->second;
  }
  const PieceId id = idOf(name, "size");
  std::uint64_t bytes = 0;
  if (const auto kept = cache_->get(id); kept && kept->size() == sizeof(bytes)) {
    std::memcpy(&bytes, kept->data(), sizeof(bytes));
  } else {
    LUMIGRID_ASSIGN_OR_RETURN(const auto asked, source_->size(name));
    bytes = asked;
    cache_->put({{id, {reinterpret_cast<const std::uint8_t*>(&bytes), sizeof(bytes)}}});
  }
  const std::lock_guard lock(mutex_);
  return sizes_.emplace(name, bytes).first->second;
}

Result<Bytes> CachedSource::read(const std::string& name, std::uint64_t offset, std::uint64_t length) const {
  if (isMutable(name) || length > kMaxCachedRead) return source_->read(name, offset, length);
  LUMIGRID_ASSIGN_OR_RETURN(const auto whole, size(name));
  if (offset > whole || length > whole - offset)
    return Error{ErrorCode::kInvalidInput, place() + "/" + name + ": has " + std::to_string(whole) + " bytes, " +
                                               std::to_string(length) + " are wanted from byte " +
                                               std::to_string(offset) + " on; it is truncated, publish it again"};
  if (length == 0) return Bytes();

  // Which blocks, and which of them are here.
  const std::uint64_t first = offset / kBlockBytes;
  std::vector<Wanted> wanted((offset + length - 1) / kBlockBytes - first + 1);
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    wanted[i].number = first + i;
    wanted[i].block = find(name, first + i);
  }

  // Our own claims are met before we wait for those of others, so no two threads wait for each other.
  claim(name, wanted);
  fetchClaimed(name, whole, wanted);
  for (Wanted& w : wanted) {
    if (w.block != nullptr) continue;
    const Fetched& fetched = w.coming.get();
    if (!fetched) return fetched.error();
    w.block = *fetched;
  }

  Bytes bytes;
  bytes.reserve(length);
  for (const Wanted& w : wanted) {
    const std::uint64_t start = w.number * kBlockBytes;
    const std::uint64_t begin = std::max(offset, start) - start;
    const std::uint64_t end = std::min(offset + length - start, kBlockBytes);
    // A block that was kept when the object was another one.
    if (w.block->size() < end) return source_->read(name, offset, length);
    bytes.insert(bytes.end(), w.block->begin() + static_cast<std::ptrdiff_t>(begin),
                 w.block->begin() + static_cast<std::ptrdiff_t>(end));
  }
  return bytes;
}

// Each missing block is claimed, or else somebody has it in flight already.
void CachedSource::claim(const std::string& name, std::vector<Wanted>& wanted) const {
  const std::lock_guard lock(mutex_);
  for (Wanted& w : wanted) {
    if (w.block != nullptr) continue;
    auto& coming = in_flight_[{name, w.number}];
    if (coming.valid()) {
      ++shared_;
    } else {
      w.ours.emplace();
      coming = w.ours->get_future().share();
    }
    w.coming = coming;
  }
}

void CachedSource::fetchClaimed(const std::string& name, std::uint64_t size, std::vector<Wanted>& wanted) const {
  // Another thread may have brought a block between our look and our claim.
  for (Wanted& w : wanted)
    if (w.ours)
      if (const Block block = find(name, w.number); block != nullptr) deliver(name, w, block);

  const auto is_claimed = [](const Wanted& w) { return w.ours.has_value(); };
  Wanted* const end = wanted.data() + wanted.size();
  for (Wanted* run = wanted.data(); (run = std::find_if(run, end, is_claimed)) != end;) {
    Wanted* const run_end = std::find_if_not(run, end, is_claimed);
    fetchRun(name, size, run, run_end);
    run = run_end;
  }
}

// Neighbouring blocks by one read.
void CachedSource::fetchRun(const std::string& name, std::uint64_t size, Wanted* first, Wanted* end) const {
  const std::uint64_t offset = first->number * kBlockBytes;
  const std::uint64_t length = std::min(size - offset, static_cast<std::uint64_t>(end - first) * kBlockBytes);
  ++fetches_;
  const auto bytes = source_->read(name, offset, length);
  if (!bytes) {
    for (Wanted* w = first; w != end; ++w) deliver(name, *w, bytes.error());
    return;
  }
  std::vector<std::pair<PieceId, base::ByteView>> pieces;
  for (Wanted* w = first; w != end; ++w) {
    const std::uint64_t at = (w->number - first->number) * kBlockBytes;
    pieces.emplace_back(idOf(name, std::to_string(w->number)),
                        base::ByteView(*bytes).subspan(at, std::min(kBlockBytes, length - at)));
  }
  // Kept before it is delivered: who asks later finds it.
  cache_->put(pieces);
  fetched_ += pieces.size();
  for (std::size_t i = 0; i < pieces.size(); ++i)
    deliver(name, first[i], std::make_shared<const Bytes>(pieces[i].second.begin(), pieces[i].second.end()));
}

void CachedSource::deliver(const std::string& name, Wanted& wanted, const Fetched& fetched) const {
  if (fetched) wanted.block = *fetched;
  wanted.ours->set_value(fetched);
  wanted.ours.reset();
  const std::lock_guard lock(mutex_);
  in_flight_.erase({name, wanted.number});
}

CacheCounts CachedSource::counts() const {
  return {found_.load(), fetched_.load(), fetches_.load(), shared_.load()};
}

}  // namespace repository
