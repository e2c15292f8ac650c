#pragma once
// A cache bounded by bytes that evicts the least recently used values first.
#include <cstdint>
#include <functional>
#include <list>
#include <unordered_map>
#include <utility>
#include <vector>

namespace repository {

/// Values stay until evict() finds their bytes over the budget. Pinned values are never evicted. Not thread-safe.
template <class Key, class Value>
class LruCache {
 public:
  explicit LruCache(std::uint64_t budget_bytes) : budget_(budget_bytes) {}

  /// Returns the value, or null, and makes it the most recently used.
  Value* find(const Key& key) {
    auto it = index_.find(key);
    if (it == index_.end()) return nullptr;
    order_.splice(order_.begin(), order_, it->second);
    return &it->second->value;
  }
  bool contains(const Key& key) const { return index_.count(key) != 0; }

  /// Inserts or replaces; nothing is evicted here.
  void insert(const Key& key, Value value, std::uint64_t bytes) {
    erase(key);
    order_.push_front({key, std::move(value), bytes});
    index_[key] = order_.begin();
    bytes_ += bytes;
  }
  bool erase(const Key& key) {
    auto it = index_.find(key);
    if (it == index_.end()) return false;
    bytes_ -= it->second->bytes;
    order_.erase(it->second);
    index_.erase(it);
    return true;
  }
  /// Evicts the least recently used values until the budget holds, except those whose keys are `pinned`. Returns the
  /// keys of the evicted values.
  std::vector<Key> evict(const std::function<bool(const Key&)>& pinned) {
    std::vector<Key> evicted;
    for (auto it = order_.end(); bytes_ > budget_ && it != order_.begin();) {
      --it;
      if (pinned(it->key)) continue;
      evicted.push_back(it->key);
      bytes_ -= it->bytes;
      index_.erase(it->key);
      it = order_.erase(it);
    }
    return evicted;
  }

  /// The most recently used first.
  std::vector<Key> keys() const {
    std::vector<Key> all;
    for (const Entry& entry : order_) all.push_back(entry.key);
    return all;
  }
  std::uint64_t bytes() const { return bytes_; }
  std::uint64_t budget() const { return budget_; }
  std::size_t size() const { return index_.size(); }

 private:
  struct Entry {
    Key key;
    Value value;
    std::uint64_t bytes;
  };
  std::list<Entry> order_;  // most recently used first
  std::unordered_map<Key, typename std::list<Entry>::iterator> index_;
  std::uint64_t bytes_ = 0;
  std::uint64_t budget_;
};

}  // namespace repository
