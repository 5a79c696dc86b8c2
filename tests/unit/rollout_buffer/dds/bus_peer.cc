// The other process of bus_test: `bus_peer RUN_ID NAME VERSION` joins the run, writes one of everything, reports to
// its parent "ready" and repeats its episode until standard input ends; then it leaves with a goodbye.
#include <poll.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <string>

#include "rollout_buffer/dds/bus.h"

int main(int argc, char** argv) {
  using namespace comrad::dds;
  if (argc != 4) return 2;
  const uint64_t run_id = std::strtoull(argv[1], nullptr, 16);
  const uint32_t version = static_cast<uint32_t>(std::atoi(argv[3]));
  auto bus = Bus::open(bus_config_for_run(run_id));
  if (!bus) {
    std::fprintf(stderr, "%s\n", bus.error().message.c_str());
    return 1;
  }
  bool ok = true;
  // Older words first: a late joiner must not hear them.
  for (uint32_t said = 1; said <= version; ++said) {
    ok = ok && bus->write(WorkerStatus{.worker_id = argv[2],
                                       .host = "here",
                                       .pid = getpid(),
                                       .role = "policy",
                                       .state = "running",
                                       .decisions_per_s = 100.5 * said,
                                       .message = "said " + std::to_string(said)});
    ok = ok &&
         bus->write(RunControl{.run_state = "paused", .checkpoint_seq = said, .settings_epoch = said + 1});
    ok = ok && bus->write(WeightsUpdate{.version = said, .bytes = 1ull << 40, .checksum = ~0ull});
    ok = ok && bus->write(TrainStats{.time_s = 1.5,
                                     .env_frames = 1ull << 50,
                                     .decisions = 1ull << 48,
                                     .learner_version = said,
                                     .env_frames_per_s = 4000,
                                     .decisions_per_s = 1000,
                                     .score_mean = -3.25,
                                     .return_mean = 0.5,
                                     .episodes = 77,
                                     .policy_lag_mean = 2.5,
                                     .policy_lag_max = 9,
                                     .last_checkpoint = "checkpoint/x.pt"});
  }
  std::puts(ok ? "ready" : "failed");
  std::fflush(stdout);
  pollfd input = {.fd = STDIN_FILENO, .events = POLLIN, .revents = 0};
  for (uint64_t episode = 0; poll(&input, 1, 50) == 0; ++episode) {
    ok = ok && bus->write(EpisodeResult{.scenario = "/" + std::string(4000, 's'),  // a path
                                        .record = {.episode_id = episode,
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
                                                   .agent_score = {4.0, 5.0, 6.0}}});
  }
  return ok ? 0 : 1;
}
