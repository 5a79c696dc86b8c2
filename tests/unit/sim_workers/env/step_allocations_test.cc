// How often every scenario's step path (tics, rewards, measurements) allocates once its buffers have grown; see
// sim_workers/env/doom_env.h. The engine's own share is none but for alarms of monsters and items after a respawn; scripts
// allocate: the texts that they print, their new threads and their local variables.
#include <gtest/gtest.h>

#include <map>

#include "rollout_buffer/core/rng.h"
#include "tests/support/allocation_count.h"
#include "tests/support/played_scenario.h"

namespace comrad::sim {
namespace step_allocations_test {

/// operator new calls of so many decisions with random actions, resets left out.
uint64_t allocations_of(DoomEnvironment& environment, int decisions, Rng& rng, uint64_t& episode) {
  const EnvShape shape = environment.shape();
  std::vector<int32_t> action(static_cast<std::size_t>(shape.num_agents * shape.head_count));
  std::vector<float> measurement(static_cast<std::size_t>(shape.num_agents * shape.measurement_count));
  std::vector<uint8_t> mask(static_cast<std::size_t>(shape.num_agents * shape.logit_count())),
      active(static_cast<std::size_t>(shape.num_agents));
  uint64_t count = 0;
  for (int i = 0; i < decisions; ++i) {
    if (environment.last_step().episode_over()) environment.reset(++episode);
    for (std::size_t choice = 0; choice < action.size(); ++choice)
      action[choice] = static_cast<int32_t>(rng.below(
          static_cast<uint32_t>(shape.head_sizes[choice % static_cast<std::size_t>(shape.head_count)])));
    const uint64_t before = test::allocations_of_this_thread();
    environment.step(action);
    environment.observe_numbers({.frame = nullptr,
                                 .measurement = measurement.data(),
                                 .action_mask = mask.data(),
                                 .agent_active = active.data()});
    count += test::allocations_of_this_thread() - before;
  }
  return count;
}

TEST(StepPath, OfEveryScenarioAllocatesLessThanTwiceADecisionOfItsWorld) {
  for (const std::string& scenario : scenarios::layout_recipes()) {
    PlayedScenario played(scenario, {.frame_skip = 4});
    ASSERT_NE(played.game, nullptr) << scenario;
    Rng rng(RngKey(uint64_t{5}).split(scenario));
    uint64_t episode = 1;
    (void)allocations_of(played.environment, 1500, rng, episode);  // buffers grow to their size
    // Most: Co-op Health Gathering, 714, for the seconds that its script prints.
    EXPECT_LE(allocations_of(played.environment, 500, rng, episode), 800u) << scenario << " in 500 decisions";
  }
}

}  // namespace step_allocations_test
}  // namespace comrad::sim
