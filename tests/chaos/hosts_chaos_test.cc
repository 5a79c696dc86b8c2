// Two hosts that train one run, while processes of both are killed and stopped at random and the network between them is cut.
// Every decision of both hosts is accounted for, and what one reports as delivered the other reports as received. Longer:
//   ./comrad test -L long -R hosts_chaos_long

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <memory>

#include "tests/chaos/victims.h"
#include "tests/integration/decision_accounts.h"
#include "tests/integration/running_program.h"
#include "tests/support/network_pair.h"

namespace comrad::test {
namespace hosts_chaos_test {

TEST(HostsChaos, KillsStopsAndCutsOnTwoHostsLoseNothingUntold) {
  const test::NetworkPair network(31);
  if (!network.is_made()) GTEST_SKIP() << test::NetworkPair::why_not();
  const double seconds = number_of("COMRAD_CHAOS_SECONDS", 12);
  Rng rng(chosen_seed());
  const ScratchFolder scratch;
  const std::string learning = scratch / "learning", playing = scratch / "playing";
  RunningProgram learner(network.on(
      0, small_training(scratch, "learning", 1e9,
                        {"--num_workers", "1", "--save_every_sec", "2", "--serve", "--serve_workers", "2",
                         "--interface", network.device(0), "--insecure_network"})));
  ASSERT_TRUE(wait_until([&] { return env_frames(learning) > 0 || !learner.running(); }));
  ASSERT_TRUE(learner.running()) << learner.wait(1).err;
  const std::string address = read_text(learning + "/link_address");
  RunningProgram player(
      network.on(1, {program("comrad"), "join", address.substr(0, address.find('\n')), "--insecure_network",
                     "--num_workers", "2", "--device", "cpu", "--train_dir", scratch.string(), "--experiment",
                     "playing", "--progress_interval", "1"}));
  const auto delivers_more = [&] {
    const double before = decisions_delivered(learning);
    return wait_until([&] { return decisions_delivered(learning) > before || !player.running(); }) &&
           player.running();
  };
  ASSERT_TRUE(delivers_more()) << player.wait(1).err;

  Victims victims(
      {{playing, "comrad-sim-worker", "playing sim", 3},
       {playing, "comrad-policy-worker", "playing policy", 1},
       // One that receives a stop signal ends its run; the others start again.
       {playing, "comrad-trajectory-sender", "trajectory sender", 3, /*may_be_terminated=*/false},
       {learning, "comrad-sim-worker", "learning sim", 1},
       {learning, "comrad-trajectory-receiver", "trajectory receiver", 3, /*may_be_terminated=*/false},
       {learning, "comrad-learner", "learner", 1, /*may_be_terminated=*/false}},
      rng);
  int cuts = 0;
  for (const double end_s = now_s() + seconds; now_s() < end_s; sleep_s(0.05 + 0.001 * rng.below(1200))) {
    ASSERT_TRUE(learner.running()) << learner.wait(1).err;
    ASSERT_TRUE(player.running()) << player.wait(1).err;
    if (rng.below(12) > 0) {
      victims.strike();
      continue;
    }
    ASSERT_TRUE(network.set_up(false));
    sleep_s(0.001 * rng.below(3000));
    ASSERT_TRUE(network.set_up(true));
    ++cuts;
  }
  victims.let_go_on();
  ASSERT_TRUE(delivers_more()) << player.wait(1).err;
  ASSERT_TRUE(delivers_more()) << player.wait(1).err;

  player.signal(SIGTERM);
  const Ending left = player.wait();
  EXPECT_EQ(left.exit_code, 0) << left.err;
  const nlohmann::json played = checked_account(playing);
  EXPECT_GT(played["trained"].get<int64_t>(), 0);
  learner.signal(SIGTERM);
  const Ending ended = learner.wait();
  EXPECT_EQ(ended.exit_code, 0) << ended.err;
  const nlohmann::json learned = checked_account(learning);
  EXPECT_EQ(decisions_delivered(learning), played["trained"].get<double>())
      << "what one host delivered the other took, once each";
  EXPECT_EQ(played["lost_on_the_way"].get<int64_t>(), 0) << "the learner's host never began anew";
  EXPECT_TRUE(wait_until([&] { return processes_of(scratch.string()).empty(); })) << "something is left";
  std::printf("%.0f s: killed %s; stopped %d; %d cuts\nplaying: %s\nlearning: %s\n", seconds,
              victims.kills_text().c_str(), victims.stops, cuts, played.dump().c_str(),
              learned.dump().c_str());
}

}  // namespace hosts_chaos_test
}  // namespace comrad::test
