#pragma once
// Reads a scene's splats at an HTTP address: scene.json names their file, and client::StreamedSplats reads it.
#include <memory>
#include <string>

#include "client/native/link.h"
#include "client/source/streamed_splats.h"

namespace client {

class SplatLink final : public Link {
 public:
  /// `place` is the scene's URL; "http://host:port" of a server of ours is one, too.
  SplatLink(const std::string& place, const LinkLimit& limit, const SplatOptions& options);
  ~SplatLink() override;
  bool pump(Session& session) override;
  void waitForArrival(double seconds) override;
  LinkCounts counts() const override;
  std::shared_ptr<SplatView> splats() const override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace client
