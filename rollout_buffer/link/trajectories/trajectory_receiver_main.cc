// comrad-trajectory-receiver: the end of the trajectory link on the learner's host, and the run's join endpoint.
#include "rollout_buffer/link/join/serving_program.h"
#include "rollout_buffer/link/trajectories/trajectory_receiver.h"

int main(int argc, char** argv) {
  using namespace comrad;
  shm::WorkerShell shell({.name = "comrad-trajectory-receiver",
                          .role = "receiver",
                          .description = "Lets other hosts join a run, and takes in what they play.",
                          .is_single = true,
                          .has_bench = false});
  uint64_t parameter_bytes = 0;
  shell.flags().add("--parameter_bytes", parameter_bytes,
                    "how much of the weights are parameters, as comrad-policy-worker --describe prints");
  const auto work = [&](const RunConfig& config) {
    const auto options_of = [&](const shm::Arena& arena, const link::Offer& offer,
                                const link::LinkAddress& address) {
      const shm::ArenaShape& shape = arena.shape();
      spdlog::info("other hosts may join at {}, with room for {} simulators of other hosts", address.host,
                   shape.remote_worker_count - shape.remote_frame_worker_count);
      return link::TrajectoryReceiverOptions{
          .first_worker = shape.served_worker_count(),
          .offer = offer,
          .bf16_parameters = config.hosts.serve_bf16_weights ? parameter_bytes / sizeof(float) : 0};
    };
    return link::serve<link::TrajectoryReceiver>(shell, config, link::kTrajectoryFiles, options_of);
  };
  return shell.run(argc, argv, {.work = work});
}
