#include "sim_workers/env/doom_env.h"

#include <algorithm>

#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/env/game_variables.h"
#include "sim_workers/env/play_options.h"

namespace comrad::sim {

DoomEnvironment::DoomEnvironment(std::shared_ptr<const DoomGame> game)
    : game_(std::move(game)),
      shape_(game_->spec.shape(game_->num_agents, game_->use_measurements)),
      world_(game_->level, game_->catalog, game_->behavior),
      global_state_(game_->spec, game_->num_agents),
      rewards_(game_->spec.rewards, game_->num_agents),
      buttons_(game_->num_agents),
      limit_tics_(static_cast<uint64_t>(game_->spec.limit_tics())) {
  if (game_->use_global_state) shape_.global_state_count = global_state_.count();
  const auto variable_of = [](const std::string& name) {
    const auto variable = scenarios::find_term_variable(name);
    COMRAD_CHECK(variable.has_value(), "the loader refuses unknown variables");
    return *variable;
  };
  const auto gate = [&](const std::string& name) {
    return name.empty() ? std::nullopt : std::optional(variable_of(name));
  };
  for (const scenarios::RewardTerm& term : game_->spec.rewards) {
    const scenarios::GameVariable variable = variable_of(term.variable);
    reward_readings_.push_back(
        {variable, term.agent_stride,
         term.scope == "team" && (!variable.is_team_variable() || term.agent_stride != 0), gate(term.when),
         gate(term.unless)});
    has_gates_ |= !term.when.empty() || !term.unless.empty();
  }
  for (const scenarios::MeasurementTerm& term : game_->spec.measurements)
    measurement_variables_.push_back(variable_of(term.variable));
  reward_value_.resize(reward_readings_.size() * game_->num_agents);
  if (has_gates_) reward_pays_.resize(reward_value_.size());
  make_action_mask();
  exact_reward_.resize(game_->num_agents);
  step_.reward.resize(game_->num_agents);
  summary_.agent_count = static_cast<uint32_t>(game_->num_agents);
}

Status DoomEnvironment::choose_layout(int layout_index) {
  if (library_ == nullptr) return Environment::choose_layout(layout_index);
  COMRAD_TRY_ASSIGN(std::shared_ptr<const DoomGame> game, library_->game(layout_index));
  if (game == game_) return {};
  game_ = std::move(game);
  world_ = doom::World(game_->level, game_->catalog, game_->behavior);
  return {};
}

void DoomEnvironment::reset(uint64_t episode_seed) {
  doom::WorldOptions options = world_options(game_->spec.rules);
  options.player_count = game_->num_agents;
  options.seed = episode_seed;
  options.crosshair = game_->spec.crosshair;
  options.no_monsters |= game_->no_monsters;
  options.forced_respawn = game_->spec.respawn;
  options.respawn_delay_tics = game_->spec.respawn_delay_tics;
  options.exit_takes_a_tic = game_->spec.is_vizdoom;
  reset_world(world_, options);
  for (const auto& [user, value] : game_->globals) world_.set_export(user, value);
  run_start_tics(world_, game_->spec.rules);
  step_count_ = 0;
  std::fill(step_.reward.begin(), step_.reward.end(), 0.0f);
  step_.terminated = step_.truncated = false;
  read_reward_variables();
  rewards_.reset(reward_value_);
  summary_.agent_return.fill(0.0f);
  std::fill(buttons_.begin(), buttons_.end(), doom::Buttons{});
  for (TicWatcher* watcher : watchers_) watcher->began(*this);
}

void DoomEnvironment::step(std::span<const int32_t> action) {
  const std::size_t head_count = static_cast<std::size_t>(shape_.head_count);
  COMRAD_CHECK(action.size() == head_count * buttons_.size(), "an action has one choice per agent and head");
  for (std::size_t agent = 0; agent < buttons_.size(); ++agent)
    buttons_[agent] = game_->actions.buttons(action.subspan(agent * head_count, head_count));
  press(buttons_);
}

void DoomEnvironment::press(std::span<const doom::Buttons> buttons) {
  COMRAD_CHECK(!step_.episode_over(), "an episode that is over is reset before the next step");
  const bool ends_with_its_player =
      game_->spec.rules.lone_death_ends && game_->num_agents == 1 && !game_->spec.rules.network_game;
  for (int i = 0; i < game_->frame_skip && !step_.episode_over(); ++i) {
    run_tic(world_, buttons);
    if (world_.level_exited() || (ends_with_its_player && !world_.player(0).alive))
      step_.terminated = true;
    else if (world_.tic_count() >= limit_tics_)
      step_.truncated = true;
    if (i + 1 < game_->frame_skip && !step_.episode_over())
      for (TicWatcher* watcher : watchers_) watcher->ticked(*this);
  }
  ++step_count_;
  read_reward_variables();
  rewards_.step(reward_value_, exact_reward_, reward_pays_);
  for (std::size_t agent = 0; agent < buttons_.size(); ++agent)
    summary_.agent_return[agent] += step_.reward[agent] = static_cast<float>(exact_reward_[agent]);
  if (step_.episode_over()) fill(summary_);
  for (TicWatcher* watcher : watchers_) watcher->ticked(*this);
}

double DoomEnvironment::read(int agent, scenarios::GameVariable variable, int agent_stride) const {
  if (variable.kind == scenarios::VariableKind::kTerminated) return step_.terminated;
  if (variable.kind == scenarios::VariableKind::kTruncated) return step_.truncated;
  if (variable.kind == scenarios::VariableKind::kFirst) return step_count_ == 1;
  variable.index += agent * agent_stride;
  return read_variable(world_, agent, variable);
}

void DoomEnvironment::read_reward_variables() {
  const int num_agents = game_->num_agents;
  for (std::size_t i = 0; i < reward_readings_.size(); ++i) {
    const Reading& reading = reward_readings_[i];
    double* const row = reward_value_.data() + i * num_agents;
    double sum = 0.0;
    for (int agent = 0; agent < num_agents; ++agent)
      sum += row[agent] = read(agent, reading.variable, reading.agent_stride);
    if (reading.is_team_sum) std::fill(row, row + num_agents, sum);
    if (!has_gates_) continue;
    for (int agent = 0; agent < num_agents; ++agent)
      reward_pays_[i * num_agents + agent] = (!reading.when || read(agent, *reading.when) != 0.0) &&
                                             (!reading.unless || read(agent, *reading.unless) == 0.0);
  }
}

/// What each agent may choose: everything but what the scenario's masks take away.
void DoomEnvironment::make_action_mask() {
  const auto logit_count = static_cast<std::size_t>(shape_.logit_count());
  action_mask_.assign(logit_count * game_->num_agents, 1);
  for (const scenarios::MaskTerm& term : game_->spec.masks) {
    if (term.agent >= game_->num_agents) continue;
    std::size_t first = logit_count * term.agent;
    for (int head = 0; head < term.head; ++head) first += shape_.head_sizes[head];
    const std::vector<std::string>& buttons = game_->spec.heads[term.head].buttons;
    for (int choice = 0; choice < shape_.head_sizes[term.head]; ++choice) {
      const std::string name = choice == 0 ? "none" : buttons[choice - 1];
      action_mask_[first + choice] = std::count(term.allowed.begin(), term.allowed.end(), name) > 0;
    }
  }
}

EpisodeRecord DoomEnvironment::summary_so_far() const {
  EpisodeRecord summary = summary_;
  fill(summary);
  return summary;
}

/// All but the returns, which are counted as rewards come.
void DoomEnvironment::fill(EpisodeRecord& summary) const {
  summary.length_steps = step_count_;
  summary.length_tics = static_cast<uint32_t>(world_.tic_count());
  const std::string& score = game_->spec.score;
  const auto variable = scenarios::find_variable(score);
  float sum = 0.0f;
  for (int agent = 0; agent < game_->num_agents; ++agent) {
    float& own = summary.agent_score[agent];
    if (variable) {
      const scenarios::ScenarioSpec& spec = game_->spec;
      double value = read(agent, *variable, spec.score_agent_stride) * spec.score_scale;
      if (const auto divisor = scenarios::find_variable(spec.score_divisor)) {
        const double by = read(agent, *divisor);
        if (by != 0.0) value /= by;
      }
      own = static_cast<float>(value);
    } else if (score == "return")
      own = summary.agent_return[agent];
    else
      own = static_cast<float>(summary.length_tics);  // survival_tics
    sum += own;
  }
  summary.score = sum / static_cast<float>(game_->num_agents);
  summary.ceiling = static_cast<float>(game_->ceiling);
}

void DoomEnvironment::observe_numbers(const ObservationTarget& target) const {
  const int num_agents = game_->num_agents;
  if (target.measurement != nullptr)
    for (int agent = 0; agent < num_agents; ++agent)
      for (int32_t i = 0; i < shape_.measurement_count; ++i) {
        const scenarios::MeasurementTerm& term = game_->spec.measurements[i];
        double value = read(agent, measurement_variables_[i], term.agent_stride) * term.scale + term.offset;
        if (term.clip > 0.0) value = std::clamp(value, -term.clip, term.clip);
        if (term.low) value = std::max(value, *term.low);
        if (term.high) value = std::min(value, *term.high);
        target.measurement[agent * shape_.measurement_count + i] = static_cast<float>(value);
      }
  if (target.action_mask != nullptr) std::copy(action_mask_.begin(), action_mask_.end(), target.action_mask);
  if (target.agent_active != nullptr)
    for (int agent = 0; agent < num_agents; ++agent)
      target.agent_active[agent] =
          game_->spec.respawn || game_->spec.rules.network_game || world_.player(agent).alive;
  if (target.global_state != nullptr) global_state_.write(world_, target.global_state);
}

uint64_t DoomEnvironment::state_hash() const {
  uint64_t hash = world_.hash();
  const auto mix = [&](uint64_t value) { hash = mix64(hash ^ value) + kGoldenGamma; };
  mix(step_count_);
  mix(step_.terminated * 2u + step_.truncated);
  return hash;
}

DoomEnvironmentSet::DoomEnvironmentSet(std::shared_ptr<const DoomGame> game,
                                       std::unique_ptr<doom::Renderer> renderer, int count,
                                       ViewSize render_size, Resize filter,
                                       std::shared_ptr<LayoutLibrary> library)
    : renderer_(std::move(renderer)),
      library_(std::move(library)),
      render_size_(render_size),
      filter_(filter) {
  COMRAD_CHECK(filter != Resize::kNone || render_size == kObservationSize,
               "a view of another size is brought to 128x72 by a filter");
  if (library_ != nullptr) library_->draw_with(renderer_.get());
  for (int i = 0; i < count; ++i) {
    environments_.push_back(std::make_unique<DoomEnvironment>(game));
    environments_.back()->choose_from(library_);
  }
  const std::size_t view_count = static_cast<std::size_t>(count) * game->num_agents;
  views_.reserve(view_count);
  if (filter_ != Resize::kNone)
    drawn_.resize(view_count * 3 * static_cast<std::size_t>(render_size_.width) * render_size_.height);
}

DoomEnvironmentSet::~DoomEnvironmentSet() {
  if (library_ != nullptr) library_->draw_with(nullptr);
}

void DoomEnvironmentSet::observe(std::span<const int> indices, std::span<const ObservationTarget> targets) {
  COMRAD_CHECK(indices.size() == targets.size() && indices.size() <= environments_.size(),
               "one target for each environment, each at most once");
  const std::size_t drawn_bytes = 3 * static_cast<std::size_t>(render_size_.width) * render_size_.height;
  views_.clear();
  for (std::size_t i = 0; i < indices.size(); ++i) {
    const DoomEnvironment& environment = *environments_[indices[i]];
    environment.observe_numbers(targets[i]);
    const int64_t frame_bytes = environment.shape().frame_bytes();
    for (int agent = 0; agent < environment.shape().num_agents; ++agent)
      views_.push_back({&environment.world(), agent,
                        filter_ == Resize::kNone ? targets[i].frame + agent * frame_bytes
                                                 : drawn_.data() + views_.size() * drawn_bytes});
  }
  renderer_->draw(views_);
  if (filter_ == Resize::kNone) return;
  std::size_t view = 0;
  for (std::size_t i = 0; i < indices.size(); ++i) {
    const EnvShape& shape = environments_[indices[i]]->shape();
    for (int agent = 0; agent < shape.num_agents; ++agent, ++view)
      resize_planes(drawn_.data() + view * drawn_bytes, render_size_, filter_,
                    targets[i].frame + agent * shape.frame_bytes());
  }
}

}  // namespace comrad::sim
