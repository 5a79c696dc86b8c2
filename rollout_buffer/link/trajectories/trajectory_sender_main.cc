// comrad-trajectory-sender: the end of the link on a host that joined another's run, for whole trajectories or, with
// --frames, frame by frame.
#include <utility>

#include "rollout_buffer/core/host_name.h"
#include "rollout_buffer/core/layout_list.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/link/frames/frame_sender.h"
#include "rollout_buffer/link/join/endpoint.h"
#include "rollout_buffer/link/join/link_address.h"
#include "rollout_buffer/link/join/link_files.h"
#include "rollout_buffer/link/trajectories/trajectory_sender.h"
#include "rollout_buffer/shm/worker_shell.h"

namespace {

using namespace comrad;

Status play(const shm::WorkerShell& shell, const shm::Arena& arena, link::SendingEnd& end) {
  bool has_warned = false;
  end.every_second([&] {
    const Status written = link::write_feed(shell.run_dir(), {.account = end.account(),
                                                              .is_fed = end.is_open(),
                                                              .has_ended = end.has_run_ended(),
                                                              .silent_s = end.silent_s(),
                                                              .frames = end.frames()});
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
  link::FrameSenderOptions options;
  options.fingerprint = link::fingerprint_of(offer);
  options.host = host_name();
  options.patience_s = patience_s;
  if (!config.environment.layout_pool.empty()) {
    COMRAD_TRY_ASSIGN(const LayoutList list, read_layout_list(shell.run_dir()));
    options.layout_count = static_cast<int>(list.layouts.size());
  }
  COMRAD_TRY_ASSIGN(const shm::Arena arena, shell.join());
  COMRAD_TRY_ASSIGN(dds::LinkBus bus,
                    dds::LinkBus::open(link::joining_config(address, config.hosts, interface,
                                                            link::kept_keys(shell.run_dir()))));
  options.peer_id = RngKey(arena.run_id()).split("peer").bits();
  if (sends_frames) {
    link::FrameSender sender(arena, std::move(bus), options);
    return play(shell, arena, sender);
  }
  options.resend_after_s = link::SendingOptions().resend_after_s;
  link::TrajectorySender sender(arena, std::move(bus), options);
  return play(shell, arena, sender);
}

}  // namespace

int main(int argc, char** argv) {
  shm::WorkerShell shell({.name = "comrad-trajectory-sender",
                          .role = "sender",
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
