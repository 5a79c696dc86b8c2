// Which hosts may join: hosts in network namespaces, unknown peers among them, and what keys cost.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <spdlog/sinks/basic_file_sink.h>
#include <sys/mount.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <random>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/dds/keys.h"
#include "rollout_buffer/dds/link_bus.h"
#include "tests/support/network_pair.h"
#include "tests/support/patience.h"
#include "tests/support/scratch_folder.h"

namespace comrad::dds {
namespace link_security_test {

using ::testing::HasSubstr;

uint64_t fresh_id() {
  static std::random_device device;
  return (uint64_t{device()} << 32) | device();
}

std::string read_whole(const std::string& path) { return read_file(path).value_or(""); }

int count_of(const std::string& text, const std::string& words) {
  int count = 0;
  for (std::size_t at = text.find(words); at != std::string::npos; at = text.find(words, at + 1)) ++count;
  return count;
}

/// What came to one end; written down by a child for its parent.
struct Heard {
  int questions = 0, reports = 0, fragments = 0, states = 0, weights = 0, strange = 0;
};

constexpr uint64_t kFriend = 7;

/// The serving end while `goes_on`: answers reports, sends weights. Anything that does not come from the friend is strange.
int serve(const BusConfig& config, const std::function<bool()>& goes_on, const std::string& log) {
  spdlog::set_default_logger(spdlog::basic_logger_st("serve", log));
  spdlog::flush_on(spdlog::level::info);
  auto bus = LinkBus::open(config);
  if (!bus) return 2;
  Heard heard;
  const std::vector<std::byte> weights(100'000);
  double sent_s = 0;
  for (; goes_on(); bus->wait(20)) {
    bus->take_questions([&](const JoinQuestion& in) { heard.strange += in.peer_id != kFriend; });
    bus->take<SenderReport>([&](const SenderReport& in) {
      ++heard.reports;
      heard.strange += in.hello.peer_id != kFriend;
      (void)bus->write(PeerState{.peer_id = in.hello.peer_id});
    });
    bus->take<TrajectoryFragment>([&](const TrajectoryFragment& in) {
      ++heard.fragments;
      heard.strange += in.peer_id != kFriend;
    });
    bus->take<PeerEpisode>([&](const PeerEpisode& in) { heard.strange += in.peer_id != kFriend; });
    if (heard.reports > 0 && heard.fragments > 0) std::ofstream(log + ".heard") << "all";
    if (monotonic_s() - sent_s > 0.5) {
      sent_s = monotonic_s();
      (void)bus->write(WeightsChunk{.chunk_count = 1, .version = 1, .payload = weights});
    }
  }
  if (heard.strange > 0) return 3;
  return heard.reports > 0 && heard.fragments > 0 ? 0 : 4;
}

/// A host that sends all it may and listens while `goes_on`, ten times at least. 0: it was answered and got weights, which the
/// file `served` reports meanwhile; 10: it got nothing at all.
int join(const BusConfig& config, uint64_t peer_id, const std::function<bool()>& goes_on,
         const std::string& served) {
  spdlog::set_level(spdlog::level::off);
  auto bus = LinkBus::open(config);
  if (!bus) return 2;
  int states = 0, weights = 0, said = 0;
  const std::vector<std::byte> piece(kFragmentPayloadBytes);
  double said_s = 0;
  for (; goes_on() || said < 10; bus->wait(20)) {
    bus->take<PeerState>([&](const PeerState& in) { states += in.peer_id == kFriend; });
    bus->take_answers([&](const JoinAnswer&) { ++states; });
    bus->take<WeightsChunk>([&](const WeightsChunk&) { ++weights; });
    if (states > 0 && weights > 0) std::ofstream(served) << "all";
    if (monotonic_s() - said_s < 0.3) continue;
    said_s = monotonic_s(), ++said;
    (void)bus->write(JoinQuestion{.peer_id = peer_id, .text = "{}"});
    (void)bus->write(SenderReport{.hello = {.peer_id = peer_id, .host = "x"}});
    (void)bus->write(TrajectoryFragment{.peer_id = peer_id, .payload = piece});
    (void)bus->write(PeerEpisode{.peer_id = peer_id});
  }
  if (states > 0 && weights > 0) return 0;
  return states == 0 && weights == 0 ? 10 : 11;
}

TEST(LinkSecurity, UnknownPeersOnTheNetworkGetNothingAndLeaveOneLineEach) {
  const test::NetworkPair network(3);
  if (!network.is_made()) GTEST_SKIP() << test::NetworkPair::why_not();
  const test::ScratchFolder folder;
  const std::string keys = folder.string() + "/keys", others = folder.string() + "/others",
                    log = folder.string() + "/log";
  ASSERT_TRUE(make_keys({.folder = keys, .hosts = {"b"}}));
  ASSERT_TRUE(make_keys({.folder = others, .hosts = {"b"}}));
  const uint64_t id = fresh_id();  // all know it, and with it domain, tag and partition
  const auto config = [&](int end, const std::string& key_folder) {
    BusConfig of_end = link_config(id);
    of_end.interface_name = network.device(end);
    of_end.peers.clear();
    if (end == 1) of_end.peers = {network.address(0)};
    of_end.key_folder = key_folder;
    of_end.allows_insecure_network = key_folder.empty();
    return of_end;
  };
  const std::string over = folder.string() + "/over";
  const auto goes_on = [&] { return !std::filesystem::exists(over); };
  const pid_t server = network.start(0, [&] { return serve(config(0, keys + "/run"), goes_on, log); });
  const std::string served = folder.string() + "/served";
  const auto start = [&](const std::string& key_folder, uint64_t peer_id) {
    return network.start(1, [&] { return join(config(1, key_folder), peer_id, goes_on, served); });
  };
  const pid_t without = start("", 666), with_others = start(others + "/hosts/b", 667),
              false_server = start(others + "/run", 668);  // one that claims to be the server
  EXPECT_TRUE(test::wait_until([&] { return count_of(read_whole(log), "refused a participant") >= 3; }));
  const pid_t friendly = start(keys + "/hosts/b", kFriend);
  EXPECT_TRUE(test::wait_until(
      [&] { return std::filesystem::exists(served) && std::filesystem::exists(log + ".heard"); }));
  std::ofstream(over) << "now";
  EXPECT_EQ(test::NetworkPair::wait(friendly), 0) << "a host with the right key was not served";
  EXPECT_EQ(test::NetworkPair::wait(without), 10) << "an unknown peer without a key got something";
  EXPECT_EQ(test::NetworkPair::wait(with_others), 10) << "an unknown peer with other keys got something";
  EXPECT_EQ(test::NetworkPair::wait(false_server), 10);
  EXPECT_EQ(test::NetworkPair::wait(server), 0) << "3: an unknown peer was heard; 4: no peer was";
  const std::string lines = read_whole(log);
  EXPECT_EQ(count_of(lines, "refused a participant"), 3) << lines;
  EXPECT_EQ(count_of(lines, "\n"), 3) << lines;
}

TEST(LinkSecurity, AServerWithoutKeysDoesNotReachAHostThatHasSome) {
  const test::NetworkPair network(4);
  if (!network.is_made()) GTEST_SKIP() << test::NetworkPair::why_not();
  const test::ScratchFolder folder;
  ASSERT_TRUE(make_keys({.folder = folder.string() + "/keys", .hosts = {"b"}}));
  const uint64_t id = fresh_id();
  BusConfig plain = link_config(id), with_key = link_config(id);
  plain.interface_name = network.device(0);
  plain.peers.clear();
  plain.allows_insecure_network = true;
  with_key.interface_name = network.device(1);
  with_key.peers = {network.address(0)};
  with_key.key_folder = folder.string() + "/keys/hosts/b";
  const std::string over = folder.string() + "/over";
  const pid_t server = network.start(0, [&] {
    return serve(
        plain, [&] { return !std::filesystem::exists(over); }, folder.string() + "/log");
  });
  const pid_t host = network.start(1, [&] {
    return join(
        with_key, kFriend, [] { return false; }, folder.string() + "/served");
  });
  EXPECT_EQ(test::NetworkPair::wait(host), 10);
  std::ofstream(over) << "now";
  EXPECT_EQ(test::NetworkPair::wait(server), 4);
}

/// A run with --publish while `goes_on`.
int publish(const BusConfig& config, const std::function<bool()>& goes_on, const std::string& log) {
  spdlog::set_default_logger(spdlog::basic_logger_st("publish", log));
  spdlog::flush_on(spdlog::level::info);
  auto bus = LinkBus::open(config);
  if (!bus) return 2;
  for (; goes_on(); bus->wait(50))
    if (!bus->write(WorkerStatus{.worker_id = "supervisor"}) || !bus->write(RunStats{.run = "run"}) ||
        !bus->write(EpisodeResult{}))
      return 3;
  return 0;
}

/// A monitor while `goes_on`. 0: it got all topics, which the file `served` reports meanwhile; 10: it got nothing at all.
int watch(const BusConfig& config, const std::function<bool()>& goes_on, const std::string& served) {
  spdlog::set_level(spdlog::level::off);
  auto bus = LinkBus::open(config);
  if (!bus) return 2;
  int workers = 0, stats = 0, episodes = 0;
  for (; goes_on(); bus->wait(20)) {
    bus->take<WorkerStatus>([&](const WorkerStatus&) { ++workers; });
    bus->take<RunStats>([&](const RunStats&) { ++stats; });
    bus->take<EpisodeResult>([&](const EpisodeResult&) { ++episodes; });
    if (workers > 0 && stats > 0 && episodes > 0) std::ofstream(served) << "all";
  }
  if (workers > 0 && stats > 0 && episodes > 0) return 0;
  return workers + stats + episodes == 0 ? 10 : 11;
}

TEST(LinkSecurity, OnlyAMonitorWithKeysOfTheRunsAuthorityIsReportedTo) {
  const test::ScratchFolder folder;
  const std::string keys = folder.string() + "/keys", others = folder.string() + "/others",
                    log = folder.string() + "/log", served = folder.string() + "/served",
                    over = folder.string() + "/over";
  ASSERT_TRUE(make_keys({.folder = keys, .hosts = {"m"}}));
  ASSERT_TRUE(make_keys({.folder = others, .hosts = {"m"}}));
  const uint64_t id = fresh_id();
  const auto goes_on = [&] { return !std::filesystem::exists(over); };
  const auto start = [](const std::function<int()>& work) {
    const pid_t child = fork();
    if (child == 0) _exit(work());
    return child;
  };
  const auto config = [&](const std::string& key_folder) {
    BusConfig of_end = link_config(id);
    of_end.key_folder = key_folder;
    return of_end;
  };
  const auto start_monitor = [&](const std::string& key_folder) {
    return start([&] { return watch(config(key_folder), goes_on, served); });
  };
  const pid_t run = start([&] { return publish(config(keys + "/run"), goes_on, log); });
  const pid_t without = start_monitor(""), with_others = start_monitor(others + "/hosts/m");
  EXPECT_TRUE(test::wait_until([&] { return count_of(read_whole(log), "refused a participant") >= 2; }));
  EXPECT_FALSE(std::filesystem::exists(served));
  const pid_t monitor = start_monitor(keys + "/hosts/m");
  EXPECT_TRUE(test::wait_until([&] { return std::filesystem::exists(served); }));
  std::ofstream(over) << "now";
  EXPECT_EQ(test::NetworkPair::wait(monitor), 0) << "a monitor with the right keys got nothing";
  EXPECT_EQ(test::NetworkPair::wait(without), 10) << "a monitor without keys got something";
  EXPECT_EQ(test::NetworkPair::wait(with_others), 10) << "a monitor with keys of another authority did";
  EXPECT_EQ(test::NetworkPair::wait(run), 0);
}

TEST(LinkSecurity, AHostMayNotSpeakForTheRun) {
  const test::ScratchFolder folder;
  ASSERT_TRUE(make_keys({.folder = folder.string() + "/keys", .hosts = {"b"}}));
  BusConfig config = link_config(fresh_id());
  config.key_folder = folder.string() + "/keys/hosts/b";
  auto bus = LinkBus::open(config);
  ASSERT_TRUE(bus) << bus.error().message;
  EXPECT_TRUE(bus->write(SenderReport{.hello = {.peer_id = 1}}));
  for (const Status& refused :
       {bus->write(WeightsChunk{.chunk_count = 1, .version = 9}), bus->write(PeerState{.peer_id = 1}),
        bus->write(JoinAnswer{.peer_id = 1}), bus->write(WorkerStatus{.worker_id = "supervisor"})}) {
    ASSERT_FALSE(refused);
    EXPECT_THAT(refused.error().message, HasSubstr("permissions.p7s"));
  }
}

TEST(LinkSecurity, MissingPluginsAreRefusedWithWhatToDo) {
  const test::ScratchFolder folder;
  ASSERT_TRUE(make_keys({.folder = folder.string() + "/keys", .hosts = {}}));
  const auto plugins = security_plugins();
  ASSERT_TRUE(plugins) << plugins.error().message;
  const std::string said = folder.string() + "/said";
  const pid_t child = fork();
  if (child == 0) {
    if (unshare(CLONE_NEWNS) != 0 || mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0 ||
        mount("none", plugins->c_str(), "tmpfs", 0, nullptr) != 0)
      _exit(77);
    BusConfig config = link_config(fresh_id());
    config.key_folder = folder.string() + "/keys/run";
    const auto bus = LinkBus::open(config);
    (void)write_file_atomically(said, bus ? "it opened" : bus.error().message, false);
    _exit(0);
  }
  if (test::NetworkPair::wait(child) == 77) GTEST_SKIP() << "a mount namespace needs root";
  EXPECT_THAT(read_whole(said), HasSubstr("libddsc0t64 (apt install --reinstall)"));
}

}  // namespace link_security_test
}  // namespace comrad::dds
