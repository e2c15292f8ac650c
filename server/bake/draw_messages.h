#pragma once
// A bake and its drawing processes exchange these messages over a socket: a u32 length (of the rest), a u8 kind and a
// body, little-endian. Both ends are one program in one run, so there is no version.
#include <cstdint>
#include <optional>
#include <string>

#include "base/bytes.h"
#include "base/error.h"
#include "base/json/scene_file.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/wanted_tiles.h"
#include "server/bake/face_maker.h"

namespace server {

enum class DrawMessageKind : std::uint8_t {
  kOrder = 1,  ///< the first to the process: what to draw and how (encodeOrder)
  kJob = 2,    ///< any number follow (encodeJob)
  kFace = 3,   ///< the answers: a job's faces in order, each with all its tiles (encodeNumberedFace)
  kError = 4   ///< the last answer where something failed: code and text (encodeError)
};

struct DrawMessage {
  DrawMessageKind kind = DrawMessageKind::kError;
  base::Bytes body;
};

/// Blocks until all is written; kIo when the other end is gone.
base::Result<void> sendMessage(int socket, DrawMessageKind kind, base::ByteView body);
/// Blocks until a message is there; nothing when the other end has closed between two messages. kIo in the middle of
/// one, or when it is longer than any message may be.
base::Result<std::optional<DrawMessage>> receiveMessage(int socket);

/// FaceWork without references, as it travels.
struct DrawOrder {
  base::Scene scene;
  std::string patch_path;
  repository::Grid grid;
  RenderOptions render;
  int quality = 0;
  base::Subsampling subsampling = base::Subsampling::k420;
  repository::ImageCodec codec = repository::ImageCodec::kJpeg;
  std::uint64_t gpu_budget_bytes = 0;
  std::optional<repository::WantedTiles> tiles;
};

struct NumberedFace {
  std::uint64_t sequence = 0;
  EncodedFace face;
};

base::Bytes encodeOrder(const FaceWork& work);
base::Result<DrawOrder> decodeOrder(base::ByteView body);
base::Bytes encodeJob(const DrawJob& job);
base::Result<DrawJob> decodeJob(base::ByteView body);
base::Bytes encodeNumberedFace(std::uint64_t sequence, const EncodedFace& face);
base::Result<NumberedFace> decodeNumberedFace(base::ByteView body);
base::Bytes encodeError(const base::Error& error);
base::Error decodeError(base::ByteView body);

}  // namespace server
