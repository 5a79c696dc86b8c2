#include "sim_workers/oracle/oracle.h"

#include <algorithm>
#include <utility>

#include "sim_workers/oracle/oracle_table.h"

namespace comrad::sim {

Expected<std::unique_ptr<Oracle>> make_oracle(const DoomGame& game) {
  for (const OracleEntry& entry : oracle_table())
    if (game.spec.name == entry.scenario) return entry.make(game);
  std::string known;
  for (const std::string& name : list_oracles()) known += (known.empty() ? "" : ", ") + name;
  return Error{ErrorCode::kNotFound, "scenario " + game.spec.name + " has no oracle (scenarios/" + game.spec.name +
                                         "/oracle.cc); those that have one: " + known};
}

std::vector<std::string> list_oracles() {
  std::vector<std::string> names;
  for (const OracleEntry& entry : oracle_table()) names.emplace_back(entry.scenario);
  std::sort(names.begin(), names.end());
  return names;
}

/// One Doom environment and the oracle that plays it.
class OracleEnvironmentSet::Guided final : public Environment {
 public:
  Guided(DoomEnvironment& inner, std::unique_ptr<Oracle> oracle)
      : inner_(inner), oracle_(std::move(oracle)), buttons_(static_cast<std::size_t>(inner.shape().num_agents)) {}

  const EnvShape& shape() const override { return inner_.shape(); }
  uint64_t layout_id() const override { return inner_.layout_id(); }
  Status choose_layout(int layout) override {
    const DoomGame* before = &inner_.game();
    COMRAD_TRY(inner_.choose_layout(layout));
    if (&inner_.game() == before) return {};
    COMRAD_TRY_ASSIGN(oracle_, make_oracle(inner_.game()));
    return {};
  }
  void reset(uint64_t episode_seed) override {
    inner_.reset(episode_seed);
    oracle_->reset(inner_.world());
  }
  void step(std::span<const int32_t>) override {
    const auto heads = static_cast<std::size_t>(shape().head_count);
    std::fill(buttons_.begin(), buttons_.end(), doom::Buttons{});
    oracle_->press(inner_.world(), buttons_);
    choice_.resize(heads * buttons_.size());
    for (std::size_t agent = 0; agent < buttons_.size(); ++agent)
      inner_.game().actions.choose(buttons_[agent], std::span(choice_).subspan(agent * heads, heads));
    inner_.step(choice_);
  }
  const Step& last_step() const override { return inner_.last_step(); }
  const EpisodeSummary& summary() const override { return inner_.summary(); }
  uint64_t state_hash() const override { return inner_.state_hash(); }

 private:
  DoomEnvironment& inner_;
  std::unique_ptr<Oracle> oracle_;
  std::vector<doom::Buttons> buttons_;  // [N]
  std::vector<int32_t> choice_;         // [N, heads]
};

OracleEnvironmentSet::OracleEnvironmentSet(std::unique_ptr<DoomEnvironmentSet> inner) : inner_(std::move(inner)) {}

Expected<std::unique_ptr<EnvironmentSet>> OracleEnvironmentSet::create(std::unique_ptr<DoomEnvironmentSet> inner) {
  std::unique_ptr<OracleEnvironmentSet> set(new OracleEnvironmentSet(std::move(inner)));
  for (int i = 0; i < set->size(); ++i) {
    DoomEnvironment& environment = set->inner_->at(i);
    COMRAD_TRY_ASSIGN(std::unique_ptr<Oracle> oracle, make_oracle(environment.game()));
    set->guided_.push_back(std::make_unique<Guided>(environment, std::move(oracle)));
  }
  return std::unique_ptr<EnvironmentSet>(std::move(set));
}

Environment& OracleEnvironmentSet::at(int index) { return *guided_[static_cast<std::size_t>(index)]; }

void OracleEnvironmentSet::observe(std::span<const int> indices, std::span<const ObservationTarget> targets) {
  for (std::size_t i = 0; i < indices.size(); ++i) inner_->at(indices[i]).observe_numbers(targets[i]);
}

Expected<EpisodeSummary> play_oracle_episode(const std::shared_ptr<const DoomGame>& game, uint64_t seed) {
  COMRAD_TRY_ASSIGN(std::unique_ptr<Oracle> oracle, make_oracle(*game));
  DoomEnvironment environment(game);
  const auto heads = static_cast<std::size_t>(environment.shape().head_count);
  std::vector<doom::Buttons> buttons(static_cast<std::size_t>(game->num_agents));
  std::vector<int32_t> choice(heads * buttons.size());
  environment.reset(seed);
  oracle->reset(environment.world());
  while (!environment.last_step().episode_over()) {
    std::fill(buttons.begin(), buttons.end(), doom::Buttons{});
    oracle->press(environment.world(), buttons);
    for (std::size_t agent = 0; agent < buttons.size(); ++agent)
      game->actions.choose(buttons[agent], std::span(choice).subspan(agent * heads, heads));
    environment.step(choice);
  }
  return environment.summary();
}

}  // namespace comrad::sim
