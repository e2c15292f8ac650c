#include "client/source/static_source.h"

#include <algorithm>
#include <utility>

namespace client {
namespace {

// A share of the 6 that may be under way, so that a new view finds room.
constexpr std::size_t kRequestsAheadOfNeed = 2;
/// A coarse model has kCoarseBytes, or a group that is larger, and the directory of the records.
constexpr std::uint64_t kMaxOpeningBytes = 1'000'000;
/// The parameters name the points that are left out, a byte or two each.
constexpr std::uint64_t kMaxIndexFrontBytes = 20'000'000;
/// One failed request is not reported: hosts close kept connections now and then.
constexpr int kMinReportedFailures = 2;

}  // namespace

StaticSource::StaticSource(StaticScene scene, RangeFetcher& fetcher, ReadParameters read_parameters,
                           const StaticOptions& options)
    : scene_(std::move(scene)),
      read_parameters_(std::move(read_parameters)),
      options_(options),
      queue_(fetcher, options.queue),
      index_blocks_(options.index_cache_bytes) {
  if (auto sound = checkScene(); !sound) fail(scene_.place + ": " + sound.error().message);
  checkOpening();
}

bool StaticSource::pump(Session& session, double now) {
  if (phase_ == Phase::kFailed) {
    if (session.phase() != SessionPhase::kRefused) session.refuse(failure_);
    return false;
  }
  if (!linked_ && failures_ == 0) {
    linked_ = true;
    session.connected();
  }

  // Take in answers.
  now_ = now;
  queue_.setTime(now);
  succeeded_ = retry_set_ = false;
  auto arrivals = queue_.takeArrivals();
  for (RangeArrival& arrival : arrivals) acceptArrival(std::move(arrival));
  if (succeeded_) {
    failures_ = 0;
    backoff_.reset();
    if (!std::exchange(linked_, true)) session.connected();
  } else if (retry_set_) {
    retry_at_ = now + backoff_.nextPause();
    ++failures_;
    if (linked_ && failures_ >= kMinReportedFailures) {
      linked_ = false;
      session.disconnected(last_failure_);
    }
  }
  openScene();
  readMessages(session);
  deliverMessages(session);
  castPicks(session);

  // Send requests.
  if (phase_ != Phase::kFailed && (failures_ == 0 || now >= retry_at_)) {
    const bool was_complete = complete_sent_;
    const std::vector<RangeWish> wishes = urgentWishes();
    queue_.request(wishes);
    if (was_complete && wishes.empty()) queue_.request(prefetchWishes(), kRequestsAheadOfNeed);
    deliverMessages(session);
  }
  if (phase_ == Phase::kFailed) session.refuse(failure_);
  return !arrivals.empty();
}

void StaticSource::pick(std::uint32_t id, const glm::dvec3& origin, const glm::dvec3& direction) {
  lod::patch::Ray ray;
  ray.origin = origin - scene_.welcome.origin;
  ray.direction = direction;
  picks_.addRay(id, ray);
  pick_data_arrived_ = true;
}

std::vector<AnsweredPick> StaticSource::takePicks() {
  std::vector<AnsweredPick> answered = picks_.takeAnswers();
  for (AnsweredPick& one : answered)
    if (one.answer.kind == PickAnswer::Kind::kHit) one.answer.point += scene_.welcome.origin;
  return answered;
}

StaticStats StaticSource::stats() const {
  StaticStats stats = stats_;
  stats.requests = queue_.requestsSent();
  stats.bytes = queue_.bytesReceived();
  stats.requests_under_way = static_cast<std::uint32_t>(queue_.requestsUnderWay());
  return stats;
}

/// Names come from outside; only names in the form that `lumigrid publish` writes lead to requests.
base::Result<void> StaticSource::checkScene() const {
  const auto notPublished = [](const std::string& message) {
    return base::Error{base::ErrorCode::kInvalidInput, message + "; put there what `lumigrid publish` wrote"};
  };
  const auto isNamed = [](const StaticObject& object, const std::string& begin, const std::string& end) {
    const std::string& name = object.name;
    return object.bytes > 0 && name.size() == begin.size() + 32 + end.size() &&
           name.compare(0, begin.size(), begin) == 0 && name.compare(name.size() - end.size(), end.size(), end) == 0 &&
           name.find_first_not_of("0123456789abcdef", begin.size()) == name.size() - end.size();
  };
  if (!isNamed(scene_.patches, "patch-", ".lgp")) return notPublished("this scene.json names no published hierarchy");
  if (scene_.records.name.empty())
    return badScene("an earlier program published this scene, without records of groups");
  const auto namesFront = [](const StaticObject& object, std::uint64_t most) {
    const std::vector<base::FileRange>& front = object.opening;
    return front.size() == 1 && front[0].offset == 0 && front[0].length > 0 &&
           front[0].length <= std::min(object.bytes, most);
  };
  if (!isNamed(scene_.records, "records-", ".lgr") || !namesFront(scene_.records, kMaxOpeningBytes))
    return notPublished("this scene.json names no records of groups");
  if (scene_.index && !repository::idOfIndexName(scene_.index->name))
    return notPublished("this scene.json names no published images");
  if (scene_.index && !namesFront(*scene_.index, kMaxIndexFrontBytes))
    return badScene("an earlier program published this scene, whose index of images has no front");
  return {};
}

/// Blocks whose ranges cannot be are read one by one.
void StaticSource::checkOpening() {
  std::vector<base::FileRange>& opening = scene_.patches.opening;
  std::uint64_t sum = 0;
  for (const base::FileRange& range : opening) {
    if (range.length == 0 || range.length > scene_.patches.bytes || range.offset > scene_.patches.bytes - range.length)
      return opening.clear();
    sum += range.length;
  }
  if (opening.size() > plan::kMaxOpeningRanges || sum > kMaxOpeningBytes) opening.clear();
}

void StaticSource::fail(const std::string& why) {
  if (phase_ == Phase::kFailed) return;
  phase_ = Phase::kFailed;
  failure_ = why;
}

/// Marks the faces of this object as gone.
void StaticSource::loseObject(const std::string& object, const std::string& why) {
  lost_objects_.insert(object);
  reportProblem(why);
}

// ---- messages from and to the session ----

void StaticSource::acceptMessage(const protocol::ClientMessage& message) {
  if (std::get_if<protocol::Hello>(&message) != nullptr) {
    welcome_due_ = true;
    // Holdings will tell what the session has, except what is still in `outgoing_`.
    has_face_.clear();
    has_group_.assign(has_group_.size(), false);
    for (const OutgoingMessage& queued : outgoing_) {
      if (queued.face) has_face_.insert(*queued.face);
      if (queued.group) has_group_[*queued.group] = true;
    }
  } else if (const auto* view = std::get_if<protocol::View>(&message)) {
    if (planned_) previous_ = newest_, previous_at_ = newest_at_;
    newest_ = *view, newest_at_ = now_;
    planned_ = complete_sent_ = false;
  } else if (const auto* evicted = std::get_if<protocol::Eviction>(&message)) {
    for (const FaceKey& key : evicted->faces) has_face_.erase(key);
    for (const std::uint32_t group : evicted->groups)
      if (group < has_group_.size()) has_group_[group] = false;
  } else if (const auto* have = std::get_if<protocol::Holdings>(&message)) {
    has_face_.insert(have->faces.begin(), have->faces.end());
    for (const std::uint32_t group : have->groups)
      if (group < has_group_.size()) has_group_[group] = true;
  }
}

void StaticSource::readMessages(Session& session) {
  while (const auto bytes = session.nextToSend())
    if (const auto message = protocol::decodeClientMessage(*bytes)) acceptMessage(*message);
}

void StaticSource::deliverMessages(Session& session) {
  if (!linked_ || phase_ != Phase::kOpen) return;
  if (std::exchange(welcome_due_, false)) outgoing_.push_front({protocol::encode(scene_.welcome)});
  while (!outgoing_.empty()) {
    const OutgoingMessage message = std::move(outgoing_.front());
    outgoing_.pop_front();
    if (message.face && !session.options().images) {  // images were switched off meanwhile
      has_face_.erase(*message.face);
      continue;
    }
    if (auto taken = session.receive(message.bytes); !taken) return fail(scene_.place + ": " + taken.error().message);
    readMessages(session);
  }
}

/// Completes the Welcome once both fronts are here.
void StaticSource::openScene() {
  if (phase_ != Phase::kOpening || !records_ || (scene_.index && !root_)) return;
  const lod::patch::RecordCounts& counts = records_->counts();
  protocol::Welcome& welcome = scene_.welcome;
  welcome.version = protocol::kVersion;
  welcome.has_colors = counts.has_colors;
  welcome.lattice_origin = counts.lattice.origin;
  welcome.lattice_step = counts.lattice.step;
  welcome.group_count = counts.groups;
  welcome.patch_count = counts.patches;
  welcome.source_triangles = counts.source_triangles;
  welcome.can_render_frames = false;
  if (scene_.index) welcome.grid = points_.grid;
  phase_ = Phase::kOpen;
}

}  // namespace client
