#pragma once
// A TCP connection that may speak TLS, as one type: what reads and writes it, above all Beast's WebSocket, is compiled
// once. Asio's own TLS stream would keep 68 KB of buffers for each connection; this keeps none while it is idle.
//
// It is an AsyncReadStream and an AsyncWriteStream. One read, one write and nothing else may be under way at a time,
// all on the stream's executor.
#include <utility>  // before Asio: Boost 1.74 uses std::exchange without it, which gcc 12 refuses

#include <algorithm>
#include <array>
#include <boost/asio/async_result.hpp>
#include <boost/asio/basic_waitable_timer.hpp>
#include <boost/asio/buffer.hpp>
#include <boost/asio/compose.hpp>
#include <boost/asio/error.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/beast/core/basic_stream.hpp>
#include <boost/beast/core/error.hpp>
#include <boost/beast/core/role.hpp>
#include <boost/beast/websocket/teardown.hpp>
#include <chrono>
#include <cstring>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <type_traits>

#include "base/tls/tls_engine.h"

namespace base {

template <class Executor>
class AnyStream {
 public:
  using executor_type = Executor;
  using TcpStream = boost::beast::basic_stream<boost::asio::ip::tcp, Executor>;
  using Socket = typename TcpStream::socket_type;
  using ErrorValue = boost::system::error_code;
  /// Written out, since finding it out would compile an operation for each question whether this is a stream.
  template <class Token>
  using TransferResult =
      typename boost::asio::async_result<std::decay_t<Token>, void(ErrorValue, std::size_t)>::return_type;

  template <class... Arguments>
  explicit AnyStream(Arguments&&... arguments) : core_(std::make_shared<Core>(std::forward<Arguments>(arguments)...)) {}
  AnyStream(AnyStream&&) noexcept = default;
  AnyStream& operator=(AnyStream&&) noexcept = default;

  executor_type get_executor() noexcept { return core_->tcp.get_executor(); }
  /// Beast's get_lowest_layer() ends here.
  TcpStream& next_layer() noexcept { return core_->tcp; }
  const TcpStream& next_layer() const noexcept { return core_->tcp; }
  Socket& socket() noexcept { return core_->tcp.socket(); }

  /// From here on the connection speaks TLS, beginning with the handshake. Called before the first read or write.
  void startTlsAsServer(const TlsContext& context) {
    core_->startTls(TlsEngine::forServer(context, socket().native_handle()));
  }
  void startTlsAsClient(const TlsContext& context, const std::string& host) {
    core_->startTls(TlsEngine::forClient(context, socket().native_handle(), host));
  }
  bool isTls() const { return core_->tls.has_value(); }
  /// The reason of the last failure of TLS, for people; empty: none.
  std::string tlsProblem() const { return isTls() ? core_->tls->problem() : std::string(); }
  bool metPlainHttp() const { return isTls() && core_->tls->metPlainHttp(); }

  /// Operations that are under way then end with beast::error::timeout, and the connection is closed.
  void expires_after(std::chrono::steady_clock::duration time) {
    if (isTls())
      core_->closeAfter(time);
    else
      core_->tcp.expires_after(time);
  }
  void expires_never() {
    if (isTls())
      core_->keepOpen();
    else
      core_->tcp.expires_never();
  }
  void close() { core_->tcp.close(); }
  /// Says that nothing follows; the peer may still send.
  void shutDownSending() {
    if (isTls() && socket().is_open()) core_->tls->sendClose();
    ErrorValue ignored;
    socket().shutdown(boost::asio::socket_base::shutdown_send, ignored);
  }
  /// For a socket that has become readable: whether the peer has closed, rather than sent something.
  bool isPeerGone() {
    if (!socket().is_open()) return true;
    if (isTls()) return core_->tls->isPeerGone();
    ErrorValue ec;
    return socket().available(ec) == 0 || ec;
  }

  /// handler(error_code); tlsProblem() has the words.
  template <class Handler>
  void async_handshake(Handler&& handler) {
    boost::asio::async_compose<Handler, void(ErrorValue)>(HandshakeOperation{core_}, handler, core_->tcp);
  }

  template <class Buffers, class Token>
  TransferResult<Token> async_read_some(const Buffers& buffers, Token&& token) {
    return boost::asio::async_initiate<Token, void(ErrorValue, std::size_t)>(
        [](auto&& handler, std::shared_ptr<Core> core, const Buffers& into) {
          if (!core->tls) return core->tcp.async_read_some(into, std::forward<decltype(handler)>(handler));
          boost::asio::async_compose<decltype(handler), void(ErrorValue, std::size_t)>(
              ReadOperation<Buffers>{core, into}, handler, core->tcp);
        },
        token, core_, buffers);
  }

  template <class Buffers, class Token>
  TransferResult<Token> async_write_some(const Buffers& buffers, Token&& token) {
    return boost::asio::async_initiate<Token, void(ErrorValue, std::size_t)>(
        [](auto&& handler, std::shared_ptr<Core> core, const Buffers& from) {
          if (!core->tls) return core->tcp.async_write_some(from, std::forward<decltype(handler)>(handler));
          boost::asio::async_compose<decltype(handler), void(ErrorValue, std::size_t)>(
              WriteOperation<Buffers>{core, from}, handler, core->tcp);
        },
        token, core_, buffers);
  }

 private:
  using Clock = std::chrono::steady_clock;
  using Timer = boost::asio::basic_waitable_timer<Clock, boost::asio::wait_traits<Clock>, Executor>;

  /// Stays where it is while the stream moves: operations and the timer hold it.
  struct Core : std::enable_shared_from_this<Core> {
    template <class... Arguments>
    explicit Core(Arguments&&... arguments) : tcp(std::forward<Arguments>(arguments)...) {}

    void startTls(TlsEngine engine) {
      ErrorValue ignored;
      tcp.expires_never();
      tcp.socket().native_non_blocking(true, ignored);
      timer.emplace(tcp.get_executor());
      tls.emplace(std::move(engine));
    }
    void closeAfter(Clock::duration time) {
      timer->expires_after(time);
      timer->async_wait([weak = this->weak_from_this(), number = ++deadline](ErrorValue cancelled) {
        const auto core = weak.lock();
        if (cancelled || !core || core->deadline != number) return;
        core->timed_out = true;
        core->tcp.close();
      });
    }
    void keepOpen() {
      ++deadline;
      timer->cancel();
    }
    /// Runs a step of TLS where the socket is open, since another connection may have its number after it was closed.
    template <class Run>
    TlsEngine::Outcome runStep(Run run, ErrorValue& ec) {
      if (!ec && !tcp.socket().is_open()) ec = boost::asio::error::operation_aborted;
      if (timed_out) ec = boost::beast::error::timeout;
      if (ec) return {};
      const TlsEngine::Outcome outcome = run(*tls);
      if (outcome.step == TlsEngine::Step::kClosed) ec = boost::asio::error::eof;
      if (outcome.step == TlsEngine::Step::kFailed)
        ec = tls->systemError() != 0 ? ErrorValue(tls->systemError(), boost::system::system_category())
                                     : boost::system::errc::make_error_code(boost::system::errc::protocol_error);
      return outcome;
    }

    TcpStream tcp;
    std::optional<TlsEngine> tls;
    std::optional<Timer> timer;  // with TLS; a plain stream has Beast's timers
    std::uint64_t deadline = 0;  // number of the last one set; older ones do nothing
    bool timed_out = false;
  };

  /// Runs steps of TLS, and waits for the socket between them. Derived has step(TlsEngine&) and finish(self, ec).
  template <class Derived>
  struct Operation {
    explicit Operation(std::shared_ptr<Core> on) : core(std::move(on)) {}

    template <class Self>
    void operator()(Self& self, ErrorValue ec = {}) {
      auto& derived = static_cast<Derived&>(*this);
      if (stage == Stage::kPosted) return derived.finish(self, result);
      using Step = TlsEngine::Step;
      const TlsEngine::Outcome outcome = core->runStep([&](TlsEngine& tls) { return derived.step(tls); }, ec);
      const bool waits = !ec && outcome.step != Step::kDone;
      const bool first = stage == Stage::kFirst;
      if (waits) {
        stage = Stage::kWaiting;
        const auto what = outcome.step == Step::kWantsToRead ? Socket::wait_read : Socket::wait_write;
        // Named before `self`, which holds this object, moves away.
        Socket& socket = core->tcp.socket();
        return socket.async_wait(what, std::move(self));
      }
      if (!first) return derived.finish(self, ec);
      // A handler is never called from within the function that was given it.
      stage = Stage::kPosted;
      result = ec;
      const Executor executor = core->tcp.get_executor();
      boost::asio::post(executor, std::move(self));
    }

    enum class Stage { kFirst, kWaiting, kPosted };
    std::shared_ptr<Core> core;
    Stage stage = Stage::kFirst;
    ErrorValue result;
  };

  struct HandshakeOperation : Operation<HandshakeOperation> {
    using Operation<HandshakeOperation>::Operation;
    TlsEngine::Outcome step(TlsEngine& tls) { return tls.handshake(); }
    template <class Self>
    void finish(Self& self, ErrorValue ec) {
      self.complete(ec);
    }
  };

  template <class Buffers>
  struct ReadOperation : Operation<ReadOperation<Buffers>> {
    ReadOperation(std::shared_ptr<Core> on, const Buffers& into)
        : Operation<ReadOperation>(std::move(on)), buffers(into) {}
    TlsEngine::Outcome step(TlsEngine& tls) {
      TlsEngine::Outcome outcome{TlsEngine::Step::kDone};
      for (auto it = boost::asio::buffer_sequence_begin(buffers); it != boost::asio::buffer_sequence_end(buffers);
           ++it) {
        const boost::asio::mutable_buffer buffer(*it);
        if (buffer.size() == 0) continue;
        outcome = tls.read({static_cast<std::uint8_t*>(buffer.data()), buffer.size()});
        break;
      }
      bytes = outcome.bytes;
      return outcome;
    }
    template <class Self>
    void finish(Self& self, ErrorValue ec) {
      self.complete(ec, ec ? 0 : bytes);
    }
    Buffers buffers;
    std::size_t bytes = 0;
  };

  template <class Buffers>
  struct WriteOperation : Operation<WriteOperation<Buffers>> {
    WriteOperation(std::shared_ptr<Core> on, const Buffers& from)
        : Operation<WriteOperation>(std::move(on)), buffers(from) {}
    /// Writes records while the socket takes them. A record is gathered of several buffers, so that a frame's few bytes
    /// of header do not travel alone.
    TlsEngine::Outcome step(TlsEngine& tls) {
      constexpr std::size_t kRecord = 16384;
      static thread_local std::array<std::uint8_t, kRecord> gathered;
      const std::size_t all = boost::asio::buffer_size(buffers);
      while (bytes < all) {
        const TlsEngine::Outcome outcome = tls.write(ByteView(gathered).first(gather(gathered)));
        if (outcome.step != TlsEngine::Step::kDone) {
          const bool waits =
              outcome.step == TlsEngine::Step::kWantsToRead || outcome.step == TlsEngine::Step::kWantsToWrite;
          return waits && bytes > 0 ? TlsEngine::Outcome{TlsEngine::Step::kDone, bytes} : outcome;
        }
        bytes += outcome.bytes;
      }
      return {TlsEngine::Step::kDone, bytes};
    }
    /// Copies what follows the bytes that were written; returns how many came together.
    std::size_t gather(std::span<std::uint8_t> out) const {
      std::size_t skipped = bytes, size = 0;
      for (auto it = boost::asio::buffer_sequence_begin(buffers); it != boost::asio::buffer_sequence_end(buffers);
           ++it) {
        boost::asio::const_buffer buffer(*it);
        const std::size_t skip = std::min(skipped, buffer.size());
        skipped -= skip;
        buffer += skip;
        const std::size_t count = std::min(buffer.size(), out.size() - size);
        if (count != 0) std::memcpy(out.data() + size, buffer.data(), count);
        size += count;
        if (size == out.size()) break;
      }
      return size;
    }
    template <class Self>
    void finish(Self& self, ErrorValue ec) {
      self.complete(ec, bytes);
    }
    Buffers buffers;
    std::size_t bytes = 0;
  };

  std::shared_ptr<Core> core_;
};

/// Beast calls these at the end of a WebSocket's closing.
template <class Executor, class Handler>
void async_teardown(boost::beast::role_type role, AnyStream<Executor>& stream, Handler&& handler) {
  if (stream.isTls()) stream.shutDownSending();
  using boost::beast::websocket::async_teardown;
  async_teardown(role, stream.next_layer().socket(), std::forward<Handler>(handler));
}

}  // namespace base
