#include "sim_workers/oracle/oracle.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <utility>

#include "rollout_buffer/core/text.h"
#include "sim_workers/oracle/oracle_table.h"

namespace comrad::sim {

Expected<std::unique_ptr<Oracle>> make_oracle(const DoomGame& game) {
  for (const OracleEntry& entry : oracle_table())
    if (game.spec.maps_of == entry.scenario) return entry.make(game);
  return Error{ErrorCode::kNotFound, "scenario " + game.spec.name + " has no oracle (scenarios/" +
                                         game.spec.name +
                                         "/oracle.cc); those that have one: " + joined(list_oracles())};
}

std::vector<std::string> list_oracles() {
  std::vector<std::string> names;
  for (const OracleEntry& entry : oracle_table()) names.emplace_back(entry.scenario);
  std::sort(names.begin(), names.end());
  return names;
}

OraclePlayer::OraclePlayer(std::unique_ptr<Oracle> oracle, const DoomGame& game)
    : oracle_(std::move(oracle)),
      buttons_(static_cast<std::size_t>(game.num_agents)),
      choice_(buttons_.size() * static_cast<std::size_t>(game.actions.head_count())) {}

Expected<OraclePlayer> OraclePlayer::create(const DoomGame& game) {
  COMRAD_TRY_ASSIGN(std::unique_ptr<Oracle> oracle, make_oracle(game));
  return OraclePlayer(std::move(oracle), game);
}

void OraclePlayer::reset(DoomEnvironment& environment, uint64_t episode_seed) {
  environment.reset(episode_seed);
  oracle_->reset(environment.world());
}

void OraclePlayer::step(DoomEnvironment& environment) {
  press(environment);
  for (std::size_t agent = 0; agent < buttons_.size(); ++agent) choose(environment, agent);
  environment.step(choice_);
}

void OraclePlayer::step(DoomEnvironment& environment, std::span<const int> seats,
                        std::span<const int32_t> action) {
  press(environment);
  std::copy(action.begin(), action.end(), choice_.begin());
  for (const int seat : seats) choose(environment, static_cast<std::size_t>(seat));
  environment.step(choice_);
}

void OraclePlayer::press(const DoomEnvironment& environment) {
  std::fill(buttons_.begin(), buttons_.end(), doom::Buttons{});
  oracle_->press(environment.world(), buttons_);
}

void OraclePlayer::choose(const DoomEnvironment& environment, std::size_t agent) {
  const std::size_t heads = choice_.size() / buttons_.size();
  environment.game().actions.choose(buttons_[agent], std::span(choice_).subspan(agent * heads, heads));
}

/// One Doom environment and the oracle that plays it.
class OracleEnvironmentSet::Guided final : public Environment {
 public:
  Guided(DoomEnvironment& inner, OraclePlayer player, const std::vector<int>& seats)
      : inner_(inner), player_(std::move(player)), seats_(seats) {}

  const EnvShape& shape() const override { return inner_.shape(); }
  uint64_t layout_id() const override { return inner_.layout_id(); }
  Status choose_layout(int layout_index) override {
    const DoomGame* before = &inner_.game();
    COMRAD_TRY(inner_.choose_layout(layout_index));
    if (&inner_.game() == before) return {};
    COMRAD_TRY_ASSIGN(player_, OraclePlayer::create(inner_.game()));
    return {};
  }
  void set_env_frames(uint64_t env_frames) override { inner_.set_env_frames(env_frames); }
  void reset(uint64_t episode_seed) override { player_.reset(inner_, episode_seed); }
  void step(std::span<const int32_t> action) override {
    if (seats_.empty())
      player_.step(inner_);
    else
      player_.step(inner_, seats_, action);
  }
  const Step& last_step() const override { return inner_.last_step(); }
  const EpisodeRecord& summary() const override { return inner_.summary(); }
  uint64_t state_hash() const override { return inner_.state_hash(); }

 private:
  DoomEnvironment& inner_;
  OraclePlayer player_;
  const std::vector<int>& seats_;
};

OracleEnvironmentSet::OracleEnvironmentSet(std::unique_ptr<DoomEnvironmentSet> inner, std::vector<int> seats)
    : inner_(std::move(inner)), seats_(std::move(seats)) {}

Expected<std::unique_ptr<EnvironmentSet>> OracleEnvironmentSet::create(
    std::unique_ptr<DoomEnvironmentSet> inner, std::vector<int> seats) {
  std::unique_ptr<OracleEnvironmentSet> set(new OracleEnvironmentSet(std::move(inner), std::move(seats)));
  for (int i = 0; i < set->size(); ++i) {
    DoomEnvironment& environment = set->inner_->at(i);
    for (const int seat : set->seats_)
      if (seat < 0 || seat >= environment.game().num_agents)
        return Error{ErrorCode::kBadInput, fmt::format("the oracle cannot play seat {} of {} agents", seat,
                                                       environment.game().num_agents)};
    COMRAD_TRY_ASSIGN(OraclePlayer player, OraclePlayer::create(environment.game()));
    set->guided_.push_back(std::make_unique<Guided>(environment, std::move(player), set->seats_));
  }
  return std::unique_ptr<EnvironmentSet>(std::move(set));
}

Environment& OracleEnvironmentSet::at(int index) { return *guided_[static_cast<std::size_t>(index)]; }

void OracleEnvironmentSet::observe(std::span<const int> indices, std::span<const ObservationTarget> targets) {
  if (!seats_.empty()) return inner_->observe(indices, targets);
  for (std::size_t i = 0; i < indices.size(); ++i) inner_->at(indices[i]).observe_numbers(targets[i]);
}

Expected<EpisodeRecord> play_oracle_episode(const std::shared_ptr<const DoomGame>& game, uint64_t seed) {
  COMRAD_TRY_ASSIGN(OraclePlayer player, OraclePlayer::create(*game));
  DoomEnvironment environment(game);
  player.reset(environment, seed);
  while (!environment.last_step().episode_over()) player.step(environment);
  return environment.summary();
}

}  // namespace comrad::sim
