// How a scripted team does on a pool's layouts, measured by how it does on the default map: what
// `check_resources` and the scripted teams promise together.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "doomgen/wad/wad_reader.h"
#include "scenarios/spec/layout_pool.h"
#include "scenarios/spec/registry.h"
#include "scenarios/spec/scenario_files.h"
#include "sim_workers/env/doom_env.h"
#include "sim_workers/oracle/oracle.h"
#include "tests/support/scratch_folder.h"

namespace comrad::sim::test {

/// What a team must get on a pool at least, of what it gets on the default map: one bound for all scenarios and team
/// sizes. Recipes refuse maps that give less than this by their rules. Layouts and episodes have fixed seeds, so that a
/// result changes with the code alone.
constexpr double kLeastRelative = 0.9;

/// One layout of a pool and what a scripted team got on it.
struct PlayedLayout {
  std::string name = {};  ///< its id and what its axes drew
  double share = 0;       ///< J / ceiling of its episode
  uint32_t length_tics = 0;
};

/// Mean J / ceiling of a scripted team.
struct PoolShare {
  double on_default = 0, on_pool = 0;
  std::vector<PlayedLayout> layouts;
  /// Of what it gets on the default map.
  double relative() const { return on_default > 0 ? on_pool / on_default : 0; }
  /// A line for each layout, the hardest one first.
  std::string each() const {
    std::vector<PlayedLayout> rising = layouts;
    std::sort(rising.begin(), rising.end(), [](const auto& a, const auto& b) { return a.share < b.share; });
    std::string text;
    for (const PlayedLayout& one : rising) {
      char numbers[64];
      std::snprintf(numbers, sizeof(numbers), "%.3f %6u tics  ", one.share, one.length_tics);
      text += numbers + one.name + "\n";
    }
    return text;
  }
};

/// One episode on a WAD: J / ceiling and its length.
inline PlayedLayout played_layout(const std::string& scenario, int num_agents, const std::string& bytes,
                                  uint64_t seed) {
  const auto wad = wad::WadFile::from_bytes({bytes.begin(), bytes.end()}, scenario);
  if (!wad) return ADD_FAILURE() << wad.error().message, PlayedLayout{};
  EnvironmentOptions options;
  options.scenario = scenario;
  options.num_agents = num_agents;
  const auto game = load_doom_game(options, *wad);
  if (!game) return ADD_FAILURE() << game.error().message, PlayedLayout{};
  const auto summary = play_oracle_episode(*game, seed);
  if (!summary) return ADD_FAILURE() << summary.error().message, PlayedLayout{};
  EXPECT_GT(summary->ceiling, 0) << scenario << ": a map that claims not to be for " << num_agents;
  return {.share = summary->ceiling > 0 ? summary->score / summary->ceiling : 0.0,
          .length_tics = summary->length_tics};
}

/// Draws a pool of `layouts` for evaluation and plays one episode on each; as many on the default map.
inline PoolShare pool_share(const std::string& scenario, int num_agents, int layouts) {
  PoolShare share;
  const auto own = scenarios::generate_layout(scenario, {.num_agents = num_agents});
  if (!own) return ADD_FAILURE() << own.error().message, share;
  const comrad::test::ScratchFolder folder;
  const auto pool = scenarios::make_pool(
      scenario, {.kind = scenarios::PoolKind::kEval, .count = layouts, .layout = {.num_agents = num_agents}},
      folder.string());
  if (!pool) return ADD_FAILURE() << pool.error().message, share;
  for (std::size_t i = 0; i < pool->size(); ++i) {
    const scenarios::PoolEntry& entry = (*pool)[i];
    const auto bytes = scenarios::read_scenario_file((folder / entry.filename).string());
    if (!bytes) return ADD_FAILURE() << bytes.error().message, share;
    const uint64_t seed = 1 + i;
    share.layouts.push_back(played_layout(scenario, num_agents, *bytes, seed));
    share.layouts.back().name = entry.id;
    for (const auto& [axis, option] : entry.axis_choices) share.layouts.back().name += "  " + option;
    share.on_pool += share.layouts.back().share / layouts;
    share.on_default += played_layout(scenario, num_agents, own->wad, seed).share / layouts;
  }
  return share;
}

}  // namespace comrad::sim::test
