#include "sim_workers/watch/live_view.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <utility>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/schema/trajectory.h"
#include "rollout_buffer/schema/version.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "rollout_buffer/shm/step_slots.h"

namespace comrad::sim {
namespace {

using nlohmann::json;

constexpr int kQuality = 80;        // of a JPEG, of 100
constexpr int kCommandWaitMs = 20;  // while nothing is to be played
constexpr double kOverTics = 50;    // that an episode's end stays to be seen
constexpr double kSpeedMin = 0.05, kSpeedMax = 64;
constexpr std::size_t kThingsShown = 300;
constexpr int kWidthMin = 128, kHeightMin = 72, kWidthMax = 1920, kHeightMax = 1080;

int32_t whole(doom::Fixed units) { return static_cast<int32_t>(std::lround(doom::to_double(units))); }

std::string hex(uint64_t number) {
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(number));
  return text;
}

/// [x, y, x, y, 1 for a wall] of each line.
json lines_of(const doom::Level& level) {
  json lines = json::array();
  for (const doom::Linedef& line : level.linedefs) {
    const doom::Vertex &start = level.vertices[line.start], &end = level.vertices[line.end];
    const bool blocks = !line.back || (line.flags & (doom::kLineBlocking | doom::kLineBlockEverything)) != 0;
    lines.push_back({whole(start.x), whole(start.y), whole(end.x), whole(end.y), blocks ? 1 : 0});
  }
  return lines;
}

/// Degrees counter-clockwise from east.
int degrees_of(doom::Angle angle) {
  return static_cast<int>(std::lround(static_cast<double>(angle) * 360.0 / 4294967296.0));
}

std::string jpeg_of(const std::vector<uint8_t>& view, ViewSize size) {
  const std::size_t plane = static_cast<std::size_t>(size.width) * size.height;
  cv::Mat planes[3];
  for (int channel = 0; channel < 3; ++channel)  // OpenCV's order is blue, green, red
    planes[channel] =
        cv::Mat(size.height, size.width, CV_8U, const_cast<uint8_t*>(view.data() + (2 - channel) * plane));
  cv::Mat picture;
  cv::merge(planes, 3, picture);
  std::vector<uint8_t> bytes;
  cv::imencode(".jpg", picture, bytes, {cv::IMWRITE_JPEG_QUALITY, kQuality});
  return {bytes.begin(), bytes.end()};
}

}  // namespace

LiveView::LiveView(const LiveViewOptions& options, const EnvironmentOptions& environments,
                   const DoomGame& first, PageLink link, std::function<bool()> is_stopping)
    : options_(options),
      environments_(environments),
      link_(std::move(link)),
      is_stopping_(std::move(is_stopping)),
      wanted_look_{options.size, environments.renderer} {
  for (const int agent : options.people) {
    Person& person = people_[agent];
    person.held.resize(first.spec.heads.size());
    person.tapped = person.held;
  }
}

Expected<std::unique_ptr<LiveView>> LiveView::create(const LiveViewOptions& options,
                                                     const EnvironmentOptions& environments,
                                                     const DoomGame& first, PageLink link,
                                                     std::function<bool()> is_stopping) {
  for (const int agent : options.people)
    if (agent < 0 || agent >= first.num_agents)
      return Error{ErrorCode::kBadInput, "a person cannot play agent " + std::to_string(agent) + " of " +
                                             std::to_string(first.num_agents)};
  std::unique_ptr<LiveView> view(
      new LiveView(options, environments, first, std::move(link), std::move(is_stopping)));
  COMRAD_TRY(view->make_renderer_of(first, view->wanted_look_));
  return view;
}

Status LiveView::make_renderer_of(const DoomGame& game, const Look& look) {
  COMRAD_TRY_ASSIGN(renderer_, make_renderer(game, environments_.wads(), look.size, look.renderer));
  views_.assign(static_cast<std::size_t>(game.num_agents),
                std::vector<uint8_t>(std::size_t{3} * look.size.width * look.size.height));
  look_ = look;
  return {};
}

void LiveView::obey(const json& command) {
  const auto word = [&](const char* name) {
    return command.contains(name) && command[name].is_string() ? command[name].get<std::string>()
                                                               : std::string();
  };
  const auto number = [&](const char* name, double otherwise) {
    return command.contains(name) && command[name].is_number() ? command[name].get<double>() : otherwise;
  };
  const std::string order = word("do");
  if (order != "press") drawn_ = {};  // what changed shows at once, also while nothing is played
  if (order == "shown") {
    pages_ = static_cast<int>(std::clamp(number("pages", 0), 0.0, 1000.0));
  } else if (order == "pause") {
    pace_ = Pace::kPause;
  } else if (order == "run") {
    pace_ = Pace::kRun;
  } else if (order == "step") {
    pace_ = Pace::kStep;
    may_begin_ = true;  // of an episode that waits, the first decision
  } else if (order == "begin") {
    may_begin_ = true;
  } else if (order == "speed") {
    const double times = number("times", 1);
    speed_ = times > 0 ? std::clamp(times, kSpeedMin, kSpeedMax) : 0;
  } else if (order == "size") {
    const double width = number("width", 0), height = number("height", 0);
    if (width >= kWidthMin && width <= kWidthMax && height >= kHeightMin && height <= kHeightMax) {
      wanted_look_.size = {static_cast<int>(width), static_cast<int>(height)};
      is_look_new_ = true;
    }
  } else if (order == "renderer") {
    const auto& words = Words<RendererKind>::words;
    const auto found = std::ranges::find(words, word("name"));
    if (found != words.end()) {
      wanted_look_.renderer = static_cast<RendererKind>(found - words.begin());
      is_look_new_ = true;
    }
  } else if (order == "press") {
    const auto person = people_.find(static_cast<int>(number("agent", -1)));
    if (person == people_.end() || !command.contains("choice") || !command["choice"].is_array()) return;
    const json& choice = command["choice"];
    std::vector<int32_t>& held = person->second.held;
    if (choice.size() != held.size()) return;
    for (std::size_t head = 0; head < held.size(); ++head) {
      held[head] =
          choice[head].is_number_integer() ? std::clamp<int32_t>(choice[head].get<int32_t>(), 0, 255) : 0;
      if (held[head] != 0) person->second.tapped[head] = held[head];
    }
  }
}

void LiveView::read_commands(int wait_ms) {
  for (const json& command : link_.commands(wait_ms)) obey(command);
}

/// While `waits` is true, and while no page is open. Between decisions alone: a page that shows "paused" moves no more.
void LiveView::wait_while(const DoomEnvironment& environment, const std::function<bool()>& waits) {
  read_commands(0);
  is_waiting_ = true;
  if (waits()) drawn_ = {};
  while (!is_left() && (pages_ == 0 || waits())) {
    if (pages_ > 0 && (drawn_ == Clock::time_point() || is_look_new_)) show(environment);
    read_commands(kCommandWaitMs);
    due_ = {};
  }
  is_waiting_ = false;
}

/// Sleeps until so many tics have passed since the last call, hearing commands.
void LiveView::pass_time(const DoomEnvironment& environment, double tics) {
  read_commands(0);
  if (speed_ <= 0) return;
  const Clock::time_point now = Clock::now();
  const auto length = std::chrono::duration_cast<Clock::duration>(
      std::chrono::duration<double>(tics / (kTicRateHz * speed_)));
  due_ += length;
  if (due_ < now - std::chrono::milliseconds(100) || due_ > now + 2 * length) due_ = now + length;
  while (!is_left() && speed_ > 0 && pace_ != Pace::kPause) {
    const auto left = std::chrono::duration_cast<std::chrono::microseconds>(due_ - Clock::now()).count();
    if (left <= 0) return;
    if (left < 1000) {
      timespec rest{.tv_sec = 0, .tv_nsec = left * 1000};
      nanosleep(&rest, nullptr);
      return;
    }
    read_commands(static_cast<int>(std::min<long>(left / 1000, kCommandWaitMs)));
    if (is_look_new_) show(environment);
  }
}

void LiveView::began(const DoomEnvironment& environment) {
  tics_ = 0;
  term_sums_.assign(environment.reward_parts().size(), 0.0);
  value_.clear();
  logits_.clear();
  link_.send(began_words(environment));
  drawn_ = {};
  if (!people_.empty()) may_begin_ = false;
  wait_while(environment, [this] { return pace_ == Pace::kPause || (!people_.empty() && !may_begin_); });
  show(environment);
  pass_time(environment, 1);
  ++episodes_;
}

void LiveView::ticked(const DoomEnvironment& environment) {
  const bool is_end = environment.last_step().episode_over();
  const bool ends_decision = ++tics_ >= environment.game().frame_skip || is_end;
  if (ends_decision) {
    tics_ = 0;
    const std::span<const double> parts = environment.reward_parts();
    for (std::size_t i = 0; i < parts.size(); ++i) term_sums_[i] += parts[i];
    if (pace_ == Pace::kStep) pace_ = Pace::kPause;
  }
  if (is_left()) return;
  // A person's episode has ended: began() waits. A decision is played to its end before it pauses.
  const bool may_rest = ends_decision && !(is_end && !people_.empty());
  const auto is_resting = [this] { return pace_ == Pace::kPause; };
  const auto apart = std::chrono::duration<double>(0.98 / options_.pictures_per_s);
  if (!(may_rest && is_resting()) && (is_end || Clock::now() - drawn_ >= apart)) show(environment);
  pass_time(environment, is_end && speed_ > 0 && people_.empty() ? kOverTics : 1);
  if (may_rest) wait_while(environment, is_resting);
}

/// Shows nothing to a page that is behind, except an episode's end; the next call tries again.
void LiveView::show(const DoomEnvironment& environment) {
  if (std::exchange(is_look_new_, false)) {
    const Status made = make_renderer_of(environment.game(), wanted_look_);
    refused_ = made ? "" : made.error().message;
    wanted_look_ = look_;
  }
  if (!link_.takes_pictures() && !environment.last_step().episode_over()) return;
  drawn_ = Clock::now();
  std::vector<doom::ViewRequest> requests;
  for (std::size_t agent = 0; agent < views_.size(); ++agent)
    requests.push_back({&environment.world(), static_cast<int>(agent), views_[agent].data()});
  renderer_->draw(requests);
  link_.send(now_words(environment));
  for (std::size_t agent = 0; agent < views_.size(); ++agent)
    link_.send_picture(static_cast<int>(agent), jpeg_of(views_[agent], look_.size));
}

json LiveView::began_words(const DoomEnvironment& environment) {
  const DoomGame& game = environment.game();
  json heads = json::array(), terms = json::array();
  for (const scenarios::ActionHead& head : game.spec.heads) heads.push_back(head.buttons);
  for (const scenarios::RewardTerm& term : game.spec.rewards)
    terms.push_back(
        {{"name", term.name}, {"variable", term.variable}, {"kind", term.kind}, {"scope", term.scope}});
  std::string score = game.spec.score;  // a script's variable by the name that the scenario gives it
  for (const scenarios::ScenarioExport& one : game.spec.exports)
    if (score == "USER" + std::to_string(one.user)) score = one.name;
  return {{"type", "began"},
          {"scenario", game.spec.name},
          {"title", game.spec.title},
          {"summary", game.spec.summary},
          {"score", score},
          {"score_unit", game.spec.score_unit},
          {"ceiling", game.ceiling},
          {"limit_tics", game.spec.limit_tics()},
          {"frame_skip", game.frame_skip},
          {"heads", heads},
          {"terms", terms},
          {"agents", game.num_agents},
          {"people", options_.people},
          {"episode", episodes_},
          {"seed", std::to_string(environment.world().options().seed)},
          {"layout", hex(game.layout_id)},
          {"layout_seed", std::to_string(game.layout.seed)},
          {"lines", lines_of(*game.level)}};
}

json LiveView::now_words(const DoomEnvironment& environment) const {
  const DoomGame& game = environment.game();
  const doom::World& world = environment.world();
  const EpisodeRecord summary = environment.summary_so_far();
  const std::size_t count = static_cast<std::size_t>(game.num_agents), logits = logits_.size() / count;
  json agents = json::array();
  for (std::size_t agent = 0; agent < count; ++agent) {
    std::vector<int32_t> choice(game.spec.heads.size());
    game.actions.choose(environment.pressed()[agent], choice);
    const int number = static_cast<int>(agent);
    json one = {{"alive", world.player(number).alive},
                {"choice", choice},
                {"return", summary.agent_return[agent]},
                {"score", summary.agent_score[agent]}};
    json terms = json::array();
    for (std::size_t term = 0; term < game.spec.rewards.size(); ++term)
      terms.push_back(term_sums_[term * count + agent]);
    one["terms"] = terms;
    const doom::Actor& body = world.body(number);
    one["at"] = {whole(body.x), whole(body.y), degrees_of(body.angle)};
    if (!value_.empty()) one["value"] = value_[agent];
    if (logits > 0)
      one["logits"] = std::vector<float>(logits_.begin() + static_cast<std::ptrdiff_t>(agent * logits),
                                         logits_.begin() + static_cast<std::ptrdiff_t>((agent + 1) * logits));
    agents.push_back(std::move(one));
  }
  json things = json::array();  // [x, y, 1 for a monster]
  for (const doom::Actor& actor : world.actors()) {
    if (things.size() >= kThingsShown) break;
    const bool is_monster = actor.flags.has(doom::ActorFlag::kIsMonster);
    if ((is_monster && actor.health > 0) || actor.flags.has(doom::ActorFlag::kSpecial))
      things.push_back({whole(actor.x), whole(actor.y), is_monster ? 1 : 0});
  }
  const Step& step = environment.last_step();
  const char* const pace = !is_waiting_                      ? "running"
                           : pace_ == Pace::kPause           ? "paused"
                           : !people_.empty() && !may_begin_ ? "waiting"
                                                             : "running";
  return {{"type", "now"},
          {"tic", summary.length_tics},
          {"decision", summary.length_steps},
          {"J", summary.score},
          {"over", step.terminated  ? "terminated"
                   : step.truncated ? "truncated"
                                    : ""},
          {"pace", pace},
          {"speed", speed_},
          {"renderer", word_of(look_.renderer)},
          {"refused", refused_},
          {"agents", agents},
          {"things", things}};
}

void LiveView::rest_if_closed() const {
  while (link_.is_closed() && !is_stopping_()) {
    const timespec rest{.tv_sec = 0, .tv_nsec = 20'000'000};
    nanosleep(&rest, nullptr);
  }
}

void LiveView::press(std::span<int32_t> action) {
  for (auto& [agent, person] : people_) {
    const std::size_t heads = person.held.size(), first = static_cast<std::size_t>(agent) * heads;
    for (std::size_t head = 0; head < heads; ++head) {
      action[first + head] = person.tapped[head] != 0 ? person.tapped[head] : person.held[head];
      person.tapped[head] = 0;
    }
  }
}

void LiveView::thought(std::vector<float> value, std::vector<float> logits) {
  value_ = std::move(value);
  logits_ = std::move(logits);
}

namespace {

/// One environment that people play in, and whose policies are listened to.
class Shown final : public Environment {
 public:
  Shown(Environment& inner, const shm::Arena& arena, LiveView& view)
      : inner_(inner), arena_(arena), view_(view) {}

  const EnvShape& shape() const override { return inner_.shape(); }
  uint64_t layout_id() const override { return inner_.layout_id(); }
  Status choose_layout(int layout_index) override { return inner_.choose_layout(layout_index); }
  void set_env_frames(uint64_t env_frames) override { inner_.set_env_frames(env_frames); }
  void reset(uint64_t episode_seed) override { inner_.reset(episode_seed); }
  void step(std::span<const int32_t> action) override {
    view_.rest_if_closed();
    listen();
    action_.assign(action.begin(), action.end());
    view_.press(action_);
    inner_.step(action_);
  }
  const Step& last_step() const override { return inner_.last_step(); }
  const EpisodeRecord& summary() const override { return inner_.summary(); }
  uint64_t state_hash() const override { return inner_.state_hash(); }

 private:
  /// Reads the row that was answered.
  void listen() {
    const shm::StepSlot& slot = arena_.step_slots().slot(0);
    const SlabView slab = arena_.slabs().view(static_cast<int>(slot.slab_index));
    const int row = static_cast<int>(slot.step);
    std::vector<float> value, logits;
    for (int agent = 0; agent < shape().num_agents; ++agent) {
      value.push_back(slab.value(row, agent));
      const std::span<float> of_agent = slab.logits(row, agent);
      logits.insert(logits.end(), of_agent.begin(), of_agent.end());
    }
    view_.thought(std::move(value), std::move(logits));
  }

  Environment& inner_;
  const shm::Arena& arena_;
  LiveView& view_;
  std::vector<int32_t> action_;
};

class ShownSet final : public EnvironmentSet {
 public:
  ShownSet(std::unique_ptr<EnvironmentSet> inner, const shm::Arena& arena, LiveView& view)
      : inner_(std::move(inner)), shown_(inner_->at(0), arena, view) {}
  int size() const override { return 1; }
  Environment& at(int) override { return shown_; }
  void observe(std::span<const int> indices, std::span<const ObservationTarget> targets) override {
    inner_->observe(indices, targets);
  }

 private:
  const std::unique_ptr<EnvironmentSet> inner_;
  Shown shown_;
};

}  // namespace

std::unique_ptr<EnvironmentSet> shown_environments(std::unique_ptr<EnvironmentSet> inner,
                                                   const shm::Arena& arena, LiveView& view) {
  return std::make_unique<ShownSet>(std::move(inner), arena, view);
}

}  // namespace comrad::sim
