#include "rollout_buffer/dds/bus.h"

#include <dirent.h>
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <net/if.h>
#include <netinet/in.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cinttypes>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <limits>
#include <random>
#include <set>

#include "rollout_buffer/core/clock.h"
#include "tests/support/patience.h"

namespace comrad::dds {
namespace bus_test {

uint64_t fresh_run_id() {
  static std::random_device device;
  return (uint64_t{device()} << 32) | device();
}

/// A second process of a run (bus_peer.cc).
class Peer {
 public:
  Peer(uint64_t run_id, const std::string& name, int version) {
    int to[2], from[2];
    EXPECT_EQ(pipe2(to, O_CLOEXEC), 0);
    EXPECT_EQ(pipe2(from, O_CLOEXEC), 0);
    char digits[17];
    std::snprintf(digits, sizeof digits, "%016" PRIx64, run_id);
    const std::string version_text = std::to_string(version);
    pid_ = fork();
    if (pid_ == 0) {
      dup2(to[0], STDIN_FILENO);
      dup2(from[1], STDOUT_FILENO);
      execl(COMRAD_BUS_PEER, COMRAD_BUS_PEER, digits, name.c_str(), version_text.c_str(), nullptr);
      _exit(127);
    }
    close(to[0]);
    close(from[1]);
    input_ = to[1];
    output_ = from[0];
  }
  Peer(Peer&& other) noexcept
      : pid_(std::exchange(other.pid_, -1)), input_(other.input_), output_(other.output_) {}
  ~Peer() {
    if (pid_ > 0) leave();
  }

  bool is_ready() {
    char word[16] = {};
    return read(output_, word, sizeof word - 1) > 0 && std::string(word) == "ready\n";
  }
  pid_t pid() const { return pid_; }
  int leave() {
    close(input_);
    return reap();
  }
  void kill_hard() {
    ::kill(pid_, SIGKILL);
    reap();
    close(input_);
  }

 private:
  int reap() {
    int status = 0;
    waitpid(pid_, &status, 0);
    close(output_);
    pid_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  pid_t pid_ = -1;
  int input_ = -1;
  int output_ = -1;
};

Bus open_bus(uint64_t run_id) {
  auto bus = Bus::open(bus_config_for_run(run_id));
  EXPECT_TRUE(bus) << bus.error().message;
  return std::move(bus).value();
}

/// Waits on the bus until `done()`.
bool eventually(Bus& bus, const std::function<bool()>& done, double limit_s = test::kPatienceSeconds) {
  for (const double end_s = monotonic_s() + limit_s * test::patience(); monotonic_s() < end_s;) {
    if (done()) return true;
    bus.wait(50);
  }
  return done();
}

TEST(Bus, CarriesEveryTopicFromOneProcessToAnother) {
  const uint64_t run_id = fresh_run_id();
  Bus bus = open_bus(run_id);
  // Readers first: this is the early listener, the next test is the late one.
  std::vector<WorkerStatus> workers = bus.take_worker_status();
  std::optional<RunControl> control = bus.take_run_control();
  std::optional<WeightsUpdate> weights = bus.take_weights_update();
  std::vector<EpisodeResult> episodes = bus.take_episode_results();
  std::optional<TrainStats> stats = bus.take_train_stats();
  EXPECT_TRUE(workers.empty() && !control && !weights && episodes.empty() && !stats);

  Peer peer(run_id, "policy-3", 1);
  ASSERT_TRUE(peer.is_ready());
  ASSERT_TRUE(eventually(bus, [&] {
    for (auto& one : bus.take_worker_status()) workers.push_back(one);
    for (auto& one : bus.take_episode_results()) episodes.push_back(one);
    if (auto one = bus.take_run_control()) control = one;
    if (auto one = bus.take_weights_update()) weights = one;
    if (auto one = bus.take_train_stats()) stats = one;
    return !workers.empty() && control && weights && episodes.size() >= 3 && stats;
  }));
  EXPECT_EQ(workers[0].worker_id, "policy-3");
  EXPECT_EQ(workers[0].host, "here");
  EXPECT_EQ(workers[0].pid, peer.pid());
  EXPECT_EQ(workers[0].role, "policy");
  EXPECT_EQ(workers[0].state, "running");
  EXPECT_EQ(workers[0].decisions_per_s, 100.5);
  EXPECT_EQ(workers[0].message, "said 1");
  EXPECT_EQ(control->run_state, "paused");
  EXPECT_EQ(control->checkpoint_seq, 1u);
  EXPECT_EQ(control->settings_epoch, 2u);
  EXPECT_EQ(weights->version, 1u);
  EXPECT_EQ(weights->bytes, 1ull << 40);
  EXPECT_EQ(weights->checksum, ~0ull);
  EXPECT_EQ(episodes[0].scenario, "/" + std::string(4000, 's')) << "no path is cut";
  EXPECT_EQ(episodes[0].record.layout_id, 42u);
  EXPECT_EQ(episodes[0].record.layout_index, 7u);
  EXPECT_EQ(episodes[0].record.episode_seed, 1ull << 63);
  EXPECT_EQ(episodes[0].record.env_index, 5u);
  EXPECT_EQ(episodes[0].record.score, 612.5);
  EXPECT_EQ(episodes[0].record.ceiling, 8400.0);
  EXPECT_THAT(episodes[0].record.returns(), testing::ElementsAre(1.0, -2.0, 3.0));
  EXPECT_THAT(episodes[0].record.scores(), testing::ElementsAre(4.0, 5.0, 6.0));
  EXPECT_EQ(episodes[0].record.length_steps, 153u);
  EXPECT_EQ(episodes[0].record.length_tics, 612u);
  EXPECT_TRUE(episodes[0].record.terminated);
  EXPECT_EQ(episodes[1].record.episode_id, episodes[0].record.episode_id + 1) << "reliable and in order";
  EXPECT_EQ(episodes[2].record.episode_id, episodes[0].record.episode_id + 2);
  EXPECT_EQ(stats->time_s, 1.5);
  EXPECT_EQ(stats->env_frames, 1ull << 50);
  EXPECT_EQ(stats->decisions, 1ull << 48);
  EXPECT_EQ(stats->learner_version, 1u);
  EXPECT_EQ(stats->env_frames_per_s, 4000);
  EXPECT_EQ(stats->decisions_per_s, 1000);
  EXPECT_EQ(stats->score_mean, -3.25);
  EXPECT_EQ(stats->return_mean, 0.5);
  EXPECT_EQ(stats->episodes, 77u);
  EXPECT_EQ(stats->policy_lag_mean, 2.5);
  EXPECT_EQ(stats->policy_lag_max, 9u);
  EXPECT_EQ(stats->last_checkpoint, "checkpoint/x.pt");
  EXPECT_EQ(peer.leave(), 0);
}

TEST(Bus, GivesALateJoinerTheNewestOfEveryLastingTopic) {
  const uint64_t run_id = fresh_run_id();
  Peer peer(run_id, "learner", 3);
  ASSERT_TRUE(peer.is_ready());
  Bus bus = open_bus(run_id);
  std::vector<WorkerStatus> workers;
  std::optional<RunControl> control;
  std::optional<WeightsUpdate> weights;
  std::optional<TrainStats> stats;
  ASSERT_TRUE(eventually(bus, [&] {
    for (auto& one : bus.take_worker_status()) workers.push_back(one);
    if (auto one = bus.take_run_control()) control = one;
    if (auto one = bus.take_weights_update()) weights = one;
    if (auto one = bus.take_train_stats()) stats = one;
    return !workers.empty() && control && weights && stats;
  }));
  ASSERT_EQ(workers.size(), 1u) << "keep-last 1 per worker";
  EXPECT_EQ(workers[0].message, "said 3");
  EXPECT_EQ(control->checkpoint_seq, 3u);
  EXPECT_EQ(weights->version, 3u);
  EXPECT_EQ(stats->learner_version, 3u);
}

TEST(Bus, TwoRunsOnOneHostNeverMeetEvenInTheSameDomain) {
  const uint64_t run_id = fresh_run_id();
  uint64_t other_id = fresh_run_id();
  while (bus_config_for_run(other_id).domain_id != bus_config_for_run(run_id).domain_id) ++other_id;
  Bus bus = open_bus(run_id);
  bus.take_worker_status();
  bus.take_episode_results();
  Peer stranger(other_id, "unknown", 1);
  ASSERT_TRUE(stranger.is_ready());
  Peer friendly(run_id, "friend", 1);
  ASSERT_TRUE(friendly.is_ready());

  std::set<std::string> heard;
  const auto listen = [&] {
    for (auto& one : bus.take_worker_status()) heard.insert(one.worker_id);
    bus.take_episode_results();
    return heard.contains("friend");
  };
  EXPECT_TRUE(eventually(bus, listen));
  eventually(
      bus, [&] { return listen(), false; }, 1.5);
  EXPECT_THAT(heard, testing::ElementsAre("friend"));
}

TEST(Bus, TwentyParticipantsFitOnOneHost) {
  const uint64_t run_id = fresh_run_id();
  std::vector<Peer> peers;
  for (int i = 0; i < 19; ++i) peers.emplace_back(run_id, "policy-" + std::to_string(i), 1);
  for (Peer& peer : peers) ASSERT_TRUE(peer.is_ready());
  Bus bus = open_bus(run_id);
  std::set<std::string> heard;
  EXPECT_TRUE(eventually(bus,
                         [&] {
                           for (auto& one : bus.take_worker_status()) heard.insert(one.worker_id);
                           return heard.size() == 19;
                         }))
      << heard.size() << " of 19 heard";
}

TEST(Bus, ReportsAWorkerThatDiedAndNotOneThatSaidGoodbye) {
  const uint64_t run_id = fresh_run_id();
  Bus bus = open_bus(run_id);
  std::set<std::string> heard;
  bus.take_worker_status();
  Peer doomed(run_id, "doomed", 1);
  Peer polite(run_id, "polite", 1);
  ASSERT_TRUE(doomed.is_ready() && polite.is_ready());
  ASSERT_TRUE(eventually(bus, [&] {
    for (auto& one : bus.take_worker_status()) heard.insert(one.worker_id);
    return heard.size() == 2;
  }));
  EXPECT_THAT(bus.take_lost_workers(), testing::IsEmpty());

  EXPECT_EQ(polite.leave(), 0);
  doomed.kill_hard();
  std::vector<std::string> lost;
  ASSERT_TRUE(eventually(bus, [&] {
    for (auto& one : bus.take_lost_workers()) lost.push_back(one);
    return !lost.empty();
  }));
  eventually(
      bus,
      [&] {
        for (auto& one : bus.take_lost_workers()) lost.push_back(one);
        return false;
      },
      1);
  EXPECT_THAT(lost, testing::ElementsAre("doomed"));
}

TEST(Bus, HearsItselfAndKeepsNotANumber) {
  Bus bus = open_bus(fresh_run_id());
  bus.take_train_stats();
  TrainStats said;
  said.score_mean = std::numeric_limits<double>::quiet_NaN();
  ASSERT_TRUE(bus.write(said));
  std::optional<TrainStats> stats;
  ASSERT_TRUE(eventually(bus, [&] { return (stats = bus.take_train_stats()).has_value(); }));
  EXPECT_TRUE(std::isnan(stats->score_mean));
}

TEST(Bus, CutsLongWordsButNeverInsideACharacterAndNeverAKey) {
  Bus bus = open_bus(fresh_run_id());
  bus.take_worker_status();
  WorkerStatus status;
  status.worker_id = "policy-0";
  status.message =
      std::string(510, 'x') + "\u00fc\u00fc";  // the first one would end at byte 512, the bound is 511
  ASSERT_TRUE(bus.write(status));
  std::vector<WorkerStatus> heard;
  ASSERT_TRUE(eventually(bus, [&] { return !(heard = bus.take_worker_status()).empty(); }));
  EXPECT_EQ(heard[0].message, std::string(510, 'x'));

  status.worker_id = std::string(64, 'w');
  const Status too_long = bus.write(status);
  ASSERT_FALSE(too_long);
  EXPECT_EQ(too_long.error().code, ErrorCode::kBadInput);
  EXPECT_FALSE(bus.write(WorkerStatus{}));
}

TEST(Bus, WaitSleepsWhenNothingArrives) {
  Bus bus = open_bus(fresh_run_id());
  bus.take_train_stats();
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

TEST(Bus, RefusesWhatIsNotThisHostsLoopback) {
  BusConfig config = bus_config_for_run(1);
  config.interface_name = "eth0";
  auto bus = Bus::open(config);
  ASSERT_FALSE(bus);
  EXPECT_EQ(bus.error().code, ErrorCode::kBadInput);
  EXPECT_THAT(bus.error().message, testing::HasSubstr("loopback"));
  config = bus_config_for_run(1);
  config.run_id = "<Tag>";
  EXPECT_FALSE(Bus::open(config));
}

TEST(Bus, RefusesASecondRunInTheSameDomainOfOneProcess) {
  const uint64_t run_id = fresh_run_id();
  uint64_t other_id = run_id + 1;
  while (bus_config_for_run(other_id).domain_id != bus_config_for_run(run_id).domain_id) ++other_id;
  Bus bus = open_bus(run_id);
  Bus same_run = open_bus(run_id);
  auto other = Bus::open(bus_config_for_run(other_id));
  ASSERT_FALSE(other);
  EXPECT_THAT(other.error().message, testing::HasSubstr("another run"));
}

TEST(Bus, LeavesNoSocketAndNoThreadBehind) {
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
  { Bus warm_up = open_bus(fresh_run_id()); }
  ASSERT_TRUE(falls_to(threads)) << "of the warm-up";
  const int descriptors = count("/proc/self/fd");
  {
    Bus bus = open_bus(fresh_run_id());
    bus.take_worker_status();
    EXPECT_GT(count("/proc/self/task"), threads);
    EXPECT_LE(count("/proc/self/task"), threads + 8) << "few threads per process";
  }
  EXPECT_EQ(count("/proc/self/fd"), descriptors);
  EXPECT_TRUE(falls_to(threads));
}

TEST(Bus, ListensOnLoopbackOnly) {
  const int probe = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  const bool may_bind = setsockopt(probe, SOL_SOCKET, SO_BINDTODEVICE, "lo", 3) == 0;
  close(probe);
  if (!may_bind)
    GTEST_SKIP() << "this kernel ties sockets to a device for root only; a packet filter replaces that";
  Bus bus = open_bus(fresh_run_id());
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

}  // namespace bus_test
}  // namespace comrad::dds
