#pragma once
// H.264 with the settings of low delay, by libavcodec: x264 on the server's side, libavcodec's own decoder on the
// client's. One thread each and exact arithmetic, so that the same pictures give the same bytes on every machine.
#include <memory>
#include <optional>

#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"

struct AVCodecContext;
struct AVFrame;
struct AVPacket;
struct SwsContext;

namespace compare {

struct VideoFormat {
  int width = 0, height = 0;
  int frames_per_second = 30;
  double bits_per_second = 0.0;
};

/// A picture as the encoder reads it: YUV 4:2:0 planes of even width and height, one after the other, BT.601.
/// `rgb`: 3 channels. Odd sides get one more row or column, equal to the last.
base::Result<base::Bytes> toVideoInput(const base::Image& rgb);

class VideoEncoder {
 public:
  /// Rate control holds every tenth of a second to the rate. kUnsupported where libavcodec lacks x264.
  static base::Result<std::unique_ptr<VideoEncoder>> create(const VideoFormat& format);
  ~VideoEncoder();
  VideoEncoder(const VideoEncoder&) = delete;
  VideoEncoder& operator=(const VideoEncoder&) = delete;
  /// Encodes the next picture, as toVideoInput() returns it, without waiting for later ones.
  base::Result<base::Bytes> encode(base::ByteView input);

 private:
  VideoEncoder() = default;
  AVCodecContext* context_ = nullptr;
  AVFrame* frame_ = nullptr;
  AVPacket* packet_ = nullptr;
};

class VideoDecoder {
 public:
  static base::Result<std::unique_ptr<VideoDecoder>> create(int width, int height);
  ~VideoDecoder();
  VideoDecoder(const VideoDecoder&) = delete;
  VideoDecoder& operator=(const VideoDecoder&) = delete;
  /// Decodes what one encode() returned, in the same order. RGB.
  base::Result<base::Image> decode(base::ByteView coded);

 private:
  VideoDecoder(int width, int height) : width_(width), height_(height) {}
  int width_, height_;
  AVCodecContext* context_ = nullptr;
  AVFrame* frame_ = nullptr;
  AVPacket* packet_ = nullptr;
  SwsContext* to_rgb_ = nullptr;
};

}  // namespace compare
