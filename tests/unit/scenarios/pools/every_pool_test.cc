// Every scenario with every team size that it is for: on varied layouts the scripted team gets at least nine
// tenths of what it gets on the default map, both as shares of what the map allows, or the map is not made.
// Takes half an hour on two cores: label long. COMRAD_LAYOUTS is the number of layouts of each, COMRAD_EACH=1 prints
// each layout's share beside what its axes drew.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "scenarios/spec/scenario_spec.h"
#include "tests/unit/scenarios/pools/pool_share.h"

namespace comrad::sim {
namespace every_pool_test {

constexpr int kLayouts = 20;

int layout_count() {
  const char* asked = std::getenv("COMRAD_LAYOUTS");
  return asked == nullptr ? kLayouts : std::max(2, std::atoi(asked));
}

struct Pair {
  std::string scenario;
  int num_agents;
};

std::vector<Pair> every_pair() {
  std::vector<Pair> pairs;
  for (const std::string& scenario : list_oracles())
    if (const auto spec = scenarios::load_scenario(scenario))
      for (const int agents : spec->supported_agents) pairs.push_back({scenario, agents});
  return pairs;
}

class EveryPool : public testing::TestWithParam<Pair> {};

TEST_P(EveryPool, TheTeamDoesOnItWhatItDoesOnTheDefaultMap) {
  const test::PoolShare share = test::pool_share(GetParam().scenario, GetParam().num_agents, layout_count());
  std::printf("| %s | %d | %.3f | %.3f | %.2f |\n", GetParam().scenario.c_str(), GetParam().num_agents,
              share.on_default, share.on_pool, share.relative());
  if (std::getenv("COMRAD_EACH") != nullptr) std::printf("%s", share.each().c_str());
  std::fflush(stdout);
  EXPECT_GE(share.relative(), test::kLeastRelative) << share.each();
}

INSTANTIATE_TEST_SUITE_P(All, EveryPool, testing::ValuesIn(every_pair()), [](const auto& one) {
  return one.param.scenario + "_" + std::to_string(one.param.num_agents);
});

}  // namespace every_pool_test
}  // namespace comrad::sim
