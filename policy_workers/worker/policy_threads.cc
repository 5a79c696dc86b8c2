#include "policy_workers/worker/policy_threads.h"

#include <pthread.h>
#include <spdlog/fmt/fmt.h>

#include <exception>
#include <string>

#include "policy_workers/device/choose_device.h"
#include "policy_workers/device/cpu_tuning.h"
#include "policy_workers/device/queue.h"
#include "policy_workers/worker/policy_worker.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/settings/resolve.h"
#include "rollout_buffer/shm/step_slots.h"
#include "rollout_buffer/shm/worker_shell.h"

namespace comrad::policy {

PolicyThreads::PolicyThreads(const RunConfig& config, const shm::Arena& arena, const LocalWeights& weights,
                             SlabFrames* frames)
    : config_(config), arena_(arena), weights_(weights), frames_(frames) {
  for (int index = 0; index < arena.shape().policy_worker_count; ++index)
    threads_.emplace_back([this, index] { work(index); });
}

PolicyThreads::~PolicyThreads() {
  stop_ = true;
  for (int index = 0; index < arena_.shape().policy_worker_count; ++index)
    shm::ring(arena_.step_slots().ready(index));
  for (std::thread& thread : threads_) thread.join();
}

Status PolicyThreads::check() const {
  const std::lock_guard lock(mutex_);
  return failure_;
}

void PolicyThreads::work(int worker_index) {
  const std::string name = fmt::format("policy-{}", worker_index);
  pthread_setname_np(pthread_self(), name.c_str());
  Status result;
  try {
    result = serve(worker_index);
  } catch (const std::exception& failure) {  // from libraries
    result = Error{ErrorCode::kSystem, shm::words_of_failure(failure.what())};
  }
  if (result) return;
  const std::lock_guard lock(mutex_);
  if (failure_) failure_ = Error{result.error().code, name + ": " + result.error().message};
}

Status PolicyThreads::serve(int worker_index) const {
  device::set_operator_threads(
      static_cast<int>(config_.collection.policy_threads));  // this thread's; BLAS has the learner's
  COMRAD_TRY_ASSIGN(const torch::Device device, choose_device(policy_device(config_, worker_index)));
  const device::StreamScope scope(device::Stream::beside(device, device::Priority::kHigh));
  COMRAD_TRY_ASSIGN(PolicyWorker worker, PolicyWorker::create(config_, arena_,
                                                              {.worker_index = worker_index,
                                                               .learners_weights = &weights_,
                                                               .learners_frames = frames_}));
  return worker.run(stop_);
}

}  // namespace comrad::policy
