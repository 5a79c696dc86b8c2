// Scripted teams on a few layouts of pools whose recipes refuse what gives too little. every_pool_test (label
// long) plays all scenarios and team sizes.
#include <gtest/gtest.h>

#include "tests/unit/scenarios/pools/pool_share.h"

namespace comrad::sim {
namespace few_pools_test {

struct Pool {
  const char* scenario;
  int num_agents, layouts;
};

class FewPools : public testing::TestWithParam<Pool> {};

TEST_P(FewPools, TheTeamDoesOnThemWhatItDoesOnTheDefaultMap) {
  const test::PoolShare share =
      test::pool_share(GetParam().scenario, GetParam().num_agents, GetParam().layouts);
  EXPECT_GE(share.relative(), test::kLeastRelative)
      << "default map " << share.on_default << ", pool " << share.on_pool << "\n"
      << share.each();
}

INSTANTIATE_TEST_SUITE_P(All, FewPools,
                         testing::Values(Pool{"coop_health_gathering", 3, 4}, Pool{"foraging_commons", 3, 4}),
                         [](const auto& one) {
                           return std::string(one.param.scenario) + "_" +
                                  std::to_string(one.param.num_agents);
                         });

}  // namespace few_pools_test
}  // namespace comrad::sim
