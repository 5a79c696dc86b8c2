// comrad-sim-worker: one simulator process of a run, or its benchmark.
#include "sim_workers/worker/sim_program.h"

int main(int argc, char** argv) {
  comrad::shm::WorkerShell shell(
      {.name = "comrad-sim-worker",
       .role = "sim",
       .description = "One simulator process of a run: renders observations into the arena and plays the "
                      "actions that come back."});
  return comrad::sim::run_sim_program(argc, argv, shell, {});
}
