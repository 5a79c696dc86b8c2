#include "deploy/run/remote_run.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <functional>
#include <limits>
#include <random>

#include "rollout_buffer/link/join/link_address.h"
#include "tests/support/patience.h"

namespace comrad::deploy {
namespace remote_run_test {

using ::testing::HasSubstr;
using ::testing::Not;

/// Another process that publishes on loopback under a separate id, whatever `report` writes again and again.
class Publishing {
 public:
  explicit Publishing(const std::function<void(dds::LinkBus&)>& report,
                      uint32_t version = dds::kLinkVersion) {
    std::random_device device;
    address_.link_id = (uint64_t{device()} << 32) | device();
    pid_ = fork();
    if (pid_ != 0) return;
    auto bus = dds::LinkBus::open(link::serving_config(address_.link_id, HostSettings()), version);
    while (bus) {
      report(*bus);
      usleep(50'000);
    }
    _exit(1);
  }
  Publishing(const Publishing&) = delete;
  Publishing& operator=(const Publishing&) = delete;
  ~Publishing() {
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  RemoteRequest request(double wait_s = test::kPatienceSeconds) const {
    return {.address = link::text_of(address_), .wait_s = wait_s};
  }

 private:
  link::LinkAddress address_;
  pid_t pid_ = -1;
};

void report_of_a_run(dds::LinkBus& bus) {
  dds::RunStats stats{.run = "lava", .elapsed_s = 65, .env_frames_goal = 1e8, .frame_skip = 4};
  stats.stats = {.env_frames = 1'500'000, .decisions_per_s = 878, .score_mean = 12.5, .episodes = 3};
  (void)bus.write(stats);
  (void)bus.write(dds::EpisodeResult{.record = {.length_tics = 612, .score = 9.5f}});
  for (const char* sim : {"sim-0", "sim-1"})
    (void)bus.write(dds::WorkerStatus{.worker_id = sim,
                                      .host = "box",
                                      .role = "sim",
                                      .state = "running",
                                      .decisions_per_s = 440,
                                      .pid = 1234,
                                      .restarts = 1});
  (void)bus.write(dds::WorkerStatus{
      .worker_id = "host far", .host = "far", .role = "host", .state = "running", .decisions_per_s = 100});
  (void)bus.write(dds::WorkerStatus{
      .worker_id = "supervisor", .host = "box", .role = "supervisor", .state = "running", .pid = 77});
}

TEST(RemoteRun, IsShownAsARunOfThisHostIs) {
  const Publishing publishing(report_of_a_run);
  auto remote = RemoteRun::open(publishing.request());
  ASSERT_TRUE(remote) << remote.error().message;
  nlohmann::json run;
  ASSERT_TRUE(test::wait_until([&] {
    run = remote->look();
    return run["workers"].size() == 3 && run["episodes_heard"] > 0;
  }));
  EXPECT_EQ(run["run"], "lava");
  EXPECT_EQ(run["state"], "running");
  EXPECT_EQ(run["host"], "box");
  EXPECT_EQ(run["pid"], 77);
  EXPECT_EQ(run["env_frames"], 1.5e6);
  EXPECT_EQ(run["J_mean"], 12.5);
  EXPECT_EQ(run["restarts"], 2);
  EXPECT_EQ(run["last_episodes"][0]["J"], 9.5);
  EXPECT_EQ(run["hosts"].size(), 2u);
  EXPECT_EQ(run["hosts"][0]["decisions_per_s"], 880);
  EXPECT_EQ(run["silence"], "");
  EXPECT_FALSE(remote->has_ended());
}

TEST(RemoteRun, WhatItReportsCannotDriveATerminalNorBreakJson) {
  const Publishing publishing([](dds::LinkBus& bus) {
    dds::RunStats stats{.run = "\x1b[2J\xff", .elapsed_s = std::numeric_limits<double>::infinity()};
    stats.stats = {.env_frames = UINT64_MAX,
                   .env_frames_per_s = std::numeric_limits<double>::quiet_NaN(),
                   .score_mean = 1e300,
                   .episodes = UINT64_MAX};
    (void)bus.write(stats);
    (void)bus.write(
        dds::WorkerStatus{.worker_id = "\x1b]0;x", .decisions_per_s = -1e300, .resident_bytes = UINT64_MAX});
    (void)bus.write(dds::WorkerStatus{.worker_id = "supervisor", .state = "\r\x1b", .message = "\xc2\x9b"});
  });
  auto remote = RemoteRun::open(publishing.request());
  ASSERT_TRUE(remote) << remote.error().message;
  ASSERT_TRUE(test::wait_until([&] { return remote->look()["workers"].size() == 1; }));
  const std::string text = remote->look().dump();
  EXPECT_THAT(text, Not(HasSubstr("\x1b")));
  EXPECT_THAT(text, Not(HasSubstr("u001b")));
  EXPECT_THAT(text, Not(HasSubstr("\x9b")));
  EXPECT_TRUE(remote->look()["env_frames"].is_null());
  EXPECT_TRUE(remote->look()["J_mean"].is_null());
}

TEST(RemoteRun, EndsWhenTheRunReportsItsEnd) {
  const Publishing publishing([](dds::LinkBus& bus) {
    (void)bus.write(dds::RunStats{.run = "lava"});
    (void)bus.write(dds::WorkerStatus{.worker_id = "supervisor", .state = "finished"});
  });
  auto remote = RemoteRun::open(publishing.request());
  ASSERT_TRUE(remote) << remote.error().message;
  EXPECT_TRUE(remote->has_ended());
  EXPECT_EQ(remote->look()["state"], "finished");
}

TEST(RemoteRun, ARunThatFallsSilentIsShownSo) {
  std::optional<Publishing> publishing(std::in_place, report_of_a_run);
  auto remote = RemoteRun::open(publishing->request());
  ASSERT_TRUE(remote) << remote.error().message;
  publishing.reset();
  EXPECT_TRUE(test::wait_until(
      [&] { return remote->look()["silence"].get<std::string>().find("no report") != std::string::npos; }));
}

TEST(RemoteRun, AnotherVersionIsNamed) {
  const Publishing publishing(report_of_a_run, dds::kLinkVersion + 1);
  const auto refused = RemoteRun::open(publishing.request(5));
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kBadInput);
  EXPECT_THAT(refused.error().message, HasSubstr("version " + std::to_string(dds::kLinkVersion + 1)));
  EXPECT_THAT(refused.error().message, HasSubstr("same build"));
}

TEST(RemoteRun, WithoutARunThereItReportsWhatToCheck) {
  const auto silent = RemoteRun::open({.address = "127.0.0.1/0123456789abcdef", .wait_s = 0.2});
  ASSERT_FALSE(silent);
  EXPECT_EQ(silent.error().code, ErrorCode::kTimeout);
  EXPECT_THAT(silent.error().message, HasSubstr("no report from 127.0.0.1"));
  EXPECT_THAT(silent.error().message, HasSubstr("--publish"));
  EXPECT_THAT(silent.error().message, Not(HasSubstr("\n")));
}

TEST(RemoteRun, RefusesAnAddressOrATimeThatIsNone) {
  for (const char* address : {"nonsense", "127.0.0.1/xyz", "300.0.0.1/0123456789abcdef", ""}) {
    const auto refused = RemoteRun::open({.address = address, .wait_s = 0.2});
    ASSERT_FALSE(refused) << address;
    EXPECT_NE(refused.error().code, ErrorCode::kTimeout) << address;
  }
  EXPECT_FALSE(RemoteRun::open({.address = "127.0.0.1/0123456789abcdef", .wait_s = 0}));
}

}  // namespace remote_run_test
}  // namespace comrad::deploy
