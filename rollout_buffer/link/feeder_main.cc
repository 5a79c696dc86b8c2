// comrad-feeder: the end of the link on a host that joined another's run, for whole trajectories or frame by frame.

#include <functional>
#include <utility>

#include "rollout_buffer/core/host_name.h"
#include "rollout_buffer/core/layout_list.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/link/feeder.h"
#include "rollout_buffer/link/frame_sender.h"
#include "rollout_buffer/link/link_address.h"
#include "rollout_buffer/link/link_files.h"
#include "rollout_buffer/shm/worker_shell.h"

namespace {

using namespace comrad;

/// What both ends have in common. `look` says how it stands.
template <typename End>
Status play(const shm::WorkerShell& shell, const shm::Arena& arena, End& end,
            const std::function<link::Feed()>& look) {
  bool has_warned = false;
  end.every_second([&] {
    const Status written = link::write_feed(shell.run_dir(), look());
    if (!written && !std::exchange(has_warned, true)) spdlog::warn("{}", written.error().message);
  });
  const Status fed = end.run(shell.stop());
  if (fed && end.has_run_ended()) arena.control().goal_reached = 1;
  return fed;
}

Status work(const shm::WorkerShell& shell, const RunConfig& config, double patience_s, bool sends_frames) {
  COMRAD_TRY_ASSIGN(const link::LinkAddress address, link::kept_address(shell.run_dir()));
  COMRAD_TRY_ASSIGN(const link::Offer offer, link::read_offer(shell.run_dir()));
  COMRAD_TRY_ASSIGN(const std::string interface, link::interface_towards(address.host));
  int layout_count = 0;
  if (!config.environment.layout_pool.empty()) {
    COMRAD_TRY_ASSIGN(const LayoutList list, read_layout_list(shell.run_dir()));
    layout_count = static_cast<int>(list.layouts.size());
  }
  COMRAD_TRY_ASSIGN(const shm::Arena arena, shell.join());
  COMRAD_TRY_ASSIGN(
      dds::LinkBus bus,
      dds::LinkBus::open(link::joining_config(
          address, link::link_options(config.hosts, interface, link::kept_keys(shell.run_dir())))));
  const uint64_t feeder_id = RngKey(arena.run_id()).split("feeder").bits();
  if (sends_frames) {
    link::FrameSender sender(arena, std::move(bus),
                             {.feeder_id = feeder_id,
                              .fingerprint = link::fingerprint_of(offer),
                              .host = host_name(),
                              .patience_s = patience_s,
                              .layout_count = layout_count});
    return play(shell, arena, sender, [&] {
      return link::Feed{.account = sender.deliveries(),
                        .is_fed = sender.is_played_with(),
                        .has_ended = sender.has_run_ended(),
                        .silent_s = sender.silent_s(),
                        .frames = sender.account()};
    });
  }
  link::Feeder feeder(arena, std::move(bus),
                      {.feeder_id = feeder_id,
                       .fingerprint = link::fingerprint_of(offer),
                       .host = host_name(),
                       .patience_s = patience_s,
                       .layout_count = layout_count});
  return play(shell, arena, feeder, [&] {
    return link::Feed{.account = feeder.account(),
                      .is_fed = feeder.is_fed(),
                      .has_ended = feeder.has_run_ended(),
                      .silent_s = feeder.silent_s()};
  });
}

}  // namespace

int main(int argc, char** argv) {
  shm::WorkerShell shell({.name = "comrad-feeder",
                          .role = "feeder",
                          .description = "Sends what this host plays to the learner of another host, and "
                                         "fetches its weights.",
                          .is_single = true,
                          .has_bench = false});
  double patience_s = 300;
  bool sends_frames = false;
  shell.flags()
      .add("--patience_s", patience_s, "how long the learner's host may be silent, seconds")
      .range(1.0, 1e6);
  shell.flags().add("--frames", sends_frames,
                    "simulators play with the policy workers of the learner's host");
  return shell.run(argc, argv, {.work = [&](const RunConfig& config) {
                     return work(shell, config, patience_s, sends_frames);
                   }});
}
