// comrad-frame-receiver: the end of the frame link on the learner's host. comrad-trajectory-receiver lets
// hosts join.
#include <utility>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/link/frames/frame_receiver.h"
#include "rollout_buffer/link/join/endpoint.h"
#include "rollout_buffer/link/join/serving_program.h"

namespace {

using namespace comrad;

Status work(const shm::WorkerShell& shell, const RunConfig& config) {
  COMRAD_TRY_ASSIGN(const link::LinkAddress address, link::kept_address(shell.run_dir()));
  COMRAD_TRY_ASSIGN(const link::Offer offer, link::read_offer(shell.run_dir()));
  COMRAD_TRY_ASSIGN(const shm::Arena arena, shell.join());
  COMRAD_TRY_ASSIGN(dds::LinkBus bus, link::open_serving_bus(shell, config, address));
  link::FrameReceiver receiver(arena, std::move(bus),
                               {.first_worker = arena.shape().own_worker_count(),
                                .worker_count = arena.shape().frame_guest_count,
                                .fingerprint = link::fingerprint_of(offer)});
  spdlog::info("plays with up to {} simulators of hosts without a policy", arena.shape().frame_guest_count);
  return link::serve(shell, receiver, link::kFrameFiles);
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
