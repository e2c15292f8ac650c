#include "client/source/streamed_file.h"

#include <utility>

namespace client {

StreamedFile::StreamedFile(FilePlace place, const protocol::Welcome& welcome, std::unique_ptr<RangeFetcher> fetcher)
    : place_(std::move(place)),
      welcome_(protocol::encode(welcome)),
      origin_(welcome.origin),
      fetcher_(std::move(fetcher)) {}

/// Greets the session as a server would. Its answers are dropped, since views are not sent to anybody.
void StreamedFile::sendWelcome(Session& session) {
  session.connected();
  if (auto taken = session.receive(welcome_); !taken) refusal_ = place_.place + ": " + taken.error().message;
  while (session.nextToSend()) {
  }
}

}  // namespace client
