#pragma once
// Runs the session of one viewer on worker threads, so that the thread of its connection never plans, reads a disk or
// waits. The connection hands in what happened and is handed what to do; both sides only pass values on.
//
// A session takes turns: all that happened since the last one is accepted, of several views the newest is planned for,
// and as many messages are made as the connection has room for. A viewer that asks for more than its share of the
// workers' time (FairQueue) waits for its next turn, and its views replace each other meanwhile.
//
// Messages that need only be taken from the cache are handed to the connection at once, on its own thread: to wake a
// worker for them, and then the connection, takes several times as long as to find them.
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "server/session/fair_queue.h"
#include "server/session/session.h"

namespace server {

/// Things that may wait for a session's next turn, and bytes of the viewer's messages among them.
inline constexpr std::size_t kMaxEvents = 64;
inline constexpr std::uint64_t kMaxEventBytes = 256 * 1024;

/// Bytes of messages that may wait to be written while others are made, so that a fast link does not idle between
/// turns: half of what the kernel may hold. On a slow link the session makes fewer by itself.
inline constexpr std::uint64_t kBytesAhead = 64 * 1024;

/// The connection as a session is told of it.
struct ConnectionState {
  LinkState link;                     ///< its unsent bytes count `unwritten_bytes`, too
  std::uint64_t unwritten_bytes = 0;  ///< of messages that the connection took, and has not yet given to the kernel
};

/// The things that the connection is to do after a turn of its session.
struct SessionOutput {
  std::vector<SharedMessage> messages;     ///< to be written in this order
  std::vector<FaceRequest> faces;          ///< to be fetched
  std::optional<FrameRequest> frame;       ///< to be rendered, in place of one that waits
  std::optional<double> wake_at;           ///< call wake() then, seconds of LinkState; nothing: not by the clock
  std::optional<std::string> client_name;  ///< once, when it is known
  std::optional<double> plan_seconds;      ///< how long the turn took, if it planned for a view
  std::optional<std::string> refusal;      ///< once: why the connection is to be closed, after the messages
};

/// The calls are for one thread, that of the connection, but for counts(), which any thread may call.
class SessionRunner : public std::enable_shared_from_this<SessionRunner> {
 public:
  /// Called on a worker after each turn.
  using OnOutput = std::function<void(SessionOutput output)>;

  /// `scene` outlives the runner: keep_alive holds what it belongs to. `client`: its number in the queue.
  SessionRunner(const SceneData& scene, std::shared_ptr<const void> keep_alive, FairQueue& workers,
                std::uint64_t client, OnOutput done);

  void receive(base::Bytes message, const ConnectionState& state);
  void facesFetched(FaceRequest request, Session::FaceValues values, const ConnectionState& state);
  void frameRendered(FrameRequest request, protocol::EncodedFrame frame, const ConnectionState& state);
  /// Messages were written. Returns what is ready to be sent, for the connection to take like other outputs. A turn
  /// begins if the session has more, but has to plan or to read for it; if it has none, the next turn is told.
  std::optional<SessionOutput> tellRoom(const ConnectionState& state);
  /// The time to wake has come. Returns and begins the same.
  std::optional<SessionOutput> wake(const ConnectionState& state);
  /// To be called for each output that the connection takes, before it tells of it in a state.
  void take(const SessionOutput& output);
  /// No turn begins from here on, and one that runs has no output.
  void end();
  SessionCounts counts() const;
  /// Whether as much of the viewer's waits for a turn as may wait: the connection reads no more until the next output.
  bool isFull() const;

 private:
  /// Something that happened, in the order in which it did.
  struct Event {
    ConnectionState state;
    std::uint64_t bytes_taken = 0;  // of all messages that the connection took before
    std::function<void(SessionRunner&)> apply;
  };
  enum class Wakes { kAlways, kIfRoomIsNeeded };
  enum class Makes { kAll, kReady };  // messages
  std::optional<SessionOutput> makeReady(const ConnectionState& state, Wakes wakes);
  void add(const ConnectionState& state, std::function<void(SessionRunner&)> apply);
  void addEvent(Event event, Wakes wakes);
  void schedule();
  void runTurn();
  void endTurn(bool needs_room, bool needs_another);
  void acceptEvent(const Event& event);
  void receiveMessage(const base::Bytes& message);
  bool makeMessages(SessionOutput& output, Makes makes);

  const std::shared_ptr<const void> keep_alive_;
  FairQueue& workers_;
  const std::uint64_t client_;
  const OnOutput done_;

  // Used by the turn that runs, or by the connection's thread while it keeps turns from running.
  Session session_;
  LinkState link_;             // the newest, with what was handed out since
  std::uint64_t waiting_ = 0;  // bytes of messages that were made, and not yet given to the kernel
  bool name_told_ = false;
  std::optional<std::string> refusal_;
  bool refusal_told_ = false;

  std::uint64_t bytes_taken_ = 0;  // used by the connection's thread

  mutable std::mutex mutex_;
  std::vector<Event> events_;
  std::uint64_t event_bytes_ = 0;
  std::size_t outputs_under_way_ = 0;  // to the connection; what is made after them must come after them
  bool scheduled_ = false;             // a turn waits or runs
  bool due_ = false;                   // something came since the turn began for which there must be another one
  bool needs_room_ = false;            // messages waited for room when the last turn ended
  bool ended_ = false;
  SessionCounts counts_;
};

}  // namespace server
