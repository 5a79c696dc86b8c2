#include "sim_workers/video/video_file.h"

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/imgutils.h>
#include <libavutil/opt.h>
#include <spdlog/fmt/fmt.h>
}

#include <opencv2/imgproc.hpp>
#include <utility>

#include "rollout_buffer/schema/version.h"

namespace comrad::sim {
namespace {

// Textures of Doom are noise to an encoder: its costlier searches find little in them, better coding of what is left more.
// 1 750 frames of dumb_enemies, two views of 320x180: 7.6 MB at 28.3 dB in 4.8 s of processor time (drawing included) with
// these, 7.7 MB at 28.1 dB in 5.8 s with "superfast" and 31, 5.7 MB at 28.5 dB in 8.3 s with "veryfast" and 30.
constexpr const char *kPreset = "ultrafast", *kQuality = "32",
                     *kTools = "cabac=1:deblock=0,0:bframes=2:b-adapt=0";

}  // namespace

Expected<std::unique_ptr<VideoFile>> VideoFile::create(const std::string& path, cv::Size size) {
  av_log_set_level(AV_LOG_ERROR);
  std::unique_ptr<VideoFile> video(new VideoFile(path));
  COMRAD_TRY(video->open(size));
  return video;
}

VideoFile::~VideoFile() {
  if (format_ != nullptr) avio_closep(&format_->pb);
  avformat_free_context(format_);
  avcodec_free_context(&encoder_);
  av_frame_free(&frame_);
  av_packet_free(&packet_);
}

Error VideoFile::error(ErrorCode code, const std::string& what, int ffmpeg_code) const {
  char text[AV_ERROR_MAX_STRING_SIZE] = {};
  av_strerror(ffmpeg_code, text, sizeof text);
  return Error{code, path_ + ": " + what + " (" + text + ")"};
}

Status VideoFile::open(cv::Size size) {
  const AVCodec* const codec = avcodec_find_encoder(AV_CODEC_ID_H264);
  const auto unsupported = [&](int code) {
    return error(
        ErrorCode::kUnsupported,
        fmt::format("FFmpeg cannot write H.264 of {}x{} there; a smaller --size, a .gif or --frames may do",
                    size.width, size.height),
        code);
  };
  if (codec == nullptr) return unsupported(AVERROR_ENCODER_NOT_FOUND);
  if (const int code = avformat_alloc_output_context2(&format_, nullptr, nullptr, path_.c_str()); code < 0)
    return unsupported(code);
  encoder_ = avcodec_alloc_context3(codec);
  encoder_->width = size.width, encoder_->height = size.height;
  encoder_->pix_fmt = AV_PIX_FMT_YUV420P;
  encoder_->time_base = {kTicsPerFrame, kTicRateHz};
  encoder_->framerate = {kTicRateHz, kTicsPerFrame};
  encoder_->thread_count = 0;  // as many as there are cores
  if ((format_->oformat->flags & AVFMT_GLOBALHEADER) != 0) encoder_->flags |= AV_CODEC_FLAG_GLOBAL_HEADER;
  for (const auto& [name, value] : {std::pair{"preset", kPreset}, {"crf", kQuality}, {"x264-params", kTools}})
    av_opt_set(encoder_->priv_data, name, value, 0);  // another encoder than libx264 has none
  if (const int code = avcodec_open2(encoder_, codec, nullptr); code < 0) return unsupported(code);

  AVStream* const stream = avformat_new_stream(format_, nullptr);
  stream->time_base = encoder_->time_base;
  stream->avg_frame_rate = encoder_->framerate;
  avcodec_parameters_from_context(stream->codecpar, encoder_);
  if (const int code = avio_open(&format_->pb, path_.c_str(), AVIO_FLAG_WRITE); code < 0)
    return error(ErrorCode::kSystem, "cannot be made; is the folder writable?", code);
  if (const int code = avformat_write_header(format_, nullptr); code < 0) return unsupported(code);

  packet_ = av_packet_alloc();
  frame_ = av_frame_alloc();
  frame_->format = encoder_->pix_fmt;
  frame_->width = size.width, frame_->height = size.height;
  frame_->pts = 0;
  if (const int code = av_frame_get_buffer(frame_, 0); code < 0) return unsupported(code);
  return {};
}

int VideoFile::encode(const AVFrame* frame) {
  int code = avcodec_send_frame(encoder_, frame);
  while (code >= 0) {
    code = avcodec_receive_packet(encoder_, packet_);
    if (code == AVERROR(EAGAIN) || code == AVERROR_EOF) return 0;
    if (code < 0) break;
    av_packet_rescale_ts(packet_, encoder_->time_base, format_->streams[0]->time_base);
    packet_->stream_index = 0;
    packet_->duration = av_rescale_q(1, encoder_->time_base, format_->streams[0]->time_base);
    code = av_interleaved_write_frame(format_, packet_);
  }
  return code;
}

Status VideoFile::add(const cv::Mat& picture, int64_t tics) {
  int code = av_frame_make_writable(frame_);
  if (code >= 0) {
    cv::cvtColor(picture, planes_, cv::COLOR_BGR2YUV_I420);
    const uint8_t* plane = planes_.data;
    for (const int i : {0, 1, 2}) {
      const int width = i == 0 ? picture.cols : picture.cols / 2,
                rows = i == 0 ? picture.rows : picture.rows / 2;
      av_image_copy_plane(frame_->data[i], frame_->linesize[i], plane, width, width, rows);
      plane += static_cast<std::ptrdiff_t>(width) * rows;
    }
    for (tics_ += tics; code >= 0 && frame_->pts * kTicsPerFrame < tics_; ++frame_->pts)
      code = encode(frame_);
  }
  return code >= 0 ? Status() : error(ErrorCode::kNoSpace, "cannot be written; is the disk full?", code);
}

Status VideoFile::finish() {
  int code = encode(nullptr);
  if (code >= 0) code = av_write_trailer(format_);
  const int closed = avio_closep(&format_->pb);
  if (code >= 0) code = closed;
  return code >= 0 ? Status() : error(ErrorCode::kNoSpace, "cannot be written; is the disk full?", code);
}

}  // namespace comrad::sim
