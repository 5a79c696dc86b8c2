// comrad-trajectory-receiver: the end of the trajectory link on the learner's host, and the run's join endpoint.
#include <utility>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/link/join/serving_program.h"
#include "rollout_buffer/link/trajectories/trajectory_receiver.h"

namespace {

using namespace comrad;

Status work(const shm::WorkerShell& shell, const RunConfig& config, uint64_t parameter_bytes) {
  COMRAD_TRY_ASSIGN(const link::LinkAddress address, link::kept_address(shell.run_dir()));
  COMRAD_TRY_ASSIGN(link::Offer offer, link::read_offer(shell.run_dir()));
  COMRAD_TRY_ASSIGN(const shm::Arena arena, shell.join());
  COMRAD_TRY_ASSIGN(dds::LinkBus bus, link::open_serving_bus(shell, config, address));
  link::TrajectoryReceiver receiver(
      arena, std::move(bus),
      {.first_worker = arena.shape().served_worker_count(),
       .offer = std::move(offer),
       .bf16_parameters = config.hosts.serve_bf16_weights ? parameter_bytes / sizeof(float) : 0});
  spdlog::info("other hosts may join at {}, with room for {} simulators of other hosts", address.host,
               arena.shape().guest_worker_count - arena.shape().frame_guest_count);
  return link::serve(shell, receiver, link::kTrajectoryFiles);
}

}  // namespace

int main(int argc, char** argv) {
  shm::WorkerShell shell({.name = "comrad-trajectory-receiver",
                          .role = "receiver",
                          .description = "Lets other hosts join a run, and takes in what they play.",
                          .is_single = true,
                          .has_bench = false});
  uint64_t parameter_bytes = 0;
  shell.flags().add("--parameter_bytes", parameter_bytes,
                    "how much of the weights are parameters, as comrad-policy-worker --describe prints");
  return shell.run(argc, argv,
                   {.work = [&](const RunConfig& config) { return work(shell, config, parameter_bytes); }});
}
