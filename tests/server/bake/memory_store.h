#pragma once
// A store in memory, which remembers its batches and fails when told.
#include <map>
#include <mutex>

#include "repository/store.h"

namespace server::test {

class MemoryStore final : public repository::Store {
 public:
  using Key = repository::FaceKey;

  base::Result<std::optional<base::Bytes>> get(const Key& key) const override {
    const auto it = values.find(key);
    return it == values.end() ? std::optional<base::Bytes>() : std::optional<base::Bytes>(it->second);
  }
  base::Result<std::optional<std::uint64_t>> valueBytes(const Key& key) const override {
    const auto it = values.find(key);
    return it == values.end() ? std::nullopt : std::optional<std::uint64_t>(it->second.size());
  }
  base::Result<void> putBatch(const std::vector<std::pair<Key, base::Bytes>>& batch) override {
    if (batches.size() == fail_at_batch) return base::Error{base::ErrorCode::kNoSpace, "memory: full"};
    std::vector<Key> keys;
    for (const auto& [key, value] : batch) {
      values[key] = value;
      keys.push_back(key);
    }
    batches.push_back(keys);
    return {};
  }
  base::Result<void> erase(const std::vector<Key>& keys) override {
    for (const Key& key : keys) values.erase(key);
    return {};
  }
  base::Result<void> forEach(const std::function<bool(const Key&, base::ByteView)>& visit) const override {
    for (const auto& [key, value] : values) {
      if (!visit(key, value)) break;
    }
    return {};
  }
  base::Result<std::uint64_t> size() const override { return std::uint64_t{values.size()}; }
  base::Result<std::optional<std::string>> readMeta() const override { return meta; }
  base::Result<void> writeMeta(const std::string& text) override {
    meta = text;
    return {};
  }
  base::Error readOnlyError() const override { return {}; }

  std::map<Key, base::Bytes> values;
  std::vector<std::vector<Key>> batches;
  std::optional<std::string> meta;
  std::size_t fail_at_batch = ~std::size_t{0};
};

}  // namespace server::test
