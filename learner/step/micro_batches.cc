#include "learner/step/micro_batches.h"

#include <algorithm>

#include "policy_workers/device/operator_path.h"

namespace comrad::learn {

int64_t samples_of_part(const RunConfig& config, torch::Device device) {
  if (config.optimisation.micro_batch_size > 0) return config.optimisation.micro_batch_size;
  return device.is_cpu() ? 512 : 4096;
}

int threads_for_parts(const RunConfig& config, torch::Device device) {
  constexpr int64_t kSamplesInFlightMax = 8192;
  if (!device::has_own_kernels(device)) return 1;
  const int64_t fitting = std::max<int64_t>(1, kSamplesInFlightMax / samples_of_part(config, device));
  return static_cast<int>(std::clamp<int64_t>(config.collection.learner_threads, 1, fitting));
}

}  // namespace comrad::learn
