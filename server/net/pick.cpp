#include "server/net/pick.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/number.h"
#include "protocol/message.h"

namespace server {
namespace {

constexpr std::array<const char*, 6> kNames{"ox", "oy", "oz", "dx", "dy", "dz"};

base::Error wrongPick(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, "/pick: " + problem + " (docs/formats/http.md)"};
}

nlohmann::json triple(const glm::dvec3& v) {
  return {v.x, v.y, v.z};
}

}  // namespace

base::Result<lod::patch::Ray> parsePickRequest(const Query& query) {
  std::array<double, kNames.size()> values{};
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    const auto it = query.find(kNames[i]);
    if (it == query.end()) return wrongPick(std::string(kNames[i]) + " is missing; ox, oy, oz, dx, dy, dz are needed");
    const auto value = base::parseNumber(it->second);
    if (!value || std::abs(*value) > protocol::kMaxCoordinate)
      return wrongPick(std::string(kNames[i]) + " must be a number within 1e12");
    values[i] = *value;
  }
  if (query.size() != kNames.size()) return wrongPick("takes ox, oy, oz, dx, dy, dz and nothing else");
  lod::patch::Ray ray;
  ray.origin = {values[0], values[1], values[2]};
  ray.direction = {values[3], values[4], values[5]};
  const double length = glm::length(ray.direction);
  if (!(length > 1e-12)) return wrongPick("the direction dx, dy, dz has no length");
  ray.direction /= length;
  return ray;
}

base::Result<std::string> pick(const glm::dvec3& origin, const std::string& units, const lod::patch::PatchFile& patches,
                               const lod::patch::Ray& ray) {
  lod::patch::Ray local = ray;
  local.origin -= origin;
  LUMIGRID_ASSIGN_OR_RETURN(auto cast, lod::patch::castRay(patches.hierarchy(), local, lod::patch::blocksOf(patches)));
  nlohmann::ordered_json answer{{"hit", cast.hit.has_value()}};
  if (cast.hit) {
    answer["point"] = triple(origin + cast.hit->point);
    answer["normal"] = triple(cast.hit->front ? cast.hit->normal : -cast.hit->normal);
    answer["distance"] = cast.hit->distance;
    answer["accuracy"] = cast.hit->accuracy;
  }
  answer["unit"] = units;
  return answer.dump() + "\n";
}

Picker::Picker(const base::Scene& scene, const lod::patch::PatchFile& patches)
    : scene_(scene), patches_(patches), thread_([this](const std::stop_token& stop) { runThread(stop); }) {}

bool Picker::submit(std::uint64_t id, const std::string& address, const lod::patch::Ray& ray, OnPick done) {
  const std::lock_guard lock(mutex_);
  const auto of_address =
      std::count_if(queue_.begin(), queue_.end(), [&](const Job& job) { return job.address == address; });
  if (queue_.size() >= kMaxQueued || static_cast<std::size_t>(of_address) >= kMaxOfOneAddress) return false;
  queue_.push_back({id, address, ray, scene_.units, std::move(done)});
  changed_.notify_one();
  return true;
}

void Picker::cancel(std::uint64_t id) {
  Job cancelled;  // ends without the lock, since it may be the last to hold who waited for it
  const std::lock_guard lock(mutex_);
  const auto found = std::find_if(queue_.begin(), queue_.end(), [&](const Job& job) { return job.id == id; });
  if (found == queue_.end()) return;
  cancelled = std::move(*found);
  queue_.erase(found);
}

void Picker::runThread(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  for (;;) {
    changed_.wait(lock, stop, [this] { return !queue_.empty(); });
    if (stop.stop_requested()) return;
    Job job = std::move(queue_.front());
    queue_.pop_front();
    lock.unlock();
    job.done(pick(scene_.origin, job.units, patches_, job.ray));
    lock.lock();
  }
}

}  // namespace server
