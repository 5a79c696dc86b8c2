// How many hosts one learner's host can take in, simulated. The long test prints the table of deploy/SCALE.md:
//
//   ctest -L long -R many_hosts_test_long -V
#include "tests/simulation/many_hosts.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace comrad::simulation {
namespace many_hosts_test {

TEST(ManyHosts, ShareALearnerThatIsSlowerThanAllOfThemFairlyAndLoseNothing) {
  const ManyHostsOutcome outcome =
      play({.hosts = 24, .seconds = 30, .learner_decisions_per_s = 4000, .leaving_per_minute = 0});
  EXPECT_GT(outcome.places_s, 0);
  EXPECT_LT(outcome.places_s, 3);
  EXPECT_NEAR(outcome.decisions_per_s, 4000, 400) << "the learner is the bottleneck";
  EXPECT_GT(outcome.least_share, 0.8);
  EXPECT_LE(outcome.slabs_reserved_most, 4 * 24) << "credits bound what may be under way";
  EXPECT_EQ(outcome.lost, 0u);
  EXPECT_EQ(outcome.duplicates, 0u);
}

TEST(ManyHosts, ThatComeAndGoLoseNothingAndAreBackSoon) {
  const ManyHostsOutcome outcome =
      play({.hosts = 24, .seconds = 120, .learner_decisions_per_s = 4000, .leaving_per_minute = 1});
  EXPECT_GT(outcome.decisions_per_s, 3500);
  EXPECT_GT(outcome.back_s_median, 0);
  EXPECT_LT(outcome.back_s_most, 10);
  EXPECT_EQ(outcome.lost, 0u);
}

TEST(ManyHostsLong, UpToAThousandWithATenthLeavingEachMinute) {
  std::printf("%6s %9s %12s %9s %9s %10s %10s %8s %9s %8s %8s %9s %9s %6s\n", "hosts", "places s",
              "decisions/s", "in MB/s", "out MB/s", "in msg/s", "out msg/s", "CPU", "queue MB", "credits",
              "least", "back s", "most s", "again");
  for (const int hosts : {1, 4, 16, 64, 128, 256, 512, 1000}) {
    const ManyHostsOutcome outcome = play({.hosts = hosts, .learner_decisions_per_s = 100e3});
    std::printf("%6d %9.1f %12.0f %9.1f %9.1f %10.0f %10.0f %8.2f %9.1f %8d %8.2f %9.1f %9.1f %6lu\n", hosts,
                outcome.places_s, outcome.decisions_per_s, outcome.in_bytes_per_s / 1e6,
                outcome.out_bytes_per_s / 1e6, outcome.in_messages_per_s, outcome.out_messages_per_s,
                outcome.cpu_share, outcome.queue_mb_most, outcome.slabs_reserved_most, outcome.least_share,
                outcome.back_s_median, outcome.back_s_most, static_cast<unsigned long>(outcome.duplicates));
    std::fflush(stdout);
    EXPECT_EQ(outcome.lost, 0u) << hosts << " hosts";
  }
}

}  // namespace many_hosts_test
}  // namespace comrad::simulation
