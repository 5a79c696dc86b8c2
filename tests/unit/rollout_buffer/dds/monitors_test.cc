// What a run reports to monitors of other hosts, and how a participant of the link behaves in its process.

#include <dirent.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <net/if.h>
#include <netinet/in.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <csignal>
#include <cstdlib>
#include <functional>
#include <limits>
#include <random>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/dds/link_bus.h"
#include "tests/support/patience.h"

namespace comrad::dds {
namespace monitors_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

const std::string kPath = "/" + std::string(4000, 's');

uint64_t fresh_id() {
  static std::random_device device;
  return (uint64_t{device()} << 32) | device();
}

LinkBus open_bus(uint64_t id, uint32_t version = kLinkVersion) {
  auto bus = LinkBus::open(link_config(id), version);
  EXPECT_TRUE(bus) << bus.error().message;
  return std::move(bus).value();
}

/// Waits on the bus until `done()`.
bool eventually(LinkBus& bus, const std::function<bool()>& done, double limit_s = test::kPatienceSeconds) {
  for (const double end_s = monotonic_s() + limit_s * test::patience(); monotonic_s() < end_s;) {
    if (done()) return true;
    bus.wait(50);
  }
  return done();
}

/// What one monitor has heard.
struct Heard {
  std::vector<WorkerStatus> workers = {};
  std::vector<EpisodeRecord> episodes = {};
  std::string scenario = {};
  std::vector<RunStats> stats = {};
  void listen(LinkBus& bus) {
    bus.take<WorkerStatus>([&](const WorkerStatus& in) { workers.push_back(in); });
    bus.take<EpisodeResult>([&](const EpisodeResult& in) {
      episodes.push_back(in.record);
      scenario.assign(reinterpret_cast<const char*>(in.payload.data()), in.payload.size());
    });
    bus.take<RunStats>([&](const RunStats& in) { stats.push_back(in); });
  }
};

/// Writes everything once, numbered.
void report(LinkBus& bus, uint32_t number) {
  ASSERT_TRUE(bus.write(WorkerStatus{.worker_id = "policy-3",
                                     .host = "here",
                                     .role = "policy",
                                     .state = "running",
                                     .decisions_per_s = 100.5,
                                     .busy = 0.25,
                                     .silent_s = 1.5,
                                     .cpu_s = 61,
                                     .resident_bytes = 1ull << 40,
                                     .pid = 17,
                                     .restarts = 2,
                                     .message = "report " + std::to_string(number)}));
  RunStats stats{.run = "a_run", .elapsed_s = 9, .env_frames_goal = 1e8, .frame_skip = 4};
  stats.stats = {.time_s = 1.5,
                 .env_frames = 1ull << 50,
                 .decisions = 1ull << 48,
                 .env_frames_per_s = 4000,
                 .decisions_per_s = 1000,
                 .score_mean = std::numeric_limits<double>::quiet_NaN(),
                 .return_mean = 0.5,
                 .episodes = 77,
                 .policy_lag_mean = 2.5,
                 .replay_filled = 0.75,
                 .learner_version = number,
                 .policy_lag_max = 9,
                 .last_checkpoint = "checkpoint/x.pt"};
  ASSERT_TRUE(bus.write(stats));
  ASSERT_TRUE(bus.write(EpisodeResult{.record = {.episode_id = number,
                                                 .episode_seed = 1ull << 63,
                                                 .layout_id = 42,
                                                 .layout_index = 7,
                                                 .env_index = 5,
                                                 .length_steps = 153,
                                                 .length_tics = 612,
                                                 .terminated = 1,
                                                 .agent_count = 3,
                                                 .score = 612.5,
                                                 .ceiling = 8400.0,
                                                 .agent_return = {1.0, -2.0, 3.0},
                                                 .agent_score = {4.0, 5.0, 6.0}},
                                      .payload = std::as_bytes(std::span(kPath))}));
}

TEST(Monitors, CarriesEveryMemberOfEveryTopic) {
  const uint64_t id = fresh_id();
  LinkBus monitor = open_bus(id), run = open_bus(id);
  Heard heard;
  heard.listen(monitor);  // the readers are there before anything is written
  for (uint32_t number = 1; number <= 3; ++number) report(run, number);
  ASSERT_TRUE(eventually(monitor, [&] {
    heard.listen(monitor);
    return !heard.workers.empty() && heard.episodes.size() >= 3 && !heard.stats.empty();
  }));
  const WorkerStatus& worker = heard.workers.back();
  EXPECT_EQ(worker.worker_id.str(), "policy-3");
  EXPECT_EQ(worker.host.str(), "here");
  EXPECT_EQ(worker.pid, 17);
  EXPECT_EQ(worker.role.str(), "policy");
  EXPECT_EQ(worker.state.str(), "running");
  EXPECT_EQ(worker.decisions_per_s, 100.5);
  EXPECT_EQ(worker.busy, 0.25);
  EXPECT_EQ(worker.silent_s, 1.5);
  EXPECT_EQ(worker.cpu_s, 61);
  EXPECT_EQ(worker.resident_bytes, 1ull << 40);
  EXPECT_EQ(worker.restarts, 2u);
  EXPECT_THAT(worker.message.str(), HasSubstr("report"));
  const RunStats& told = heard.stats.back();
  EXPECT_EQ(told.run.str(), "a_run");
  EXPECT_EQ(told.elapsed_s, 9);
  EXPECT_EQ(told.env_frames_goal, 1e8);
  EXPECT_EQ(told.frame_skip, 4u);
  EXPECT_EQ(told.stats.time_s, 1.5);
  EXPECT_EQ(told.stats.env_frames, 1ull << 50);
  EXPECT_EQ(told.stats.decisions, 1ull << 48);
  EXPECT_EQ(told.stats.env_frames_per_s, 4000);
  EXPECT_EQ(told.stats.decisions_per_s, 1000);
  EXPECT_TRUE(std::isnan(told.stats.score_mean));
  EXPECT_EQ(told.stats.return_mean, 0.5);
  EXPECT_EQ(told.stats.episodes, 77u);
  EXPECT_EQ(told.stats.policy_lag_mean, 2.5);
  EXPECT_EQ(told.stats.replay_filled, 0.75);
  EXPECT_EQ(told.stats.policy_lag_max, 9u);
  EXPECT_STREQ(told.stats.last_checkpoint, "checkpoint/x.pt");
  const EpisodeRecord& episode = heard.episodes[0];
  EXPECT_EQ(heard.scenario, kPath) << "no path is cut";
  EXPECT_EQ(episode.layout_id, 42u);
  EXPECT_EQ(episode.layout_index, 7u);
  EXPECT_EQ(episode.episode_seed, 1ull << 63);
  EXPECT_EQ(episode.env_index, 5u);
  EXPECT_EQ(episode.score, 612.5);
  EXPECT_EQ(episode.ceiling, 8400.0);
  EXPECT_THAT(episode.returns(), ElementsAre(1.0, -2.0, 3.0));
  EXPECT_THAT(episode.scores(), ElementsAre(4.0, 5.0, 6.0));
  EXPECT_EQ(episode.length_steps, 153u);
  EXPECT_EQ(episode.length_tics, 612u);
  EXPECT_TRUE(episode.terminated);
  EXPECT_EQ(heard.episodes[1].episode_id, 2u) << "reliable and in order";
  EXPECT_EQ(heard.episodes[2].episode_id, 3u);
}

TEST(Monitors, GivesALateMonitorTheNewestOfEachWorkerAndReport) {
  const uint64_t id = fresh_id();
  LinkBus run = open_bus(id);
  for (uint32_t number = 1; number <= 3; ++number) report(run, number);
  LinkBus monitor = open_bus(id);
  Heard heard;
  ASSERT_TRUE(eventually(monitor, [&] {
    heard.listen(monitor);
    return !heard.workers.empty() && !heard.stats.empty();
  }));
  ASSERT_EQ(heard.workers.size(), 1u) << "keep-last 1 per worker";
  EXPECT_EQ(heard.workers[0].message.str(), "report 3");
  EXPECT_EQ(heard.stats.at(0).stats.learner_version, 3u);
  EXPECT_TRUE(heard.episodes.empty()) << "episodes are for monitors that already listen";
}

TEST(Monitors, AnotherVersionIsSeenAndNotHeard) {
  const uint64_t id = fresh_id();
  LinkBus run = open_bus(id, kLinkVersion + 1), monitor = open_bus(id);
  report(run, 1);
  EXPECT_TRUE(eventually(monitor, [&] { return !monitor.seen().published_versions.empty(); }));
  EXPECT_EQ(monitor.seen().published_versions.at(0), kLinkVersion + 1);
  EXPECT_FALSE(monitor.seen().serves);
  run.take<SenderReport>([](const SenderReport&) {});
  EXPECT_TRUE(eventually(monitor, [&] { return monitor.seen().serves; }));
  Heard heard;
  heard.listen(monitor);
  eventually(
      monitor, [&] { return heard.listen(monitor), false; }, 0.5);
  EXPECT_TRUE(heard.workers.empty() && heard.stats.empty() && heard.episodes.empty());
}

TEST(Monitors, CutsLongWordsButNeverInsideACharacter) {
  const uint64_t id = fresh_id();
  LinkBus bus = open_bus(id);  // it hears itself, too
  Heard heard;
  heard.listen(bus);
  // The first one would end at byte 512, the bound is 511.
  ASSERT_TRUE(
      bus.write(WorkerStatus{.worker_id = "policy-0", .message = std::string(510, 'x') + "\u00fc\u00fc"}));
  ASSERT_TRUE(eventually(bus, [&] { return heard.listen(bus), !heard.workers.empty(); }));
  EXPECT_EQ(heard.workers[0].message.str(), std::string(510, 'x'));
}

TEST(Monitors, TwoRunsOfOneHostNeverMeetEvenInTheSameDomain) {
  const uint64_t id = fresh_id();
  uint64_t other_id = id + 1;
  while (link_config(other_id).domain_id != link_config(id).domain_id) ++other_id;
  const auto reports = [](uint64_t run_id, const char* worker) {
    const pid_t run = fork();
    if (run != 0) return run;
    auto bus = LinkBus::open(link_config(run_id));
    while (bus && bus->write(WorkerStatus{.worker_id = worker})) usleep(50'000);
    _exit(1);
  };
  const pid_t other = reports(other_id, "unknown"), ours = reports(id, "ours");
  std::vector<std::string> heard;
  {
    LinkBus bus = open_bus(id);
    const auto listen = [&] {
      bus.take<WorkerStatus>([&](const WorkerStatus& in) { heard.push_back(in.worker_id.str()); });
    };
    EXPECT_TRUE(eventually(bus, [&] { return listen(), !heard.empty(); }));
    eventually(
        bus, [&] { return listen(), false; }, 1.5);
  }
  for (const pid_t run : {other, ours}) {
    kill(run, SIGKILL);
    waitpid(run, nullptr, 0);
  }
  EXPECT_THAT(heard, ::testing::Each("ours"));
}

TEST(Monitors, WaitSleepsWhenNothingArrives) {
  LinkBus bus = open_bus(fresh_id());
  bus.take<RunStats>([](const RunStats&) {});
  const auto turns = [] {  // how often this thread gave the processor up by itself
    rusage usage{};
    getrusage(RUSAGE_THREAD, &usage);
    return usage.ru_nvcsw;
  };
  const double start_s = monotonic_s();
  const auto before = turns();
  EXPECT_FALSE(bus.wait(1000));
  EXPECT_GE(monotonic_s() - start_s, 0.95);
  EXPECT_GE(turns() - before, 1) << "it slept";
  EXPECT_LE(turns() - before, 50) << "and did not look again and again";
}

TEST(Monitors, RefusesWhatIsNotThisHostsLoopback) {
  BusConfig config = link_config(1);
  config.interface_name = "eth0";
  auto bus = LinkBus::open(config);
  ASSERT_FALSE(bus);
  EXPECT_EQ(bus.error().code, ErrorCode::kBadInput);
  EXPECT_THAT(bus.error().message, HasSubstr("loopback"));
  config = link_config(1);
  config.run_id = "<Tag>";
  EXPECT_FALSE(LinkBus::open(config));
}

TEST(Monitors, RefusesASecondRunInTheSameDomainOfOneProcess) {
  const uint64_t run_id = fresh_id();
  uint64_t other_id = run_id + 1;
  while (link_config(other_id).domain_id != link_config(run_id).domain_id) ++other_id;
  LinkBus bus = open_bus(run_id);
  LinkBus same_run = open_bus(run_id);
  auto other = LinkBus::open(link_config(other_id));
  ASSERT_FALSE(other);
  EXPECT_THAT(other.error().message, HasSubstr("another run"));
}

TEST(Monitors, LeavesNoSocketAndNoThreadBehind) {
  const auto count = [](const char* folder) {
    DIR* open = opendir(folder);
    int entries = 0;
    while (readdir(open) != nullptr) ++entries;
    closedir(open);
    return entries;
  };
  // The kernel may list a thread for a moment after it was joined.
  const auto falls_to = [&](int wanted) {
    return test::wait_until([&] { return count("/proc/self/task") <= wanted; });
  };
  const int threads = count("/proc/self/task");
  { LinkBus warm_up = open_bus(fresh_id()); }
  ASSERT_TRUE(falls_to(threads)) << "of the warm-up";
  const int descriptors = count("/proc/self/fd");
  {
    LinkBus bus = open_bus(fresh_id());
    bus.take<WorkerStatus>([](const WorkerStatus&) {});
    EXPECT_GT(count("/proc/self/task"), threads);
    EXPECT_LE(count("/proc/self/task"), threads + 8) << "few threads per process";
  }
  EXPECT_EQ(count("/proc/self/fd"), descriptors);
  EXPECT_TRUE(falls_to(threads));
}

TEST(Monitors, ListensOnLoopbackOnly) {
  const int probe = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  const bool may_bind = setsockopt(probe, SOL_SOCKET, SO_BINDTODEVICE, "lo", 3) == 0;
  close(probe);
  if (!may_bind)
    GTEST_SKIP() << "this kernel ties sockets to a device for root only; a packet filter replaces it";
  LinkBus bus = open_bus(fresh_id());
  int sockets = 0;
  DIR* open = opendir("/proc/self/fd");
  while (const dirent* entry = readdir(open)) {
    const int descriptor = std::atoi(entry->d_name);
    sockaddr_in address{};
    socklen_t size = sizeof address;
    if (entry->d_name[0] == '.' || getsockname(descriptor, reinterpret_cast<sockaddr*>(&address), &size) != 0)
      continue;
    if (address.sin_family != AF_INET) continue;
    ++sockets;
    char device[IFNAMSIZ] = {};
    size = sizeof device;
    getsockopt(descriptor, SOL_SOCKET, SO_BINDTODEVICE, device, &size);
    EXPECT_TRUE(address.sin_addr.s_addr == htonl(INADDR_LOOPBACK) || std::string(device) == "lo")
        << "port " << ntohs(address.sin_port);
  }
  closedir(open);
  EXPECT_GE(sockets, 2);
}

}  // namespace monitors_test
}  // namespace comrad::dds
