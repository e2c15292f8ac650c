#pragma once
// Encodes exact frames in a codec that the client decodes.
#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"
#include "protocol/message.h"

namespace server {

/// Encodes a picture (as RenderedPicture::rgba) as the value of a Frame: WebP with 8 bits of alpha, or JPEG with a mask
/// of one bit (encodeFace), 4:4:4 from quality 90 on; JPEG too where a side is longer than WebP allows.
/// `quality`: 1..100; or kServersChoice for the codec's default, or kWithoutLoss, which is the default where the codec
/// is JPEG or a message cannot hold as much (base::ViewDefaults). A picture without model becomes an empty flag, and so
/// does, as JPEG, one whose every pixel is less than half model.
/// JPEG tells no coding error.
base::Result<protocol::EncodedFrame> encodeFrame(const base::Image& rgba, protocol::FrameCodec codec, int quality);

}  // namespace server
