// Simulators that play through the frame link with policy workers of another arena: `comrad train --link dds` on one host, and
// `comrad join --link dds` with processes of both ends killed. Afterwards every decision is accounted for.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>

#include "tests/integration/decision_accounts.h"
#include "tests/integration/running_program.h"

namespace comrad::test {
namespace frames_test {

using ::testing::HasSubstr;

double delivered_in_frames(const std::string& run) { return decisions_delivered(run, "frame_guests.json"); }

TEST(Frames, SimulatorsOfOneHostPlayOverDdsWithItsPolicyWorkers) {
  const ScratchFolder scratch;
  const std::string learning = scratch / "learning", playing = learning + "/simulators";
  RunningProgram run(small_training(scratch, "learning", 10000, {"--num_workers", "1", "--link", "dds"}));
  const Ending ended = run.wait();
  ASSERT_EQ(ended.exit_code, 0) << ended.err;
  const nlohmann::json learned = checked_account(learning);
  EXPECT_GE(learned["trained"].get<int64_t>(), 10000 / 4);
  EXPECT_EQ(learned["lost_with_simulators"].get<int64_t>(), 0) << learned;
  const nlohmann::json played = checked_account(playing);
  EXPECT_EQ(played["trained"].get<double>(), delivered_in_frames(learning));
  EXPECT_EQ(played["trained"].get<int64_t>(), learned["made"].get<int64_t>());
  EXPECT_EQ(played["lost_on_the_way"].get<int64_t>(), 0) << played;
  const nlohmann::json frames = read_json(playing + "/status.json")["frame_link"];
  EXPECT_GT(frames["latency_us_p50"].get<double>(), 0);
  EXPECT_LE(frames["latency_us_p50"].get<double>(), frames["latency_us_p99"].get<double>());
  EXPECT_TRUE(read_json(learning + "/status.json")["J_mean"].is_number())
      << "episodes come over the link too";
  EXPECT_TRUE(processes_of(scratch.string()).empty());
}

TEST(Frames, AHostWithoutAPolicyPlaysThroughDeathsOfBothEnds) {
  const ScratchFolder scratch;
  const std::string learning = scratch / "learning", playing = scratch / "playing";
  RunningProgram learner(small_training(
      scratch, "learning", 1e9,
      {"--num_workers", "1", "--serve", "--serve_workers", "2", "--serve_frame_workers", "2"}));
  ASSERT_TRUE(wait_until([&] { return env_frames(learning) > 0 || !learner.running(); }));
  ASSERT_TRUE(learner.running()) << learner.wait().err;
  RunningProgram player({program("comrad"), "join", learning, "--link", "dds", "--num_workers", "2",
                         "--train_dir", scratch.string(), "--experiment", "playing", "--progress_interval",
                         "1"});
  const auto delivers_more = [&] {
    const double before = delivered_in_frames(learning);
    return wait_until([&] { return delivered_in_frames(learning) > before || !player.running(); }) &&
           player.running();
  };
  ASSERT_TRUE(delivers_more()) << player.wait().err;
  EXPECT_TRUE(processes_of(playing, "comrad-policy-worker").empty()) << "they are the learner's host's";

  const auto strike = [&](const std::string& run, const std::string& name) {
    const std::vector<pid_t> alive = processes_of(run, name);
    ASSERT_FALSE(alive.empty()) << name;
    kill(alive.front(), SIGKILL);
  };
  strike(playing, "comrad-trajectory-sender");
  ASSERT_TRUE(delivers_more()) << player.wait().err;
  strike(learning, "comrad-policy-worker");
  ASSERT_TRUE(delivers_more()) << player.wait().err;
  ASSERT_TRUE(delivers_more()) << player.wait().err;
  // While the learner's end lives, what one host delivered the other took, once each.
  const auto ctl = RunningProgram({program("comrad"), "ctl", learning, "status"}).wait();
  EXPECT_EQ(ctl.exit_code, 0) << ctl.err;
  const double before = delivered_in_frames(learning);
  strike(learning, "comrad-frame-receiver");
  ASSERT_TRUE(wait_until([&] {
    const double now = delivered_in_frames(learning);
    return now > 0 && now != before;
  }));
  ASSERT_TRUE(delivers_more()) << player.wait().err;
  player.signal(SIGTERM);
  const Ending left = player.wait();
  EXPECT_EQ(left.exit_code, 0) << left.err;
  const nlohmann::json played = checked_account(playing);
  learner.signal(SIGTERM);
  const Ending ended = learner.wait();
  EXPECT_EQ(ended.exit_code, 0) << ended.err;
  (void)checked_account(learning);
  const double taken = delivered_in_frames(learning), told = played["trained"].get<double>();
  EXPECT_GE(taken, told);
  EXPECT_LE(taken, told + played["lost_on_the_way"].get<double>() + played["left"].get<double>()) << played;
  EXPECT_TRUE(processes_of(scratch.string()).empty());
}

TEST(Frames, WithoutRoomOrOverANetworkItIsRefusedInWords) {
  const ScratchFolder scratch;
  const Ending network =
      RunningProgram(small_training(scratch, "refused", 1e9, {"--link", "dds", "--interface", "eth0"}))
          .wait();
  EXPECT_EQ(network.exit_code, 2);
  EXPECT_THAT(network.err, HasSubstr("over loopback"));
  const Ending lock_step =
      RunningProgram(small_training(scratch, "refused", 1e9, {"--link", "dds", "--deterministic"})).wait();
  EXPECT_EQ(lock_step.exit_code, 2);
  EXPECT_THAT(lock_step.err, HasSubstr("link is dds"));
  EXPECT_FALSE(std::filesystem::exists(scratch / "refused"));

  const std::string learning = scratch / "learning";
  RunningProgram learner(small_training(scratch, "learning", 1e9, {"--num_workers", "1", "--serve"}));
  ASSERT_TRUE(
      wait_until([&] { return !read_text(learning + "/link_address").empty() || !learner.running(); }));
  const Ending no_room = comrad({"join", learning, "--link", "dds", "--num_workers", "1", "--train_dir",
                                 scratch.string(), "--experiment", "playing"});
  EXPECT_EQ(no_room.exit_code, 2);
  EXPECT_THAT(no_room.err, HasSubstr("--serve_frame_workers"));
  learner.signal(SIGTERM);
  learner.wait();
}

}  // namespace frames_test
}  // namespace comrad::test
