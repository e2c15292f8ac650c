#include "compare/sim/video_codec.h"

#include <algorithm>
#include <string>

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavutil/imgutils.h>
#include <libavutil/log.h>
#include <libavutil/opt.h>
#include <libswscale/swscale.h>
}

namespace compare {
namespace {

using base::Error;
using base::ErrorCode;
using base::Result;

constexpr int kExact = SWS_BILINEAR | SWS_ACCURATE_RND | SWS_BITEXACT | SWS_FULL_CHR_H_INT;

int evenSide(int side) {
  return side + side % 2;
}

Error failure(const std::string& what, int code) {
  char text[AV_ERROR_MAX_STRING_SIZE] = {};
  av_strerror(code, text, sizeof text);
  return {ErrorCode::kIo, "video: " + what + ": " + text};
}

/// The picture with even sides.
base::Image padded(const base::Image& rgb) {
  base::Image out(evenSide(rgb.width), evenSide(rgb.height), 3);
  for (int y = 0; y < out.height; ++y)
    for (int x = 0; x < out.width; ++x)
      std::copy_n(rgb.at(std::min(x, rgb.width - 1), std::min(y, rgb.height - 1)), 3, out.at(x, y));
  return out;
}

}  // namespace

Result<base::Bytes> toVideoInput(const base::Image& rgb) {
  const base::Image even = padded(rgb);
  const int w = even.width, h = even.height;
  SwsContext* scaler =
      sws_getContext(w, h, AV_PIX_FMT_RGB24, w, h, AV_PIX_FMT_YUV420P, kExact, nullptr, nullptr, nullptr);
  if (scaler == nullptr) return failure("colours cannot be converted", AVERROR(EINVAL));
  base::Bytes planes(static_cast<std::size_t>(av_image_get_buffer_size(AV_PIX_FMT_YUV420P, w, h, 1)));
  std::uint8_t* to[4] = {};
  int to_strides[4] = {};
  av_image_fill_arrays(to, to_strides, planes.data(), AV_PIX_FMT_YUV420P, w, h, 1);
  const std::uint8_t* from[4] = {even.pixels.data()};
  const int from_strides[4] = {3 * w};
  sws_scale(scaler, from, from_strides, 0, h, to, to_strides);
  sws_freeContext(scaler);
  return planes;
}

// ---- VideoEncoder ----

Result<std::unique_ptr<VideoEncoder>> VideoEncoder::create(const VideoFormat& format) {
  const AVCodec* codec = avcodec_find_encoder_by_name("libx264");
  if (codec == nullptr)
    return Error{ErrorCode::kUnsupported, "the method video needs a libavcodec with x264; leave it out of --methods"};
  av_log_set_level(AV_LOG_ERROR);
  std::unique_ptr<VideoEncoder> encoder(new VideoEncoder);
  AVCodecContext* context = encoder->context_ = avcodec_alloc_context3(codec);
  context->width = evenSide(format.width);
  context->height = evenSide(format.height);
  context->pix_fmt = AV_PIX_FMT_YUV420P;
  context->time_base = {1, format.frames_per_second};
  context->framerate = {format.frames_per_second, 1};
  context->thread_count = 1;
  context->gop_size = -1;  // TCP loses nothing, so whole pictures are needed at cuts alone
  context->bit_rate = context->rc_max_rate = static_cast<std::int64_t>(format.bits_per_second);
  context->rc_buffer_size = static_cast<int>(std::min(0.1 * format.bits_per_second, 2e9));
  av_opt_set(context->priv_data, "preset", "veryfast", 0);
  av_opt_set(context->priv_data, "tune", "zerolatency", 0);
  if (const int code = avcodec_open2(context, codec, nullptr); code < 0) return failure("x264 does not start", code);
  encoder->packet_ = av_packet_alloc();
  AVFrame* frame = encoder->frame_ = av_frame_alloc();
  frame->format = context->pix_fmt;
  frame->width = context->width;
  frame->height = context->height;
  frame->pts = 0;
  if (const int code = av_frame_get_buffer(frame, 0); code < 0) return failure("no memory for a picture", code);
  return encoder;
}

VideoEncoder::~VideoEncoder() {
  av_packet_free(&packet_);
  av_frame_free(&frame_);
  avcodec_free_context(&context_);
}

Result<base::Bytes> VideoEncoder::encode(base::ByteView input) {
  if (const int code = av_frame_make_writable(frame_); code < 0) return failure("no memory for a picture", code);
  std::uint8_t* from[4] = {};
  int strides[4] = {};
  av_image_fill_arrays(from, strides, input.data(), AV_PIX_FMT_YUV420P, frame_->width, frame_->height, 1);
  av_image_copy(frame_->data, frame_->linesize, const_cast<const std::uint8_t**>(from), strides, AV_PIX_FMT_YUV420P,
                frame_->width, frame_->height);
  if (const int code = avcodec_send_frame(context_, frame_); code < 0) return failure("x264 refuses a picture", code);
  ++frame_->pts;
  if (const int code = avcodec_receive_packet(context_, packet_); code < 0) return failure("x264 holds back", code);
  base::Bytes coded(packet_->data, packet_->data + packet_->size);
  av_packet_unref(packet_);
  return coded;
}

// ---- VideoDecoder ----

Result<std::unique_ptr<VideoDecoder>> VideoDecoder::create(int width, int height) {
  const AVCodec* codec = avcodec_find_decoder(AV_CODEC_ID_H264);
  if (codec == nullptr) return Error{ErrorCode::kUnsupported, "the method video needs a libavcodec with H.264"};
  std::unique_ptr<VideoDecoder> decoder(new VideoDecoder(width, height));
  decoder->context_ = avcodec_alloc_context3(codec);
  decoder->context_->thread_count = 1;
  decoder->context_->flags |= AV_CODEC_FLAG_LOW_DELAY;
  if (const int code = avcodec_open2(decoder->context_, codec, nullptr); code < 0)
    return failure("the decoder does not start", code);
  decoder->packet_ = av_packet_alloc();
  decoder->frame_ = av_frame_alloc();
  const int w = evenSide(width), h = evenSide(height);
  decoder->to_rgb_ =
      sws_getContext(w, h, AV_PIX_FMT_YUV420P, w, h, AV_PIX_FMT_RGB24, kExact, nullptr, nullptr, nullptr);
  if (decoder->to_rgb_ == nullptr) return failure("colours cannot be converted", AVERROR(EINVAL));
  return decoder;
}

VideoDecoder::~VideoDecoder() {
  sws_freeContext(to_rgb_);
  av_packet_free(&packet_);
  av_frame_free(&frame_);
  avcodec_free_context(&context_);
}

Result<base::Image> VideoDecoder::decode(base::ByteView coded) {
  if (const int code = av_new_packet(packet_, static_cast<int>(coded.size())); code < 0)
    return failure("no memory for a picture", code);
  std::copy(coded.begin(), coded.end(), packet_->data);
  int code = avcodec_send_packet(context_, packet_);
  av_packet_unref(packet_);
  if (code >= 0) code = avcodec_receive_frame(context_, frame_);
  if (code < 0) return failure("a picture cannot be decoded", code);
  const int w = evenSide(width_), h = evenSide(height_);
  if (frame_->width != w || frame_->height != h) return failure("a picture has another size", AVERROR_INVALIDDATA);
  base::Image even(w, h, 3);
  std::uint8_t* to[4] = {even.pixels.data()};
  const int strides[4] = {3 * w};
  sws_scale(to_rgb_, frame_->data, frame_->linesize, 0, h, to, strides);
  base::Image rgb(width_, height_, 3);
  for (int y = 0; y < height_; ++y) std::copy_n(even.at(0, y), 3 * static_cast<std::size_t>(width_), rgb.at(0, y));
  return rgb;
}

}  // namespace compare
