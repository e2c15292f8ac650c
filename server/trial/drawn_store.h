#pragma once
// A repository that draws its faces when they are asked for, so that a few views can be tried before a bake.
#include <unordered_map>

#include "repository/store.h"
#include "server/bake/bake.h"
#include "server/trial/own_context.h"

namespace server {

/// For one thread.
class DrawnStore final : public repository::Store {
 public:
  /// Faces are drawn and encoded as a bake with these options would. `renderer`, which draws in `gl`, outlives it.
  DrawnStore(SceneRenderer& renderer, OwnContext& gl, const BakeOptions& options)
      : renderer_(renderer), gl_(gl), options_(options) {}

  base::Result<std::optional<base::Bytes>> get(const repository::FaceKey& key) const override;
  base::Result<std::optional<std::uint64_t>> valueBytes(const repository::FaceKey& key) const override {
    return options_.grid.contains(key) ? std::optional<std::uint64_t>(0) : std::nullopt;
  }
  /// Visits the faces that were drawn, in no order.
  base::Result<void> forEach(
      const std::function<bool(const repository::FaceKey&, base::ByteView)>& visit) const override;
  base::Result<std::uint64_t> size() const override { return drawn_.size(); }
  base::Result<std::optional<std::string>> readMeta() const override { return std::optional<std::string>(); }

 private:
  base::Error readOnlyError() const override;

  SceneRenderer& renderer_;
  OwnContext& gl_;
  const BakeOptions& options_;
  mutable std::unordered_map<repository::FaceKey, base::Bytes> drawn_;
};

}  // namespace server
