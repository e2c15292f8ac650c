#include "server/bake/draw_messages.h"

#include <sys/socket.h>
#include <cerrno>

#include <algorithm>
#include <array>
#include <cstring>
#include <string_view>
#include <utility>

#include "base/fields.h"

namespace server {
namespace {

constexpr std::uint32_t kMaxBytes = std::uint32_t{256} << 20;  // length of a message; the largest face takes far less

base::Error broken(const std::string& problem) {
  return {base::ErrorCode::kIo, "drawing process: " + problem};
}

base::Result<void> sendAll(int socket, base::ByteView bytes) {
  while (!bytes.empty()) {
    const ssize_t sent = ::send(socket, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (sent < 0 && errno == EINTR) continue;
    if (sent <= 0) return broken(std::string("cannot be told anything: ") + std::strerror(errno));
    bytes = bytes.subspan(static_cast<std::size_t>(sent));
  }
  return {};
}

/// As many bytes as there are before the other end closes.
base::Result<std::size_t> receiveUpTo(int socket, std::uint8_t* to, std::size_t count) {
  std::size_t got = 0;
  while (got < count) {
    const ssize_t received = ::recv(socket, to + got, count - got, 0);
    if (received < 0 && errno == EINTR) continue;
    if (received < 0) return broken(std::string("cannot be heard: ") + std::strerror(errno));
    if (received == 0) break;
    got += static_cast<std::size_t>(received);
  }
  return got;
}

void writeText(base::ByteWriter& out, std::string_view text) {
  out.u32(static_cast<std::uint32_t>(text.size()));
  out.bytes(base::viewOfText(text));
}

std::string readText(base::ByteReader& in) {
  const base::ByteView text = in.bytes(in.u32());
  return {text.begin(), text.end()};
}

// Both ends are one program, so fields travel as they lie in memory.
auto settingsOf(auto& order) {
  return std::tie(order.render.tolerance_px, order.render.measure, order.render.supersampling,
                  order.render.max_target_samples, order.render.tile_samples, order.render.one_of_many, order.quality,
                  order.subsampling, order.codec, order.gpu_budget_bytes);
}
auto fieldsOf(auto& sequence, auto& face) {
  return std::tie(sequence, face.empty, face.jpeg_bytes, face.coverage_bytes);
}

}  // namespace

base::Result<void> sendMessage(int socket, DrawMessageKind kind, base::ByteView body) {
  base::ByteWriter out;
  out.u32(static_cast<std::uint32_t>(body.size() + 1));
  out.u8(static_cast<std::uint8_t>(kind));
  out.bytes(body);
  return sendAll(socket, out.view());
}

base::Result<std::optional<DrawMessage>> receiveMessage(int socket) {
  std::array<std::uint8_t, 5> head{};
  LUMIGRID_ASSIGN_OR_RETURN(const auto got, receiveUpTo(socket, head.data(), head.size()));
  if (got == 0) return std::optional<DrawMessage>();
  base::ByteReader in(head);
  const std::uint32_t length = in.u32();
  const auto kind = static_cast<DrawMessageKind>(in.u8());
  if (got < head.size() || length == 0 || length > kMaxBytes) return broken("a message without a sound beginning");
  DrawMessage message{kind, base::Bytes(length - 1)};
  LUMIGRID_ASSIGN_OR_RETURN(const auto rest, receiveUpTo(socket, message.body.data(), message.body.size()));
  if (rest < message.body.size()) return broken("ended in the middle of a message");
  return std::optional<DrawMessage>(std::move(message));
}

base::Bytes encodeOrder(const FaceWork& work) {
  base::Scene drawn = work.scene;  // where its bytes are from does not matter here
  drawn.sources.clear();
  base::ByteWriter out;
  writeText(out, base::formatScene(drawn));
  writeText(out, work.patches.path());
  work.grid.encode(out);
  base::writeFields(out, settingsOf(work));
  if (work.tiles != nullptr) out.bytes(work.tiles->encode(work.grid));
  return out.takeBytes();
}

base::Result<DrawOrder> decodeOrder(base::ByteView body) {
  base::ByteReader in(body);
  DrawOrder order;
  LUMIGRID_ASSIGN_OR_RETURN(order.scene, base::parseScene(readText(in), "the scene of a drawing process"));
  order.patch_path = readText(in);
  LUMIGRID_ASSIGN_OR_RETURN(order.grid, repository::Grid::decode(in));
  base::readFields(in, settingsOf(order));
  if (in.ok() && !in.atEnd()) {
    LUMIGRID_ASSIGN_OR_RETURN(order.tiles, repository::WantedTiles::decode(order.grid, in.bytes(in.remaining())));
  }
  if (!in.atEnd()) return broken("an order of another length");
  return order;
}

base::Bytes encodeJob(const DrawJob& job) {
  base::ByteWriter out;
  out.u64(job.sequence);
  for (const repository::FaceKey& key : job.keys) out.u64(key.code());
  return out.takeBytes();
}

base::Result<DrawJob> decodeJob(base::ByteView body) {
  base::ByteReader in(body);
  DrawJob job{in.u64(), {}};
  while (in.ok() && !in.atEnd()) {
    LUMIGRID_ASSIGN_OR_RETURN(auto key, repository::FaceKey::fromCode(in.u64()));
    job.keys.push_back(key);
  }
  if (!in.ok() || job.keys.empty()) return broken("a job of no faces");
  return job;
}

base::Bytes encodeNumberedFace(std::uint64_t sequence, const EncodedFace& face) {
  base::ByteWriter out;
  base::writeFields(out, fieldsOf(sequence, face));
  for (const EncodedTile& tile : face.tiles) {
    out.u32(tile.tile);
    out.u32(static_cast<std::uint32_t>(tile.value.size()));
    out.bytes(tile.value);
  }
  return out.takeBytes();
}

base::Result<NumberedFace> decodeNumberedFace(base::ByteView body) {
  base::ByteReader in(body);
  NumberedFace made;
  base::readFields(in, fieldsOf(made.sequence, made.face));
  while (in.ok() && !in.atEnd()) {
    const std::uint32_t tile = in.u32();
    const base::ByteView value = in.bytes(in.u32());
    made.face.tiles.push_back({tile, base::Bytes(value.begin(), value.end())});
  }
  if (!in.ok() || made.face.tiles.empty()) return broken("a face of too few bytes");
  return made;
}

base::Bytes encodeError(const base::Error& error) {
  base::ByteWriter out;
  out.u8(static_cast<std::uint8_t>(error.code));
  writeText(out, error.message);
  return out.takeBytes();
}

base::Error decodeError(base::ByteView body) {
  base::ByteReader in(body);
  const std::uint8_t code = in.u8();
  std::string text = readText(in);
  if (!in.atEnd() || code > static_cast<std::uint8_t>(base::ErrorCode::kCancelled)) return broken("an unknown error");
  return {static_cast<base::ErrorCode>(code), std::move(text)};
}

}  // namespace server
