// How a scripted team does on a pool's layouts, measured by how it does on the default map: what
// `check_resources` and the scripted teams promise together.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "doomgen/wad/wad_reader.h"
#include "scenarios/spec/layout_pool.h"
#include "scenarios/spec/registry.h"
#include "scenarios/spec/scenario_files.h"
#include "sim_workers/env/doom_env.h"
#include "sim_workers/oracle/oracle.h"
#include "tests/support/scratch_folder.h"

namespace comrad::sim::test {

/// Mean J / ceiling of a scripted team.
struct PoolShare {
  double on_default = 0, on_pool = 0;
  /// Of what it gets on the default map.
  double relative() const { return on_default > 0 ? on_pool / on_default : 0; }
};

/// J / ceiling of one episode on a WAD.
inline double played_share(const std::string& scenario, int num_agents, const std::string& bytes,
                           uint64_t seed) {
  const auto wad = wad::WadFile::from_bytes({bytes.begin(), bytes.end()}, scenario);
  if (!wad) return ADD_FAILURE() << wad.error().message, 0;
  EnvironmentOptions options;
  options.scenario = scenario;
  options.num_agents = num_agents;
  const auto game = load_doom_game(options, *wad);
  if (!game) return ADD_FAILURE() << game.error().message, 0;
  const auto summary = play_oracle_episode(*game, seed);
  if (!summary) return ADD_FAILURE() << summary.error().message, 0;
  EXPECT_GT(summary->ceiling, 0) << scenario << ": a map that says it is not for " << num_agents;
  return summary->ceiling > 0 ? summary->score / summary->ceiling : 0;
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
    const auto bytes = scenarios::read_scenario_file((folder / (*pool)[i].filename).string());
    if (!bytes) return ADD_FAILURE() << bytes.error().message, share;
    const uint64_t seed = 1 + i;
    share.on_pool += played_share(scenario, num_agents, *bytes, seed) / layouts;
    share.on_default += played_share(scenario, num_agents, own->wad, seed) / layouts;
  }
  return share;
}

}  // namespace comrad::sim::test
