// One scenario on one of its layouts, for tests of its rules: presses buttons, moves bodies, reads what
// scripts export.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "scenarios/spec/registry.h"
#include "sim_workers/engine/acs/machine.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/play/placement.h"
#include "sim_workers/env/doom_env.h"
#include "sim_workers/env/game_variables.h"
#include "sim_workers/oracle/oracle.h"
#include "sim_workers/oracle/steering.h"

namespace comrad::sim {

struct StageOptions {
  int num_agents = 2;
  uint64_t layout_seed = 42, episode_seed = 1;
  std::vector<std::pair<std::string, std::string>> parameters = {};
  int frame_skip = 1;  ///< one tic at a time, so that tests can look in between
};

/// The game of a scenario's generated layout; null, with a failure noted, where anything is wrong.
inline std::shared_ptr<const DoomGame> make_game(const std::string& scenario,
                                                 const StageOptions& stage = {}) {
  const auto layout = scenarios::generate_layout(
      scenario, {.seed = stage.layout_seed, .num_agents = stage.num_agents, .parameters = stage.parameters});
  if (!layout) return ADD_FAILURE() << layout.error().message, nullptr;
  for (const std::string& warning : layout->warnings) ADD_FAILURE() << warning;
  const auto wad = wad::WadFile::from_bytes({layout->wad.begin(), layout->wad.end()}, scenario);
  if (!wad) return ADD_FAILURE() << wad.error().message, nullptr;
  EnvironmentOptions options;
  options.scenario = scenario;
  options.num_agents = stage.num_agents;
  options.frame_skip = stage.frame_skip;
  options.use_measurements = true;
  auto game = load_doom_game(options, *wad);
  if (!game) return ADD_FAILURE() << game.error().message, nullptr;
  return *game;
}

class PlayedScenario {
 public:
  explicit PlayedScenario(const std::string& scenario, const StageOptions& stage = {})
      : game(make_game(scenario, stage)),
        environment(game),
        buttons(static_cast<std::size_t>(stage.num_agents)) {
    environment.reset(stage.episode_seed);
  }

  /// Tics with `buttons` held; stops when the episode is over. Returns the tics played.
  int run(int tics) {
    int played = 0;
    for (; played < tics && !over(); ++played) {
      environment.press(buttons);
      for (std::size_t agent = 0; agent < buttons.size(); ++agent)
        returns[agent] += environment.last_step().reward[agent];
    }
    return played;
  }
  bool over() const { return environment.last_step().episode_over(); }
  doom::World& world() { return environment.world(); }
  doom::Actor& body(int agent) { return *world().body_of(agent); }
  int32_t user(int index) { return world().exported(index); }
  double variable(int agent, const std::string& name) {
    return read_variable(world(), agent, *scenarios::find_variable(name));
  }
  /// Puts a body down, at rest.
  void put(int agent, double x, double y) {
    doom::Actor& actor = body(agent);
    const doom::Fixed fx = static_cast<doom::Fixed>(x * 65536), fy = static_cast<doom::Fixed>(y * 65536);
    set_position(world(), actor.id, fx, fy, world().sectors()[world().sector_at(fx, fy)].floor_height);
    actor.velocity_x = actor.velocity_y = actor.velocity_z = 0;
  }
  void look(int agent, double degrees) {
    body(agent).angle = static_cast<doom::Angle>(static_cast<int64_t>(degrees / 360.0 * 4294967296.0));
  }
  /// Living actors with a thing id.
  std::vector<doom::Actor*> things(int32_t thing_id) {
    std::vector<doom::Actor*> found;
    for (doom::Actor& actor : world().state().actors)
      if (!actor.removed && actor.thing_id == thing_id && actor.health > 0) found.push_back(&actor);
    return found;
  }
  std::vector<doom::Actor*> of_type(const std::string& name) {
    std::vector<doom::Actor*> found;
    const auto type = world().catalog().find(name);
    for (doom::Actor& actor : world().state().actors)
      if (!actor.removed && type && actor.type == *type) found.push_back(&actor);
    return found;
  }
  void hurt(doom::Actor& target, int amount, int agent) {
    doom::damage_actor(world(), target, nullptr, agent >= 0 ? &body(agent) : nullptr, amount,
                       doom::DamageType::kNormal);
  }
  int carried(int agent, const std::string& item) {
    const auto type = world().catalog().find(item);
    return type ? doom::count_item(world(), agent, *type) : 0;
  }
  void give(int agent, const std::string& item, int amount) {
    doom::give_item(world(), agent, *world().catalog().find(item), amount);
  }
  std::vector<float> measurements() {
    std::vector<float> values(static_cast<std::size_t>(environment.shape().num_agents) *
                              static_cast<std::size_t>(environment.shape().measurement_count));
    environment.observe_numbers({.measurement = values.data()});
    return values;
  }

  std::shared_ptr<const DoomGame> game;
  DoomEnvironment environment;
  std::vector<doom::Buttons> buttons;  ///< what run() holds
  std::vector<double> returns = std::vector<double>(8, 0.0);
};

/// Mean score of the scripted team over layouts 1000000.. (one episode each).
inline double oracle_mean(const std::string& scenario, int layouts,
                          const std::vector<std::pair<std::string, std::string>>& parameters = {}) {
  double sum = 0;
  for (int i = 0; i < layouts; ++i) {
    const auto game = make_game(
        scenario,
        {.layout_seed = 1'000'000u + static_cast<uint64_t>(i), .parameters = parameters, .frame_skip = 4});
    if (game == nullptr) return 0;
    const auto summary = play_oracle_episode(game, static_cast<uint64_t>(i));
    if (!summary) return ADD_FAILURE() << summary.error().message, 0;
    sum += summary->score;
  }
  return sum / layouts;
}

/// What pools set so that maps vary with the seed.
inline const std::vector<std::pair<std::string, std::string>> kVaried = {{"variety", "1"}};

}  // namespace comrad::sim
