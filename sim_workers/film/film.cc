#include "sim_workers/film/film.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <utility>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/schema/version.h"
#include "sim_workers/engine/render/png_image.h"

namespace comrad::sim {
namespace {

namespace fs = std::filesystem;

constexpr int kHeldTics = 35;  // an episode's last picture stands for a second

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
  if (lower_case(options_.video).ends_with(".gif")) {
    COMRAD_TRY_ASSIGN(gif_, GifFile::create(options_.video, frame_.size()));
    return {};
  }
  COMRAD_TRY_ASSIGN(video_, VideoFile::create(options_.video, frame_.size()));
  return {};
}

void Film::began(const DoomEnvironment& environment) {
  caption_.episode = episodes_++;
  ticked(environment);
}

void Film::ticked(const DoomEnvironment& environment) {
  if (!status_ || is_complete()) return;
  const bool is_over = environment.last_step().episode_over();
  const int frame_skip = environment.game().frame_skip;
  const bool ends_a_decision =
      is_over || environment.world().tic_count() % static_cast<uint64_t>(frame_skip) == 0;
  const int shown_tics = is_over ? kHeldTics : 1;
  if (video_ == nullptr && !ends_a_decision) {
    ++tics_;
    return;
  }
  const cv::Mat& picture = draw(environment);
  for (int i = 0; i < shown_tics && !is_complete(); ++i, ++tics_)
    if (video_ != nullptr && status_) status_ = video_->add(picture);
  if (gif_ != nullptr && status_ && ends_a_decision)
    status_ = gif_->add(picture, is_over ? kHeldTics : frame_skip);
  if (status_ && !options_.frames.empty() && ends_a_decision)
    status_ = write_picture(picture, caption_.decisions);
}

bool Film::is_complete() const {
  return options_.seconds > 0 && tics_ >= std::max(1L, std::lround(kTicRateHz * options_.seconds));
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
  Status closed;
  if (gif_ != nullptr) closed = gif_->finish();
  if (video_ != nullptr) closed = video_->finish();
  gif_.reset(), video_.reset();
  COMRAD_TRY(std::exchange(status_, {}));
  return closed;
}

}  // namespace comrad::sim
