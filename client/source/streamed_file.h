#pragma once
// Joins the stream of a method's file to the fetcher that reads it and to the session whose server it stands for.
#include <memory>
#include <string>
#include <vector>

#include "client/source/fetch.h"
#include "client/source/session.h"

namespace client {

/// The address of a method's file.
struct FilePlace {
  std::string place;  ///< the scene's URL without a slash at its end, for error messages
  std::string name;   ///< name of the object, "qsplat.lgq" or "qsplat-….lgq"
  std::uint64_t bytes = 0;
};

class StreamedFile {
 public:
  /// `welcome` holds the values of scene.json; only the fields that StreamedView needs are used. `fetcher` is null
  /// where the whole file is on this machine.
  StreamedFile(FilePlace place, const protocol::Welcome& welcome, std::unique_ptr<RangeFetcher> fetcher);
  const FilePlace& place() const { return place_; }
  const glm::dvec3& origin() const { return origin_; }  ///< of the scene, world

  /// Does what StreamedView::pump() promises. `stream`: lod::qsplat::Stream, lod::pmr::Stream or lod::hlod::Stream.
  template <class Stream>
  bool pump(Stream& stream, Session& session, double now) {
    std::vector<FetchAnswer> answers;
    if (fetcher_) answers = fetcher_->takeAnswers();
    for (const FetchAnswer& answer : answers) acceptAnswer(stream, session, answer, now);
    if (refusal_.empty() && !stream.problem().empty()) refusal_ = object() + ": " + stream.problem();
    if (!refusal_.empty()) {
      if (session.phase() != SessionPhase::kRefused) session.refuse(refusal_);
      return !answers.empty();
    }
    now_ = now;
    sendRequests(stream);
    if (stream.complete())
      host_away_ = false;  // no more requests are sent, so nothing could show that the host is back
    if (session.phase() == SessionPhase::kDisconnected && stream.header() != nullptr && !host_away_)
      sendWelcome(session);
    return !answers.empty();
  }
  /// Sends requests for what the last view lacks, as the next pump() would.
  template <class Stream>
  void sendRequests(Stream& stream) {
    if (!fetcher_ || !refusal_.empty()) return;
    for (const auto& range : stream.nextRequests(now_))
      fetcher_->submit(range.id, place_.name, range.offset, range.length);
  }

 private:
  template <class Stream>
  void acceptAnswer(Stream& stream, Session& session, const FetchAnswer& answer, double now) {
    if (answer.outcome == FetchOutcome::kBytes) {
      host_away_ = false;
      stream.acceptAnswer(answer.id, answer.bytes, now);
      return;
    }
    const std::string why = describeFailure(answer, object());
    if (isTransient(answer)) {
      host_away_ = true;
      stream.acceptFailure(answer.id, now);
      session.disconnected(why);
    } else {
      if (refusal_.empty()) refusal_ = why;
      stream.giveUp(why);
    }
  }
  std::string object() const { return place_.place + "/" + place_.name; }
  void sendWelcome(Session& session);

  const FilePlace place_;
  const base::Bytes welcome_;
  const glm::dvec3 origin_;
  const std::unique_ptr<RangeFetcher> fetcher_;
  double now_ = 0.0;        ///< seconds, of the last pump()
  bool host_away_ = false;  ///< the last request got no answer
  std::string refusal_;     ///< a failure that no other try repairs; empty when there is none
};

}  // namespace client
