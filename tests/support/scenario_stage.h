// Scenarios for tests: a scenario's script and actors on a level made by hand, or a whole game on a
// generated layout.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "doomgen/wad/wad_reader.h"
#include "scenarios/spec/registry.h"
#include "scenarios/spec/scenario_files.h"
#include "scenarios/spec/script_build.h"
#include "sim_workers/engine/acs/behavior.h"
#include "sim_workers/engine/actors/decorate.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/play/placement.h"
#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/env/doom_env.h"

namespace comrad::sim::test {

/// What a scenario adds to the game: its script, compiled with `layout_text` in front, and its actors.
struct ScenarioContent {
  ScenarioContent(const std::string& scenario, const std::string& layout_text) {
    const auto spec = scenarios::load_scenario(scenario);
    EXPECT_TRUE(spec.has_value()) << spec.error().message;
    const auto built = scenarios::build_script(*spec, layout_text);
    EXPECT_TRUE(built.has_value()) << built.error().message;
    const std::vector<uint8_t> lump(built->behavior.begin(), built->behavior.end());
    const auto loaded = doom::acs::Behavior::load(lump, scenario);
    EXPECT_TRUE(loaded.has_value()) << loaded.error().message;
    behavior = *loaded;
    auto types = std::make_shared<doom::ActorCatalog>();
    if (scenarios::scenario_file_exists(spec->folder + "/actors.decorate")) {
      std::vector<std::string> warnings;
      const auto text = scenarios::read_scenario_file(spec->folder + "/actors.decorate");
      const Status parsed = doom::parse_decorate(*text, "actors.decorate", types.get(), &warnings);
      EXPECT_TRUE(parsed.has_value()) << parsed.error().message;
      EXPECT_TRUE(warnings.empty()) << warnings.front();
    }
    catalog = std::move(types);
  }
  std::shared_ptr<const doom::acs::Behavior> behavior;
  std::shared_ptr<const doom::ActorCatalog> catalog;
};

/// A world on a hand-made level. The first tic runs the OPEN and ENTER scripts.
class ScenarioStage {
 public:
  ScenarioStage(const std::string& scenario, const std::string& layout_text,
                std::shared_ptr<const doom::Level> level, uint64_t seed = 1, int player_count = 2)
      : content_(scenario, layout_text), world(std::move(level), content_.catalog, content_.behavior) {
    reset_world(world, {.player_count = player_count, .seed = seed});
  }
  void tics(int count, const doom::Buttons& first = {}, const doom::Buttons& second = {}) {
    const std::array<doom::Buttons, 2> buttons = {first, second};
    for (int i = 0; i < count; ++i) run_tic(world, buttons);
  }
  int count(const char* type) const { return world.count_actors(*world.catalog().find(type)); }
  int user(int index) const { return world.exported(index); }

 private:
  ScenarioContent content_;

 public:
  doom::World world;
};

using Parameters = std::vector<std::pair<std::string, std::string>>;

/// The game on a generated layout; the default one has seed 42.
inline std::shared_ptr<const DoomGame> generated_game(const std::string& scenario, uint64_t seed = 42,
                                                      const Parameters& parameters = {}, int num_agents = 2) {
  const auto layout = scenarios::generate_layout(
      scenario, {.seed = seed, .num_agents = num_agents, .parameters = parameters});
  EXPECT_TRUE(layout.has_value()) << layout.error().message;
  EXPECT_TRUE(layout->warnings.empty()) << layout->warnings.front();
  const auto wad = wad::WadFile::from_bytes({layout->wad.begin(), layout->wad.end()}, scenario);
  EXPECT_TRUE(wad.has_value());
  EnvironmentOptions options;
  options.scenario = scenario;
  options.num_agents = num_agents;
  options.use_measurements = true;
  const auto game = load_doom_game(options, *wad);
  EXPECT_TRUE(game.has_value()) << game.error().message;
  return *game;
}

/// An environment with shortcuts; a decision presses what the test sets, for four tics.
class ScenarioGame {
 public:
  explicit ScenarioGame(std::shared_ptr<const DoomGame> game, uint64_t seed = 1)
      : env(std::move(game)), buttons_(static_cast<std::size_t>(env.game().num_agents)) {
    env.reset(seed);
  }
  explicit ScenarioGame(const std::string& scenario, uint64_t seed = 1, const Parameters& parameters = {},
                        int num_agents = 2)
      : ScenarioGame(generated_game(scenario, 42, parameters, num_agents), seed) {}

  doom::World& world() { return env.world(); }
  int user(int index) const { return env.world().exported(index); }
  doom::Buttons& press(std::size_t agent) { return buttons_[agent]; }
  bool over() const { return env.last_step().episode_over(); }
  float reward(std::size_t agent) const { return env.last_step().reward[agent]; }
  /// Decisions with what press() holds; stops when the episode ends.
  void decide(int count = 1) {
    for (int i = 0; i < count && !over(); ++i) env.press(buttons_);
  }
  void release() { buttons_.assign(buttons_.size(), {}); }
  void put(int agent, int x, int y) {
    doom::Actor& body = *world().body_of(agent);
    set_position(world(), body.id, doom::to_fixed(x), doom::to_fixed(y), body.z);
    body.velocity_x = body.velocity_y = 0;
  }
  int count(const char* type) { return world().count_actors(*world().catalog().find(type)); }
  const std::string& script_error() { return world().state().scripts.last_error; }

  DoomEnvironment env;

 private:
  std::vector<doom::Buttons> buttons_;
};

/// `count` layouts of rising seeds are made, and how many attempts were refused on the way.
inline int refusals_of_layouts(const std::string& scenario, int count, const Parameters& parameters = {}) {
  int refusals = 0;
  for (int seed = 0; seed < count; ++seed) {
    const auto layout =
        scenarios::generate_layout(scenario, {.seed = static_cast<uint64_t>(seed), .parameters = parameters});
    EXPECT_TRUE(layout.has_value()) << "seed " << seed << ": " << layout.error().message;
    if (layout) refusals += static_cast<int>(layout->refusals.size());
  }
  return refusals;
}

}  // namespace comrad::sim::test
