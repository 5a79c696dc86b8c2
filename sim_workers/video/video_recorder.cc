#include "sim_workers/video/video_recorder.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <utility>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/schema/version.h"
#include "sim_workers/engine/render/png_image.h"
#include "sim_workers/video/gif_file.h"
#include "sim_workers/video/video_file.h"

namespace comrad::sim {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kHeldTics = 35;  // an episode's last picture stands for a second

std::vector<std::vector<std::string>> buttons_of(const DoomGame& game) {
  std::vector<std::vector<std::string>> buttons;
  for (const scenarios::ActionHead& head : game.spec.heads) buttons.push_back(head.buttons);
  return buttons;
}

}  // namespace

VideoRecorder::VideoRecorder(const VideoOptions& options, VideoFrame frame)
    : options_(options),
      frame_(std::move(frame)),
      tics_left_(options.seconds > 0 ? std::max(1L, std::lround(kTicRateHz * options.seconds))
                                     : std::numeric_limits<int64_t>::max()) {}

VideoRecorder::~VideoRecorder() = default;

Expected<std::unique_ptr<VideoRecorder>> VideoRecorder::create(const VideoOptions& options,
                                                               const EnvironmentOptions& environments,
                                                               const DoomGame& first) {
  std::unique_ptr<VideoRecorder> recorder(
      new VideoRecorder(options, VideoFrame(options.size, first.num_agents, buttons_of(first))));
  COMRAD_TRY_ASSIGN(recorder->renderer_,
                    make_renderer(first, environments.wads(), options.size, environments.renderer));
  recorder->views_.assign(static_cast<std::size_t>(first.num_agents),
                          std::vector<uint8_t>(std::size_t{3} * options.size.width * options.size.height));
  recorder->caption_.scenario = first.spec.name;
  recorder->caption_.agents.resize(recorder->views_.size());
  for (AgentCaption& agent : recorder->caption_.agents) agent.choice.resize(first.spec.heads.size());
  if (!options.frames.empty()) {
    std::error_code failed;
    fs::create_directories(options.frames, failed);
    if (failed) return file_error(options.frames, failed.value());
  }
  const cv::Size size = recorder->frame_.size();
  if (lower_case(options.video).ends_with(".gif")) {
    COMRAD_TRY_ASSIGN(recorder->file_, GifFile::create(options.video, size));
    recorder->is_gif_ = true;
  } else if (!options.video.empty()) {
    COMRAD_TRY_ASSIGN(recorder->file_, VideoFile::create(options.video, size));
  }
  return recorder;
}

void VideoRecorder::began(const DoomEnvironment& environment) {
  caption_.episode = episodes_++;
  record(environment, true);
}

void VideoRecorder::ticked(const DoomEnvironment& environment) {
  const auto frame_skip = static_cast<uint64_t>(environment.game().frame_skip);
  record(environment,
         environment.last_step().episode_over() || environment.world().tic_count() % frame_skip == 0);
}

void VideoRecorder::record(const DoomEnvironment& environment, bool ends_a_decision) {
  if (!status_ || tics_left_ <= 0) return;
  const bool is_over = environment.last_step().episode_over();
  const int64_t tics = is_over ? std::min(kHeldTics, tics_left_) : 1;
  tics_left_ -= tics;
  // Numbers that change with every tic cannot be read, and text is the dearest to draw.
  if (ends_a_decision) read_captions(environment);
  const bool is_png = ends_a_decision && !options_.frames.empty();
  const bool is_frame = file_ != nullptr && (is_gif_ ? ends_a_decision : is_over || --shown_tics_ < 0);
  if (!is_frame && !is_png) return;
  const cv::Mat& picture = draw(environment);
  if (is_frame) {
    const int64_t frame_tics = is_gif_ ? environment.game().frame_skip : kTicsPerFrame;
    status_ = file_->add(picture, is_over ? tics : frame_tics);
    shown_tics_ = is_over ? 0 : frame_tics - 1;
  }
  if (status_ && is_png) status_ = write_picture(picture, caption_.decisions);
}

void VideoRecorder::read_captions(const DoomEnvironment& environment) {
  const DoomGame& game = environment.game();
  const EpisodeRecord summary = environment.summary_so_far();
  for (int agent = 0; agent < game.num_agents; ++agent) {
    const auto index = static_cast<std::size_t>(agent);
    AgentCaption& caption = caption_.agents[index];
    game.actions.choose(environment.pressed()[index], caption.choice);
    caption.return_so_far = summary.agent_return[index];
    caption.score = summary.agent_score[index];
    caption.is_alive = environment.world().player(agent).alive;
  }
  caption_.tics = summary.length_tics;
  caption_.decisions = summary.length_steps;
  caption_.limit_tics = static_cast<uint32_t>(game.spec.limit_tics());
  caption_.score = summary.score;
  caption_.ceiling = summary.ceiling;
  const Step& step = environment.last_step();
  caption_.ending = step.terminated ? "over" : step.truncated ? "over: time limit" : "";
}

const cv::Mat& VideoRecorder::draw(const DoomEnvironment& environment) {
  std::vector<doom::ViewRequest> requests;
  for (std::size_t agent = 0; agent < views_.size(); ++agent)
    requests.push_back({&environment.world(), static_cast<int>(agent), views_[agent].data()});
  renderer_->draw(requests);
  return frame_.draw(views_, caption_);
}

Status VideoRecorder::write_picture(const cv::Mat& picture, uint32_t decision) {
  const std::size_t plane = picture.total();
  planes_.resize(3 * plane);
  for (std::size_t i = 0; i < plane; ++i)
    for (std::size_t channel = 0; channel < 3; ++channel)
      planes_[channel * plane + i] = picture.data[3 * i + 2 - channel];
  char name[64];
  std::snprintf(name, sizeof name, "/episode_%03llu_decision_%05u.png",
                static_cast<unsigned long long>(caption_.episode), decision);
  return doom::write_png(options_.frames + name, planes_, picture.cols, picture.rows);
}

Status VideoRecorder::finish() {
  const Status closed = file_ != nullptr ? file_->finish() : Status();
  file_.reset();
  COMRAD_TRY(std::exchange(status_, {}));
  COMRAD_TRY(closed);
  if (options_.finished_video.empty()) return {};
  std::error_code failed;
  fs::rename(options_.video, options_.finished_video, failed);
  return failed ? file_error(options_.finished_video, failed.value()) : Status();
}

}  // namespace comrad::sim
