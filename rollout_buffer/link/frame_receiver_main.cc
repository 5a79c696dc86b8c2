// comrad-frame-receiver: the end of the frame link on the learner's host. comrad-receiver keeps the door.
#include <utility>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/link/frame_receiver.h"
#include "rollout_buffer/link/link_address.h"
#include "rollout_buffer/link/link_files.h"
#include "rollout_buffer/shm/worker_shell.h"

namespace {

using namespace comrad;

Status work(const shm::WorkerShell& shell, const RunConfig& config) {
  COMRAD_TRY_ASSIGN(const link::LinkAddress address, link::kept_address(shell.run_dir()));
  COMRAD_TRY_ASSIGN(const link::Offer offer, link::read_offer(shell.run_dir()));
  COMRAD_TRY_ASSIGN(const shm::Arena arena, shell.join());
  COMRAD_TRY_ASSIGN(dds::LinkBus bus,
                    dds::LinkBus::open(link::serving_config(
                        address.link_id, link::link_options(config.hosts, link::kLoopback,
                                                            link::kept_keys(shell.run_dir())))));
  link::FrameReceiver receiver(arena, std::move(bus),
                               {.first_worker = arena.shape().own_worker_count(),
                                .worker_count = arena.shape().frame_guest_count,
                                .fingerprint = link::fingerprint_of(offer)});
  receiver.remember(link::read_guests(shell.run_dir(), link::kFrameFiles));
  bool has_warned = false;
  receiver.every_second([&] {
    for (const std::string& host : link::take_hosts_to_leave(shell.run_dir(), link::kFrameFiles))
      receiver.ask_to_leave(host);
    const Status written = link::write_guests(shell.run_dir(), link::kFrameFiles, receiver.records());
    if (!written && !std::exchange(has_warned, true)) spdlog::warn("{}", written.error().message);
  });
  spdlog::info("plays with up to {} simulators of hosts without a policy", arena.shape().frame_guest_count);
  return receiver.run(shell.stop());
}

}  // namespace

int main(int argc, char** argv) {
  shm::WorkerShell shell(
      {.name = "comrad-frame-receiver",
       .role = "frame-receiver",
       .description = "Lets this host's policy workers play with simulators of other hosts.",
       .is_single = true,
       .has_bench = false});
  return shell.run(argc, argv, {.work = [&](const RunConfig& config) { return work(shell, config); }});
}
