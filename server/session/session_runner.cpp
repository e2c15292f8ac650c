#include "server/session/session_runner.h"

#include <chrono>
#include <utility>

namespace server {

SessionRunner::SessionRunner(const SceneData& scene, std::shared_ptr<const void> keep_alive, FairQueue& workers,
                             std::uint64_t client, OnOutput done)
    : keep_alive_(std::move(keep_alive)), workers_(workers), client_(client), done_(std::move(done)), session_(scene) {}

// ---- The connection's side

void SessionRunner::receive(base::Bytes message, const ConnectionState& state) {
  {
    const std::lock_guard lock(mutex_);
    event_bytes_ += message.size();
  }
  add(state, [message = std::move(message)](SessionRunner& self) { self.receiveMessage(message); });
}

void SessionRunner::facesFetched(FaceRequest request, Session::FaceValues values, const ConnectionState& state) {
  // A function that is copied holds what can only be moved behind a pointer.
  auto held = std::make_shared<Session::FaceValues>(std::move(values));
  add(state, [request = std::move(request), held](SessionRunner& self) {
    self.session_.facesFetched(request, std::move(*held));
  });
}

void SessionRunner::frameRendered(FrameRequest request, protocol::EncodedFrame frame, const ConnectionState& state) {
  auto held = std::make_shared<protocol::EncodedFrame>(std::move(frame));
  add(state, [request, held](SessionRunner& self) { self.session_.frameRendered(request, std::move(*held)); });
}

std::optional<SessionOutput> SessionRunner::tellRoom(const ConnectionState& state) {
  return makeReady(state, Wakes::kIfRoomIsNeeded);
}

std::optional<SessionOutput> SessionRunner::wake(const ConnectionState& state) {
  return makeReady(state, Wakes::kAlways);
}

std::optional<SessionOutput> SessionRunner::makeReady(const ConnectionState& state, Wakes wakes) {
  {
    const std::lock_guard lock(mutex_);
    // The output of a turn goes before what is ready. While it is on its way, the next turn is told.
    const bool is_due = needs_room_ || wakes == Wakes::kAlways;
    if (ended_ || scheduled_ || !is_due || outputs_under_way_ > 0) {
      addEvent({state, bytes_taken_, nullptr}, wakes);
      return std::nullopt;
    }
    scheduled_ = true;  // keeps turns from running
  }
  acceptEvent({state, bytes_taken_, nullptr});
  SessionOutput output;
  const bool needs_room = makeMessages(output, Makes::kReady);
  // A turn knows how much there is to do besides.
  const bool waits = wakes == Wakes::kAlways && session_.waitsToPrefetch();
  const std::lock_guard lock(mutex_);
  endTurn(needs_room, session_.needsTime() || waits);
  return output;
}

void SessionRunner::take(const SessionOutput& output) {
  {
    const std::lock_guard lock(mutex_);
    --outputs_under_way_;
  }
  for (const SharedMessage& message : output.messages) bytes_taken_ += message.size();
}

void SessionRunner::end() {
  {
    const std::lock_guard lock(mutex_);
    ended_ = true;
    events_.clear();
  }
  workers_.forget(client_);
}

SessionCounts SessionRunner::counts() const {
  const std::lock_guard lock(mutex_);
  return counts_;
}

bool SessionRunner::isFull() const {
  const std::lock_guard lock(mutex_);
  return events_.size() >= kMaxEvents || event_bytes_ >= kMaxEventBytes;
}

void SessionRunner::add(const ConnectionState& state, std::function<void(SessionRunner&)> apply) {
  const std::lock_guard lock(mutex_);
  addEvent({state, bytes_taken_, std::move(apply)}, Wakes::kAlways);
}

/// The lock is held.
void SessionRunner::addEvent(Event event, Wakes wakes) {
  if (ended_) return;
  const bool only_tells = event.apply == nullptr;
  // The newest of several states in a row tells all.
  if (only_tells && !events_.empty() && events_.back().apply == nullptr) events_.pop_back();
  events_.push_back(std::move(event));
  due_ = due_ || wakes == Wakes::kAlways;
  if ((due_ || needs_room_) && !std::exchange(scheduled_, true)) schedule();
}

void SessionRunner::schedule() {
  workers_.submit(client_, [self = shared_from_this()] { self->runTurn(); });
}

// ---- The workers' side

void SessionRunner::runTurn() {
  std::vector<Event> events;
  {
    const std::lock_guard lock(mutex_);
    if (ended_) return;
    events.swap(events_);
    event_bytes_ = 0;
    due_ = false;
  }
  session_.setLoad(workers_.isBehind() ? Load::kBehind : workers_.hasFreeThread() ? Load::kFree : Load::kShared);
  for (const Event& event : events) acceptEvent(event);
  SessionOutput output;
  const auto start = std::chrono::steady_clock::now();
  const std::uint64_t planned = session_.counts().planned;
  const bool needs_room = makeMessages(output, Makes::kAll);
  if (session_.counts().planned > planned)
    output.plan_seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  {
    const std::lock_guard lock(mutex_);
    endTurn(needs_room, false);
    if (ended_) return;
  }
  done_(std::move(output));
}

/// The lock is held.
void SessionRunner::endTurn(bool needs_room, bool needs_another) {
  counts_ = session_.counts();
  needs_room_ = needs_room;
  scheduled_ = !ended_ && (due_ || needs_another || (needs_room && !events_.empty()));
  if (ended_) return;
  ++outputs_under_way_;
  if (scheduled_) schedule();
}

void SessionRunner::acceptEvent(const Event& event) {
  // Messages that the connection had not taken yet when it told its state wait all the same.
  const std::uint64_t on_the_way = session_.counts().bytes - event.bytes_taken;
  link_ = event.state.link;
  link_.unsent_bytes += on_the_way;
  waiting_ = event.state.unwritten_bytes + on_the_way;
  session_.setLink(link_);
  if (event.apply) event.apply(*this);
}

void SessionRunner::receiveMessage(const base::Bytes& message) {
  if (refusal_) return;
  if (const auto received = session_.receive(message); !received) refusal_ = received.error().message;
}

/// Returns whether there may be more messages once the connection has room.
bool SessionRunner::makeMessages(SessionOutput& output, Makes makes) {
  bool needs_room = true;
  output.frame = session_.nextFrameRequest();
  while (waiting_ == 0 || waiting_ < kBytesAhead) {
    auto message = makes == Makes::kAll ? session_.nextMessage() : session_.nextReadyMessage();
    if (!message) {
      needs_room = session_.needsRoom();
      break;
    }
    waiting_ += message->size();
    link_.unsent_bytes += message->size();
    session_.setLink(link_);
    output.messages.push_back(std::move(*message));
  }
  if (makes == Makes::kAll)
    while (auto request = session_.nextFaceRequest()) output.faces.push_back(std::move(*request));
  if (auto frame = session_.nextFrameRequest()) output.frame = std::move(frame);
  output.wake_at = session_.wakeAt(waiting_ > 0);
  if (!name_told_ && !session_.clientName().empty()) output.client_name = session_.clientName(), name_told_ = true;
  if (refusal_ && session_.finished() && !std::exchange(refusal_told_, true)) output.refusal = refusal_;
  return needs_room;
}

}  // namespace server
