#include "server/net/hosted_scene.h"

#include <algorithm>
#include <atomic>
#include <boost/asio/post.hpp>
#include <iterator>
#include <utility>

#include "server/net/asio_types.h"
#include "server/net/scene_names.h"
#include "server/net/server.h"
#include "spdlog/spdlog.h"

namespace server {
namespace {

// As many views, or ranges of files, of a scene are fetched at a time; choices.
constexpr unsigned kFarFetchers = HostedScene::kMaxFetchers, kLocalFetchers = 2;
constexpr unsigned kFetchesPerClient = 2;      // a viewer's newest view need not wait for the one before
constexpr std::uint64_t kDocumentsClient = 0;  // among those whom fetchers work for; connections have other numbers

std::unique_ptr<FairQueue> makeFetchers(const OpenScene& scene) {
  const bool is_far = scene.data.images_are_remote || (scene.directory.empty() && !scene.streamed.empty());
  return std::make_unique<FairQueue>(is_far ? kFarFetchers : kLocalFetchers, kFetchesPerClient);
}

/// Asks the disk for the place's real name.
std::string accessNameOf(const std::string& place) {
  const auto names = sceneNames({place});
  return names ? names->front() : "";
}

std::uint64_t nextGroup() {
  static std::atomic<std::uint64_t> last{0};
  return ++last;
}

}  // namespace

struct HostedScene::Patience {
  asio::io_context& io;
  SteadyTimer timer{io};
};

HostedScene::HostedScene(boost::asio::io_context& io, std::string from, std::shared_ptr<OpenScene> opened,
                         PageFiles pages)
    : place(std::move(from)),
      access_name(accessNameOf(place)),
      group(nextGroup()),
      scene(std::move(opened)),
      site(std::make_unique<Site>(*scene, std::move(pages))),
      patience_(new Patience{io}),
      fetchers(makeFetchers(*scene)) {
  if (hasPatches()) picker = std::make_unique<Picker>(scene->scene, scene->patches);
}

HostedScene::~HostedScene() = default;

void HostedScene::startAccessLog(const ServerOptions& options) {
  if (!hasPatches()) return;
  std::string path = options.access_file;
  if (path.empty()) {
    if (scene->directory.empty()) {
      spdlog::warn("access counts are not kept: {} is no directory; --access-file names a place for them", place);
      return;
    }
    path = repository::accessFileOf(scene->directory);
  }
  access = std::make_unique<AccessLog>(path, accessIdentityOf(*scene), options.access_interval_seconds);
  scene->data.access = &access->counter();
}

// ---- Documents

void HostedScene::whenFresh(std::function<void()> then) {
  if (scene->directory.empty() || hangs_) return then();
  next_.push_back(std::move(then));
  if (!is_reading_) readDocuments();
}

/// Reads once for all who wait by now.
void HostedScene::readDocuments() {
  is_reading_ = true;
  waiting_.swap(next_);
  fetchers->submit(kDocumentsClient, [weak = weak_from_this(), &io = patience_->io, directory = scene->directory,
                                      known = site->stamps()] {
    auto read = std::make_shared<ChangedDocuments>(readChanges(directory, known));
    asio::post(io, [weak, read] {
      if (const auto self = weak.lock()) self->takeUp(std::move(*read));
    });
  });
  patience_->timer.expires_after(
      std::chrono::duration_cast<SteadyClock::duration>(std::chrono::duration<double>(kPatienceSeconds)));
  patience_->timer.async_wait([weak = weak_from_this()](error_code cancelled) {
    const auto self = cancelled ? nullptr : weak.lock();
    if (self) self->stopWaiting();
  });
}

void HostedScene::takeUp(ChangedDocuments changed) {
  if (std::exchange(hangs_, false)) spdlog::info("the disk of {} answers again", place);
  is_reading_ = false;
  patience_->timer.cancel();
  site->takeUp(std::move(changed));
  const auto fresh = std::exchange(waiting_, {});
  if (!next_.empty()) readDocuments();
  for (const auto& then : fresh) then();
}

/// A timer that was ready already cannot be called off.
void HostedScene::stopWaiting() {
  if (!is_reading_ || hangs_ || patience_->timer.expiry() > SteadyClock::now()) return;
  hangs_ = true;
  spdlog::warn("the disk of {} does not answer; its documents are served as they were", place);
  auto late = std::exchange(waiting_, {});
  std::move(next_.begin(), next_.end(), std::back_inserter(late));
  next_.clear();
  for (const auto& then : late) then();
}

}  // namespace server
