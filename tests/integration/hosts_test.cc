// One run on two hosts: `comrad train --serve` in one network namespace, `comrad join` in another, joined by a veth pair. A
// host is killed and comes back; afterwards every decision is accounted for. hosts_chaos_test cuts the link.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <memory>

#include "tests/integration/decision_accounts.h"
#include "tests/integration/running_program.h"
#include "tests/support/network_pair.h"

namespace comrad::test {
namespace hosts_test {

using ::testing::HasSubstr;

TEST(Hosts, TwoTrainTogetherThroughADeathAndEveryDecisionIsAccountedFor) {
  const test::NetworkPair network(7);
  if (!network.is_made()) GTEST_SKIP() << test::NetworkPair::why_not();
  const ScratchFolder scratch;
  const std::string learning = scratch / "learning", playing = scratch / "playing";
  const std::string keys = scratch / "keys";
  ASSERT_EQ(comrad({"keys", "make", keys, "--hosts", "player"}).exit_code, 0);
  RunningProgram learner(
      network.on(0, small_training(scratch, "learning", 1e9,
                                   {"--num_workers", "1", "--serve", "--serve_workers", "2", "--interface",
                                    network.device(0), "--keys", keys + "/run"})));
  ASSERT_TRUE(wait_until([&] { return env_frames(learning) > 0 || !learner.running(); }));
  ASSERT_TRUE(learner.running()) << learner.wait().err;
  const std::string address = read_text(learning + "/link_address");
  ASSERT_THAT(address, HasSubstr(network.address(0)));

  const auto join_command = [&](const std::vector<std::string>& more) {
    std::vector<std::string> command = {program("comrad"), "join", address.substr(0, address.find('\n'))};
    command.insert(command.end(), more.begin(), more.end());
    // Each host has its own name.
    command.insert(command.begin(), {"/usr/bin/unshare", "--uts", "/bin/sh", "-c",
                                     "echo player > /proc/sys/kernel/hostname; exec \"$@\"", "sh"});
    return network.on(1, command);
  };
  // A network without keys, another IWAD, and settings that are the run's: refused in words.
  EXPECT_THAT(RunningProgram(join_command({})).wait().err, HasSubstr("--insecure_network"));
  const std::string other_iwad =
      scratch.write("other.wad", std::string("PWAD\1\0\0\0\f\0\0\0", 12) + std::string(8, '\0') +
                                     std::string("EMPTY\0\0\0", 8));
  const Ending other =
      RunningProgram(join_command({"--keys", keys + "/hosts/player"}), {{"COMRAD_IWAD", other_iwad}}).wait();
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_THAT(other.err, HasSubstr("IWAD"));
  EXPECT_THAT(RunningProgram(join_command({"--rollout", "8"})).wait().err,
              HasSubstr("--rollout is the run's"));

  const std::vector<std::string> joining =
      join_command({"--keys", keys + "/hosts/player", "--num_workers", "1", "--device", "cpu", "--train_dir",
                    scratch.string(), "--experiment", "playing", "--progress_interval", "1"});
  auto player = std::make_unique<RunningProgram>(joining);
  const auto delivers_more = [&] {
    const double before = decisions_delivered(learning);
    return wait_until([&] { return decisions_delivered(learning) > before || !player->running(); }) &&
           player->running();
  };
  ASSERT_TRUE(delivers_more()) << player->wait().err;
  EXPECT_EQ(read_json(learning + "/status.json")["state"], "running");

  // The whole host dies, and comes back.
  kill(-player->pid(), SIGKILL);
  player->wait();
  ASSERT_TRUE(wait_until([&] { return processes_of(playing).empty(); }));
  player = std::make_unique<RunningProgram>(joining);
  // What the dead one sent last may still be counted, so the one that came back must be in the list with its own decisions.
  const auto both_delivered = [&] {
    nlohmann::json status = read_json(learning + "/status.json");
    const nlohmann::json& hosts = status["hosts"];
    return hosts.size() == 2 && hosts[0]["delivered"] > 0 && hosts[1]["delivered"] > 0;
  };
  ASSERT_TRUE(wait_until([&] { return both_delivered() || !player->running(); }));
  ASSERT_TRUE(player->running()) << player->wait().err;

  // It is asked to leave, and leaves in peace; the run continues and ends in peace too.
  const auto ctl = [&](const std::vector<std::string>& words) {
    std::vector<std::string> command = {program("comrad"), "ctl", learning};
    command.insert(command.end(), words.begin(), words.end());
    return RunningProgram(network.on(0, command)).wait();
  };
  // The supervisor looks at its peers once a second.
  EXPECT_TRUE(wait_until([&] { return ctl({"status"}).out.find("player") != std::string::npos; }));
  EXPECT_THAT(ctl({"drain", "unknown"}).err, HasSubstr("unknown"));
  const Ending drained = ctl({"drain", "player"});
  EXPECT_EQ(drained.exit_code, 0) << drained.err;
  const Ending left = player->wait();
  EXPECT_EQ(left.exit_code, 0) << left.err;
  EXPECT_THAT(left.err, HasSubstr("was asked to leave"));
  EXPECT_THAT(left.err, HasSubstr("were delivered"));
  const nlohmann::json played = checked_account(playing);
  EXPECT_TRUE(learner.running());
  learner.signal(SIGINT);
  const Ending ended = learner.wait();
  EXPECT_EQ(ended.exit_code, 0) << ended.err;
  (void)checked_account(learning);
  const nlohmann::json hosts = read_json(learning + "/status.json")["hosts"];
  EXPECT_EQ(hosts.size(), 2u) << "the one that died, and the one that came back: " << hosts;
  // The last life's own word of what was delivered is that of the learner's host, but for what it had to leave unconfirmed.
  bool is_known = false;
  for (const auto& host : hosts) {
    const double delivered = host["delivered"].get<double>(), told = played["trained"].get<double>();
    is_known |= told <= delivered && delivered <= told + played["left"].get<double>();
  }
  EXPECT_TRUE(is_known) << hosts << played;
  EXPECT_TRUE(processes_of(scratch.string()).empty());
}

TEST(Hosts, ARunThatEndsEndsThoseThatPlayForIt) {
  const ScratchFolder scratch;
  const std::string learning = scratch / "learning", playing = scratch / "playing";
  RunningProgram learner(
      small_training(scratch, "learning", 60000, {"--num_workers", "1", "--serve", "--serve_bf16_weights"}));
  ASSERT_TRUE(
      wait_until([&] { return !read_text(learning + "/link_address").empty() || !learner.running(); }));
  // The run waits for the host that joins, so that it has not ended before.
  ASSERT_TRUE(wait_until([&] {
    return comrad({"ctl", learning, "pause"}).exit_code == 0 || !learner.running();
  }));
  ASSERT_TRUE(learner.running()) << learner.wait().err;
  // By the run's folder, as hosts with one file system do.
  RunningProgram player({program("comrad"), "join", learning, "--num_workers", "1", "--device", "cpu",
                         "--train_dir", scratch.string(), "--experiment", "playing"});
  ASSERT_TRUE(wait_until(
      [&] { return read_json(learning + "/status.json")["hosts"].size() == 1 || !player.running(); }));
  ASSERT_TRUE(player.running()) << player.wait().err;
  ASSERT_EQ(comrad({"ctl", learning, "resume"}).exit_code, 0);
  const Ending ended = learner.wait();
  EXPECT_EQ(ended.exit_code, 0) << ended.err;
  const Ending left = player.wait();
  EXPECT_EQ(left.exit_code, 0) << left.err;
  EXPECT_THAT(left.err, HasSubstr("the run that this host fed has ended"));
  EXPECT_GT(read_json(playing + "/status.json")["decisions_account"]["trained"].get<double>(), 0);
  EXPECT_EQ(read_json(learning + "/status.json")["state"], "finished");
}

TEST(Hosts, WhatCannotBeServedOrJoinedIsRefusedBeforeAnythingIsWritten) {
  const ScratchFolder scratch;
  const auto refused = [&](const std::vector<std::string>& more) {
    std::vector<std::string> command = small_training(scratch, "refused", 1e9, more);
    const Ending ending = RunningProgram(command).wait();
    EXPECT_EQ(ending.exit_code, 2) << ending.err;
    EXPECT_FALSE(std::filesystem::exists(scratch / "refused"));
    return ending.err;
  };
  EXPECT_THAT(refused({"--serve", "--deterministic"}), HasSubstr("asynchronous runs"));
  EXPECT_THAT(refused({"--serve", "--interface", "no-such"}), HasSubstr("no-such"));
  const Ending nothing = comrad({"join", "127.0.0.1/0123456789abcdef", "--wait_s", "1"});
  EXPECT_NE(nothing.exit_code, 0);
  EXPECT_THAT(nothing.err, HasSubstr("no answer within 1 s at 127.0.0.1"));
  EXPECT_THAT(comrad({"join", "somewhere"}).err, HasSubstr("is no address of a run"));
}

}  // namespace hosts_test
}  // namespace comrad::test
