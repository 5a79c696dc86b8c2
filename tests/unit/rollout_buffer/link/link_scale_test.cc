// 200 simulators of four hosts are announced to one learner's host: how long until all have places, and what it costs. Label
// long, for its numbers:
//
//   [COMRAD_SCALE_HOSTS=16] ctest -L long -R link_scale_test -V     # at most 19 hosts: participants of one machine
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <random>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/link/join/link_address.h"
#include "rollout_buffer/link/trajectories/trajectory_receiver.h"
#include "rollout_buffer/link/trajectories/trajectory_sender.h"
#include "tests/support/small_arena.h"

namespace comrad::link {
namespace link_scale_test {

const int kHosts = std::getenv("COMRAD_SCALE_HOSTS") ? std::atoi(std::getenv("COMRAD_SCALE_HOSTS")) : 4;
const int kWorkersOfAHost = 200 / kHosts;
constexpr double kWatchedS = 20;

uint64_t fresh_id() {
  static std::random_device device;
  return (uint64_t{device()} << 32) | device();
}

shm::Arena make_arena(int sim_workers, int remote_workers) {
  shm::ArenaShape shape = test::small_arena_shape();
  shape.sim_worker_count = sim_workers;
  shape.remote_worker_count = remote_workers;
  shape.slab_count = 32;
  shape.journal_steps = 0;
  auto arena = shm::Arena::create(shape, fresh_id());
  EXPECT_TRUE(arena) << arena.error().message;
  arena->control().run_state = shm::RunState::kRunning;
  return std::move(*arena);
}

TEST(LinkScale, TwoHundredSimulatorsOfFourHostsHavePlacesSoonAndCostLittle) {
  const uint64_t link_id = fresh_id();
  const shm::Arena learner = make_arena(1 + kHosts * kWorkersOfAHost, kHosts * kWorkersOfAHost);
  std::vector<shm::Arena> players;
  for (int host = 0; host < kHosts; ++host) players.push_back(make_arena(kWorkersOfAHost, 0));
  Offer offer;
  offer.scenario = "field";
  std::vector<pid_t> children;
  for (int host = 0; host < kHosts; ++host) {
    const pid_t pid = fork();
    if (pid == 0) {
      prctl(PR_SET_PDEATHSIG, SIGKILL);
      spdlog::set_level(spdlog::level::off);
      auto bus = dds::LinkBus::open(joining_config({.link_id = link_id}, {}, kLoopback));
      if (!bus) _exit(1);
      static std::atomic<bool> stop{false};
      TrajectorySender sender(players[static_cast<std::size_t>(host)], std::move(*bus),
                              {.peer_id = static_cast<uint64_t>(host) + 1,
                               .fingerprint = fingerprint_of(offer),
                               .host = "host " + std::to_string(host)});
      _exit(sender.run(stop) ? 0 : 1);
    }
    children.push_back(pid);
  }
  usleep(500'000);  // they are there before the run may be joined
  auto bus = dds::LinkBus::open(serving_config(link_id, {}));
  ASSERT_TRUE(bus) << bus.error().message;
  TrajectoryReceiver receiver(learner, std::move(*bus), {.first_worker = 1, .offer = offer});
  std::atomic<bool> stop{false};
  const double began_s = monotonic_s(), cpu_began_s = process_cpu_s();
  double seated_s = 0, cpu_seated_s = 0;
  receiver.every_second([&] {
    int workers = 0;
    for (const PeerRecord& record : receiver.records()) workers += record.is_here ? record.workers : 0;
    const double now_s = monotonic_s();
    if (seated_s == 0 && workers == kHosts * kWorkersOfAHost)
      seated_s = now_s - began_s, cpu_seated_s = process_cpu_s() - cpu_began_s;
    if (now_s - began_s > kWatchedS) stop = true;
  });
  EXPECT_TRUE(receiver.run(stop));
  for (const pid_t pid : children) kill(pid, SIGKILL), waitpid(pid, nullptr, 0);
  rusage children_used{};
  getrusage(RUSAGE_CHILDREN, &children_used);
  const double senders_cpu_s =
      static_cast<double>(children_used.ru_utime.tv_sec + children_used.ru_stime.tv_sec) +
      1e-6 * static_cast<double>(children_used.ru_utime.tv_usec + children_used.ru_stime.tv_usec);
  std::printf(
      "%d simulators of %d hosts: all had places after %.1f s and %.3f s of processor time; idle, the "
      "receiver "
      "takes %.2f ms a second, a sender %.2f ms\n",
      kHosts * kWorkersOfAHost, kHosts, seated_s, cpu_seated_s,
      1000 * (process_cpu_s() - cpu_began_s - cpu_seated_s) / (kWatchedS - seated_s),
      1000 * senders_cpu_s / kHosts / kWatchedS);
  EXPECT_GT(seated_s, 0) << "never were all seated";
  EXPECT_LT(seated_s, 10);
}

}  // namespace link_scale_test
}  // namespace comrad::link
