#include "sim_workers/film/film.h"

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <opencv2/videoio.hpp>
#include <utility>

#include "rollout_buffer/core/files.h"
#include "sim_workers/engine/render/png_image.h"

namespace comrad::sim {
namespace {

namespace fs = std::filesystem;

constexpr double kFramesPerSecond = 35;  // tics
constexpr int kHeldFrames = 35;          // an episode's last picture stands for a second

std::vector<std::vector<std::string>> buttons_of(const DoomGame& game) {
  std::vector<std::vector<std::string>> buttons;
  for (const scenarios::ActionHead& head : game.spec.heads) buttons.push_back(head.buttons);
  return buttons;
}

}  // namespace

Film::Film(const FilmOptions& options, FilmFrame frame) : options_(options), frame_(std::move(frame)) {}

Film::~Film() = default;

Expected<std::unique_ptr<Film>> Film::create(const FilmOptions& options,
                                             const EnvironmentOptions& environments, const DoomGame& first) {
  std::unique_ptr<Film> film(new Film(options, FilmFrame(options.size, first.num_agents, buttons_of(first))));
  COMRAD_TRY_ASSIGN(film->renderer_, make_renderer(first, environments.wads(), options.size));
  film->views_.assign(static_cast<std::size_t>(first.num_agents),
                      std::vector<uint8_t>(std::size_t{3} * options.size.width * options.size.height));
  film->caption_.scenario = first.spec.name;
  film->caption_.agents.resize(film->views_.size());
  for (AgentCaption& agent : film->caption_.agents) agent.choice.resize(first.spec.heads.size());
  if (!options.frames.empty()) {
    std::error_code failed;
    fs::create_directories(options.frames, failed);
    if (failed) return file_error(options.frames, failed.value());
  }
  if (!options.video.empty()) COMRAD_TRY(film->open_video());
  return film;
}

Status Film::open_video() {
  video_ = std::make_unique<cv::VideoWriter>(options_.video, cv::CAP_FFMPEG,
                                             cv::VideoWriter::fourcc('a', 'v', 'c', '1'), kFramesPerSecond,
                                             frame_.size(), /*isColor=*/true);
  if (video_->isOpened()) return {};
  return Error{ErrorCode::kUnsupported,
               options_.video + ": OpenCV cannot write H.264 of " + std::to_string(frame_.size().width) +
                   "x" + std::to_string(frame_.size().height) +
                   " there; is the folder writable, and libopencv_videoio Debian's own? A smaller --size or "
                   "--frames may do"};
}

void Film::began(const DoomEnvironment& environment) {
  caption_.episode = episodes_++;
  ticked(environment);
}

void Film::ticked(const DoomEnvironment& environment) {
  if (!status_) return;
  const bool is_over = environment.last_step().episode_over();
  const bool ends_a_decision =
      is_over || environment.world().tic_count() % static_cast<uint64_t>(environment.game().frame_skip) == 0;
  const bool is_pictured = !options_.frames.empty() && ends_a_decision;
  if (video_ == nullptr && !is_pictured) return;
  const cv::Mat& picture = draw(environment);
  for (int i = 0; video_ != nullptr && i < (is_over ? kHeldFrames : 1); ++i, ++video_frames_)
    video_->write(picture);
  if (is_pictured) status_ = write_picture(picture, caption_.decisions);
}

const cv::Mat& Film::draw(const DoomEnvironment& environment) {
  const DoomGame& game = environment.game();
  std::vector<doom::ViewRequest> requests;
  const EpisodeSummary summary = environment.summary_so_far();
  for (int agent = 0; agent < game.num_agents; ++agent) {
    const auto index = static_cast<std::size_t>(agent);
    requests.push_back({&environment.world(), agent, views_[index].data()});
    AgentCaption& caption = caption_.agents[index];
    game.actions.choose(environment.pressed()[index], caption.choice);
    caption.return_so_far = summary.agent_return[index];
    caption.score = summary.agent_score[index];
    caption.is_alive = environment.world().player(agent).alive;
  }
  renderer_->draw(requests);
  caption_.tics = summary.length_tics;
  caption_.decisions = summary.length_steps;
  caption_.limit_tics = static_cast<uint32_t>(game.spec.limit_tics());
  caption_.score = summary.score;
  caption_.ceiling = summary.ceiling;
  const Step& step = environment.last_step();
  caption_.ending = step.terminated ? "over" : step.truncated ? "over: time limit" : "";
  return frame_.draw(views_, caption_);
}

Status Film::write_picture(const cv::Mat& picture, uint32_t decision) {
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

Status Film::finish() {
  if (video_ == nullptr) return std::exchange(status_, {});
  video_->release();
  video_.reset();
  if (!status_) return status_;
  // OpenCV does not say whether all was written.
  cv::VideoCapture written(options_.video, cv::CAP_FFMPEG);
  const double frames = written.isOpened() ? written.get(cv::CAP_PROP_FRAME_COUNT) : 0;
  written.release();
  if (frames < static_cast<double>(video_frames_) - 1)
    return Error{ErrorCode::kNoSpace, options_.video + ": only " + std::to_string(std::lround(frames)) +
                                          " of " + std::to_string(video_frames_) +
                                          " frames can be read back; is the disk full?"};
  return {};
}

}  // namespace comrad::sim
