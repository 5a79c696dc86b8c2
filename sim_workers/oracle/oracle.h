// A scripted team with access to the world's state: it proves that a scenario can be solved, and that its
// score, rewards and endings mean what they say. It presses what an agent's action heads can press. Each
// lies in its scenario's folder, scenarios/<name>/oracle.cc. Stage: step.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/engine/world/world.h"
#include "sim_workers/env/doom_env.h"
#include "sim_workers/env/environment.h"

namespace comrad::sim {

class Oracle {
 public:
  virtual ~Oracle() = default;
  /// An episode begins; `world` is as the first observation shows it.
  virtual void reset(const doom::World& world) = 0;
  /// What each agent should press for the next decision: [N], all released on entry.
  virtual void press(const doom::World& world, std::span<doom::Buttons> buttons) = 0;
};

/// Makes the oracle of a scenario. Errors: kNotFound where its folder has no oracle.cc.
Expected<std::unique_ptr<Oracle>> make_oracle(const DoomGame& game);

/// Scenarios that have one, sorted.
std::vector<std::string> list_oracles();

/// An oracle at one environment's controls: its intended buttons become a decision through the action heads.
class OraclePlayer {
 public:
  /// Errors: as make_oracle().
  static Expected<OraclePlayer> create(const DoomGame& game);

  /// Begins an episode of `environment`, which must be one of the game's.
  void reset(DoomEnvironment& environment, uint64_t episode_seed);
  void step(DoomEnvironment& environment);
  /// The oracle decides for the agents `seats` alone; the others do `action` [N, heads].
  void step(DoomEnvironment& environment, std::span<const int> seats, std::span<const int32_t> action);

 private:
  OraclePlayer(std::unique_ptr<Oracle> oracle, const DoomGame& game);
  void press(const DoomEnvironment& environment);
  void choose(const DoomEnvironment& environment, std::size_t agent);
  std::unique_ptr<Oracle> oracle_;
  std::vector<doom::Buttons> buttons_;  // [N]
  std::vector<int32_t> choice_;         // [N, heads]
};

/// Doom environments whose actions come from oracles. Where they come from oracles alone, what is passed to step() is
/// not looked at, and no pictures are drawn (frames stay black).
class OracleEnvironmentSet final : public EnvironmentSet {
 public:
  /// Takes over `inner`, whose environments must be Doom's. `seats` are the agents that the oracles play; empty: all.
  /// Errors: as make_oracle(); kBadInput for a seat that the team has not.
  static Expected<std::unique_ptr<EnvironmentSet>> create(std::unique_ptr<DoomEnvironmentSet> inner,
                                                          std::vector<int> seats = {});

  int size() const override { return inner_->size(); }
  Environment& at(int index) override;
  void observe(std::span<const int> indices, std::span<const ObservationTarget> targets) override;

 private:
  class Guided;
  OracleEnvironmentSet(std::unique_ptr<DoomEnvironmentSet> inner, std::vector<int> seats);
  std::unique_ptr<DoomEnvironmentSet> inner_;
  const std::vector<int> seats_;  // empty: all
  std::vector<std::unique_ptr<Environment>> guided_;
};

/// Plays one episode without pictures and without a pipeline; for tests and tools. Errors: as make_oracle().
Expected<EpisodeRecord> play_oracle_episode(const std::shared_ptr<const DoomGame>& game, uint64_t seed);

}  // namespace comrad::sim
