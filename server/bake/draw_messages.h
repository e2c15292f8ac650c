#pragma once
// What a bake and its drawing processes say to each other over a socket: messages of a u32 length (of what follows), a
// u8 kind and a body. Little-endian, of one program and one run: no version.
#include <cstdint>
#include <optional>
#include <string>

#include "base/bytes.h"
#include "base/error.h"
#include "base/json/scene_file.h"
#include "repository/sampling/grid.h"
#include "server/bake/face_maker.h"

namespace server {

enum class DrawMessageKind : std::uint8_t {
  kOrder = 1,  ///< first, to the process: what to draw and how (encodeOrder)
  kJob = 2,    ///< then any number of these (encodeJob)
  kFace = 3,   ///< its answers: a job's faces in order (encodeMadeFace)
  kError = 4   ///< or, as the last: code and text (encodeError)
};

struct DrawMessage {
  DrawMessageKind kind = DrawMessageKind::kError;
  base::Bytes body;
};

/// Blocks until all is written; kIo when the other end is gone.
base::Result<void> sendMessage(int socket, DrawMessageKind kind, base::ByteView body);
/// Blocks until one is there; nothing when the other end has closed between two messages. kIo in the middle of one, or
/// when it is longer than any message may be.
base::Result<std::optional<DrawMessage>> receiveMessage(int socket);

/// FaceWork without references, as it travels.
struct DrawOrder {
  base::Scene scene;
  std::string patch_path;
  repository::Grid grid;
  RenderOptions render;
  int quality = 0;
  repository::Subsampling subsampling = repository::Subsampling::k420;
  std::uint64_t gpu_budget_bytes = 0;
};

struct MadeFace {
  std::uint64_t sequence = 0;
  EncodedFace face;
};

base::Bytes encodeOrder(const FaceWork& work);
base::Result<DrawOrder> decodeOrder(base::ByteView body);
base::Bytes encodeJob(const DrawJob& job);
base::Result<DrawJob> decodeJob(base::ByteView body);
base::Bytes encodeMadeFace(std::uint64_t sequence, const EncodedFace& face);
base::Result<MadeFace> decodeMadeFace(base::ByteView body);
base::Bytes encodeError(const base::Error& error);
base::Error decodeError(base::ByteView body);

}  // namespace server
