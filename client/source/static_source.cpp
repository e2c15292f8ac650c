#include "client/source/static_source.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "client/source/static_source_impl.h"

namespace client {
namespace {

constexpr std::size_t kRequestsAheadOfNeed =
    2;  // a share of the 6 that may be under way, so that a new view finds room
constexpr double kMinPause = 0.25, kMaxPause = 5.0;  // seconds between attempts; choices
/// One failed request is not reported: hosts close kept connections now and then.
constexpr int kMinReportedFailures = 2;

}  // namespace

StaticSource::StaticSource(StaticScene scene, RangeFetcher& fetcher, ReadParameters read_parameters,
                           const StaticOptions& options)
    : impl_(std::make_unique<Impl>(std::move(scene), fetcher, std::move(read_parameters), options)) {}
StaticSource::~StaticSource() = default;

bool StaticSource::pump(Session& session, double now) {
  Impl& s = *impl_;
  if (s.phase == Impl::Phase::kFailed) {
    if (session.phase() != SessionPhase::kRefused) session.refuse(s.failure);
    return false;
  }
  if (!s.linked && s.failures == 0) {
    s.linked = true;
    session.connected();
  }

  // Take in answers.
  s.succeeded = s.retry_set = false;
  auto arrivals = s.queue.takeArrivals();
  for (RangeArrival& arrival : arrivals) s.acceptArrival(std::move(arrival));
  if (s.succeeded) {
    s.failures = 0;
    if (!std::exchange(s.linked, true)) session.connected();
  } else if (s.retry_set) {
    s.retry_at = now + std::min(kMaxPause, kMinPause * std::exp2(std::min(s.failures, 8)));
    ++s.failures;
    if (s.linked && s.failures >= kMinReportedFailures) {
      s.linked = false;
      session.disconnected(s.last_failure);
    }
  }
  s.openScene();
  s.readMessages(session);
  s.deliverMessages(session);
  s.castPicks(session);

  // Send requests.
  if (s.phase != Impl::Phase::kFailed && (s.failures == 0 || now >= s.retry_at)) {
    const bool was_complete = s.complete_sent;
    const std::vector<RangeWish> wishes = s.urgentWishes();
    s.queue.request(wishes);
    if (was_complete && wishes.empty()) s.queue.request(s.prefetchWishes(), kRequestsAheadOfNeed);
    s.deliverMessages(session);
  }
  if (s.phase == Impl::Phase::kFailed) session.refuse(s.failure);
  return !arrivals.empty();
}

void StaticSource::pick(std::uint32_t id, const glm::dvec3& origin, const glm::dvec3& direction) {
  lod::patch::Ray ray;
  ray.origin = origin - impl_->scene.welcome.origin;
  ray.direction = direction;
  impl_->picks.addRay(id, ray);
  impl_->pick_data_arrived = true;
}

std::vector<AnsweredPick> StaticSource::takePicks() {
  std::vector<AnsweredPick> answered = impl_->picks.takeAnswers();
  for (AnsweredPick& one : answered)
    if (one.answer.kind == PickAnswer::Kind::kHit) one.answer.point += impl_->scene.welcome.origin;
  return answered;
}

const std::string& StaticSource::problem() const {
  return impl_->failure.empty() ? impl_->problem : impl_->failure;
}

StaticStats StaticSource::stats() const {
  StaticStats stats = impl_->stats;
  stats.requests = impl_->queue.requestsSent();
  stats.bytes = impl_->queue.bytesReceived();
  stats.requests_under_way = static_cast<std::uint32_t>(impl_->queue.requestsUnderWay());
  return stats;
}

/// Names come from outside; only names in the form that `lumigrid publish` writes lead to requests.
base::Result<void> StaticSource::Impl::checkScene() const {
  const auto notPublished = [](const std::string& message) {
    return base::Error{base::ErrorCode::kInvalidInput, message + "; put there what `lumigrid publish` wrote"};
  };
  const std::string& patches = scene.patches.name;
  const std::string begin = "patch-";
  const std::string end = ".lgp";
  const bool named = patches.size() == begin.size() + 32 + end.size() && patches.compare(0, begin.size(), begin) == 0 &&
                     patches.compare(patches.size() - end.size(), end.size(), end) == 0 &&
                     patches.find_first_not_of("0123456789abcdef", begin.size()) == patches.size() - end.size();
  if (!named || scene.patches.bytes == 0) return notPublished("this scene.json names no published hierarchy");
  if (scene.index && (!repository::idOfIndexName(scene.index->name) || scene.index->bytes == 0))
    return notPublished("this scene.json names no published images");
  return {};
}

void StaticSource::Impl::fail(const std::string& why) {
  if (phase == Phase::kFailed) return;
  phase = Phase::kFailed;
  failure = why;
}

/// Marks the faces of this object as gone.
void StaticSource::Impl::loseObject(const std::string& object, const std::string& why) {
  lost_objects.insert(object);
  reportProblem(why);
}

// ---- messages from and to the session ----

void StaticSource::Impl::acceptMessage(const protocol::ClientMessage& message) {
  if (std::get_if<protocol::Hello>(&message) != nullptr) {
    welcome_due = true;
    // Holdings will tell what the session has, except what is still in `outgoing`.
    has_face.clear();
    has_group.assign(has_group.size(), false);
    for (const OutgoingMessage& queued : outgoing) {
      if (queued.face) has_face.insert(*queued.face);
      if (queued.group) has_group[*queued.group] = true;
    }
  } else if (const auto* view = std::get_if<protocol::View>(&message)) {
    if (planned) previous = newest;
    newest = *view;
    planned = complete_sent = false;
  } else if (const auto* evicted = std::get_if<protocol::Eviction>(&message)) {
    for (const FaceKey& key : evicted->faces) has_face.erase(key);
    for (const std::uint32_t group : evicted->groups)
      if (group < has_group.size()) has_group[group] = false;
  } else if (const auto* have = std::get_if<protocol::Holdings>(&message)) {
    has_face.insert(have->faces.begin(), have->faces.end());
    for (const std::uint32_t group : have->groups)
      if (group < has_group.size()) has_group[group] = true;
  }
}

void StaticSource::Impl::readMessages(Session& session) {
  while (const auto bytes = session.nextToSend())
    if (const auto message = protocol::decodeClientMessage(*bytes)) acceptMessage(*message);
}

void StaticSource::Impl::deliverMessages(Session& session) {
  if (!linked || phase != Phase::kOpen) return;
  if (std::exchange(welcome_due, false)) outgoing.push_front({protocol::encode(scene.welcome)});
  while (!outgoing.empty()) {
    const OutgoingMessage message = std::move(outgoing.front());
    outgoing.pop_front();
    if (message.face && !session.options().images) {  // images were switched off meanwhile
      has_face.erase(*message.face);
      continue;
    }
    if (auto taken = session.receive(message.bytes); !taken) return fail(scene.place + ": " + taken.error().message);
    readMessages(session);
  }
}

/// Completes the Welcome once both fronts are here.
void StaticSource::Impl::openScene() {
  if (phase != Phase::kOpening || !tables || (scene.index && !points_known)) return;
  const lod::patch::TableCounts& counts = tables->counts();
  protocol::Welcome& welcome = scene.welcome;
  welcome.version = protocol::kVersion;
  welcome.has_colors = counts.has_colors;
  welcome.lattice_origin = counts.lattice.origin;
  welcome.lattice_step = counts.lattice.step;
  welcome.group_count = counts.groups;
  welcome.patch_count = counts.patches;
  welcome.source_triangles = counts.source_triangles;
  welcome.can_render_frames = false;
  if (scene.index) welcome.grid = points.grid;
  phase = Phase::kOpen;
}

}  // namespace client
