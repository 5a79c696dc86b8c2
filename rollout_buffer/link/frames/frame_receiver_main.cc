// comrad-frame-receiver: the end of the frame link on the learner's host. comrad-trajectory-receiver lets
// hosts join.
#include "rollout_buffer/link/frames/frame_receiver.h"
#include "rollout_buffer/link/join/serving_program.h"

int main(int argc, char** argv) {
  using namespace comrad;
  shm::WorkerShell shell(
      {.name = "comrad-frame-receiver",
       .role = "frame-receiver",
       .description = "Lets this host's policy workers play with simulators of other hosts.",
       .is_single = true,
       .has_bench = false});
  const auto options_of = [](const shm::Arena& arena, const link::Offer& offer, const link::LinkAddress&) {
    const shm::ArenaShape& shape = arena.shape();
    spdlog::info("plays with up to {} simulators of hosts without a policy", shape.remote_frame_worker_count);
    return link::ServingOptions{.first_worker = shape.own_worker_count(),
                                .worker_count = shape.remote_frame_worker_count,
                                .fingerprint = link::fingerprint_of(offer)};
  };
  return shell.run(argc, argv, {.work = [&](const RunConfig& config) {
                     return link::serve<link::FrameReceiver>(shell, config, link::kFrameFiles, options_of);
                   }});
}
