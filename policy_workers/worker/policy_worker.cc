#include "policy_workers/worker/policy_worker.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <utility>

#include "policy_workers/device/choose_device.h"
#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/cores.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/settings/resolve.h"
#include "rollout_buffer/shm/is_stopping.h"
#include "rollout_buffer/shm/step_slots.h"
#include "rollout_buffer/shm/weight_buffers.h"

namespace comrad::policy {
namespace {

constexpr int64_t kGatherTimeoutUs = 50'000;  // how often an idle worker looks at its stop flag

/// How many of a GPU host's cores copy frames side by side: the policy workers share a quarter of them.
int packing_threads(const shm::ArenaShape& shape) {
  return std::clamp(usable_cores() / (4 * shape.policy_worker_count), 1, 4);
}

}  // namespace

Expected<PolicyWorker> PolicyWorker::create(const RunConfig& config, const shm::Arena& arena,
                                            const PolicyWorkerOptions& options) {
  const TrajectoryShape& shape = arena.shape().trajectory;
  COMRAD_TRY_ASSIGN(
      Batcher batcher,
      Batcher::create(arena, {.policy_worker = options.worker_index,
                              .min_batch = config.collection.min_batch,
                              .max_batch = config.collection.max_batch,
                              .max_wait_us = config.collection.max_wait_us,
                              .is_deterministic = config.collection.deterministic || options.is_evaluation,
                              .is_evaluation = options.is_evaluation,
                              .is_greedy = options.is_greedy,
                              .is_epsilon_greedy = config.run.algo->learns_q_values() && !options.is_random,
                              .epsilon = config.q_learning.epsilon,
                              .exploration = config.q_learning.epsilon_per_head ? Exploration::kPerHead
                                                                                : Exploration::kAllHeads,
                              .seed = static_cast<uint64_t>(config.run.seed)}));
  ActorCritic policy;
  std::optional<SeatNetworks> seats;
  if (!options.seats_of.empty()) {
    COMRAD_TRY_ASSIGN(const torch::Device device, choose_device(policy_device(config, options.worker_index)));
    COMRAD_TRY_ASSIGN(seats, SeatNetworks::create(options.seats_of, arena, device));
    batcher.seat(seats->rules());
  } else if (!options.is_random) {
    const NetworkOptions network = NetworkOptions::from(config, shape.env);
    if (network.recurrent_state_count() != shape.recurrent_state_count)
      return Error{ErrorCode::kBadInput,
                   fmt::format("the network has {} floats of recurrent state, the arena was made for {}; all "
                               "processes of a run must read the same config.toml",
                               network.recurrent_state_count(), shape.recurrent_state_count)};
    if (sees_global_state(config) && shape.env.global_state_count == 0)
      return Error{
          ErrorCode::kBadInput,
          "critic_state is global, but the arena was made without the global state; all processes of "
          "a run must read the same config.toml"};
    COMRAD_TRY_ASSIGN(const torch::Device device, choose_device(policy_device(config, options.worker_index)));
    COMRAD_TRY(check_encoder(network.encoder, network.env));
    policy = ActorCritic::create_for_loading(network, device);
    spdlog::info("policy worker: {}", policy.description());
    if (policy.weights_bytes() > arena.shape().weights_bytes)
      return Error{ErrorCode::kBadInput,
                   fmt::format("the network's weights need {} bytes, the arena holds {}; all processes of a "
                               "run must read the same config.toml",
                               policy.weights_bytes(), arena.shape().weights_bytes)};
  }
  return PolicyWorker(arena, options, std::move(policy), std::move(seats), std::move(batcher));
}

PolicyWorker::PolicyWorker(const shm::Arena& arena, const PolicyWorkerOptions& options, ActorCritic policy,
                           std::optional<SeatNetworks> seats, Batcher batcher)
    : arena_(&arena),
      options_(options),
      policy_(std::move(policy)),
      seats_(std::move(seats)),
      batcher_(std::move(batcher)),
      weights_(arena, options.learners_weights) {
  if (!seats_ && !options.is_random && !device::has_own_kernels(policy_.device()))
    staged_ = std::make_unique<StagedForward>(policy_, arena.shape(), packing_threads(arena.shape()),
                                              options.learners_frames);
}

Status PolicyWorker::run(const std::atomic<bool>& stop) {
  shm::WorkerCounters& counters = arena_->policy_counters(options_.worker_index);
  counters.begin_life();
  if (const int orphans = batcher_.adopt_orphans(); orphans > 0)
    spdlog::warn("{} requests of this worker's predecessor are answered again", orphans);

  COMRAD_TRY(refresh());
  stage_.begin();
  while (!shm::is_stopping(stop, *arena_)) {
    if (needs_weights() && !weights_.version()) {
      const uint32_t heard = shm::listen(arena_->control().weights_published);
      if (!weights_.has_any()) shm::wait(arena_->control().weights_published, heard, kGatherTimeoutUs);
      COMRAD_TRY(refresh());
    } else if (const Batch& batch = batcher_.gather(kGatherTimeoutUs); !batch.is_empty()) {
      const int64_t began_ns = monotonic_ns();
      stage_.end(Stage::kGather);
      if (!needs_weights()) {
        batcher_.scatter_random(batch);
      } else {
        // After the wait, not before it: in lock step the learner publishes and then lets simulators continue,
        // so the requests that end a wait already expect the new weights.
        COMRAD_TRY_ASSIGN(const PolicyOutput output, answer(batch));
        batcher_.scatter(batch, output, *weights_.version());
      }
      stage_.end(Stage::kScatter);
      count_batch(batch, monotonic_ns() - began_ns);
    }
    counters.state.store(shm::WorkerState::kRunning, std::memory_order_relaxed);
  }
  counters.state.store(shm::WorkerState::kStopped);
  return {};
}

Expected<PolicyOutput> PolicyWorker::answer(const Batch& batch) {
  COMRAD_TRY(refresh());
  stage_.end(Stage::kWeights);
  const auto forward = [&] {
    return seats_    ? seats_->step(batch)
           : staged_ ? staged_->step(batch, &stage_)
                     : policy_.step_rows(batch.frames, batch.measurement, batch.recurrent_state,
                                         batch.global_state);
  };
  if (is_thread()) {
    PolicyOutput output = forward();
    stage_.end(Stage::kForward);
    return output;
  }
  PolicyOutput output;
  {
    const ProcessStage of_all_threads(Stage::kForward, {Stage::kPack});  // libtorch's work on it too
    output = forward();
  }
  stage_.end_wall(Stage::kForward);
  stage_.begin();
  return output;
}

Status PolicyWorker::refresh() {
  if (!needs_weights()) return {};
  const Expected<bool> refreshed =
      seats_
          ? weights_.refresh([this](std::span<const std::byte> bytes) { return seats_->read_weights(bytes); })
          : weights_.refresh(policy_);
  if (refreshed) {
    if (*refreshed && seats_) batcher_.seat(seats_->rules());
    if (*refreshed) spdlog::debug("weights of version {}", *weights_.version());
    return {};
  }
  // With weights in hand a damaged update is bad luck: the learner publishes again soon.
  if (!weights_.version()) return refreshed.error();
  spdlog::warn("kept version {}: {}", *weights_.version(), refreshed.error().message);
  return {};
}

void PolicyWorker::count_batch(const Batch& batch, int64_t busy_ns) {
  shm::WorkerCounters& counters = arena_->policy_counters(options_.worker_index);
  counters.decisions.fetch_add(static_cast<uint64_t>(batch.row_count()), std::memory_order_relaxed);
  counters.batches.fetch_add(1, std::memory_order_relaxed);
  counters.busy_ns.fetch_add(static_cast<uint64_t>(busy_ns), std::memory_order_relaxed);
  counters.wait_ns.store(batcher_.wait_ns(), std::memory_order_relaxed);
}

namespace {

/// Random frames, and the network that acts on them.
class SyntheticBatch {
 public:
  SyntheticBatch(const ActorCritic& policy, int64_t rows) : policy_(policy) {
    const NetworkOptions& options = policy.options();
    const int64_t frame_bytes = options.env.frame_bytes(), worlds = rows / options.env.num_agents;
    torch::manual_seed(0);
    frames_ = torch::randint(0, 256, {rows, frame_bytes}, torch::kUInt8);
    if (options.env.measurement_count > 0)
      batch_.measurement = torch::randn({rows, options.env.measurement_count});
    batch_.recurrent_state = torch::zeros({rows, options.recurrent_state_count()});
    if (options.global_state_count > 0)
      batch_.global_state = torch::randn({worlds, options.global_state_count});
    for (int64_t row = 0; row < rows; ++row)
      batch_.frames.push_back(frames_.data_ptr<uint8_t>() + row * frame_bytes);
    // Statistics give denormals and clips as in real use.
    policy.update_input_statistics(frames_, batch_.measurement);
    if (policy.device().is_cpu()) return;
    for (int world = 0; world < worlds; ++world) {
      Request request{};
      request.env_index = world;
      request.kind = shm::RequestKind::kAct;
      request.reset_state = true;
      batch_.requests.push_back(request);
    }
    shm::ArenaShape shape;
    shape.trajectory.env = options.env;
    shape.trajectory.recurrent_state_count = static_cast<int>(options.recurrent_state_count());
    shape.sim_worker_count = 1;
    shape.envs_per_worker = static_cast<int>(worlds);
    staged_.emplace(policy, shape, packing_threads(shape));
  }

  void pass() {
    if (staged_) {
      (void)staged_->step(batch_);
      for (Request& request : batch_.requests) {
        request.reset_state = false;
        ++request.step_id;
      }
      return;
    }
    const PolicyOutput output =
        policy_.step_rows(batch_.frames, batch_.measurement, batch_.recurrent_state, batch_.global_state);
    batch_.recurrent_state = output.recurrent_state.cpu();
    (void)output.logits.cpu();
  }

 private:
  const ActorCritic& policy_;
  Tensor frames_;
  Batch batch_;
  std::optional<StagedForward> staged_;
};

}  // namespace

InferenceBench bench_inference(const ActorCritic& policy, int64_t batch_rows, double seconds) {
  SyntheticBatch batch(policy, batch_rows);
  for (int warm_up = 0; warm_up < 3; ++warm_up) batch.pass();
  const Stopwatch clock(CLOCK_PROCESS_CPUTIME_ID);
  int64_t passes = 0;
  double took = 0;
  do {
    batch.pass();
    ++passes;
    took = clock.elapsed();
  } while (took < seconds);
  return {.rows_per_s = static_cast<double>(passes * batch_rows) / took,
          .batch_rows = batch_rows,
          .seconds = took,
          .cpu_seconds = clock.cpu_elapsed()};
}

}  // namespace comrad::policy
