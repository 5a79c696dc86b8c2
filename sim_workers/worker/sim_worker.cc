#include "sim_workers/worker/sim_worker.h"

#include <spdlog/fmt/fmt.h>

#include <span>
#include <string>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/shm/is_stopping.h"
#include "rollout_buffer/shm/step_slots.h"

namespace comrad::sim {
namespace {

constexpr int64_t kWaitUs = 50'000;  // how often a waiting worker looks at its stop flag

std::string shape_text(const EnvShape& shape) {
  const std::string heads =
      joined(std::span(shape.head_sizes).first(static_cast<std::size_t>(shape.head_count)), ",");
  return fmt::format("{} agents, frame {}x{}x{}, {} measurements, {} numbers of global state, heads {}",
                     shape.num_agents, shape.channels, shape.height, shape.width, shape.measurement_count,
                     shape.global_state_count, heads);
}

bool is_same(const EnvShape& a, const EnvShape& b) {
  if (a.num_agents != b.num_agents || a.channels != b.channels || a.height != b.height ||
      a.width != b.width || a.measurement_count != b.measurement_count ||
      a.global_state_count != b.global_state_count || a.head_count != b.head_count)
    return false;
  for (std::size_t head = 0; head < static_cast<std::size_t>(a.head_count); ++head)
    if (a.head_sizes[head] != b.head_sizes[head]) return false;
  return true;
}

}  // namespace

Expected<std::unique_ptr<SimWorker>> SimWorker::create(EnvironmentSet& environments, const shm::Arena& arena,
                                                       const SimWorkerOptions& options) {
  if (options.worker_index < 0 || options.worker_index >= arena.shape().sim_worker_count)
    return Error{ErrorCode::kBadInput, fmt::format("worker_index is {}; this run has {} simulator workers",
                                                   options.worker_index, arena.shape().sim_worker_count)};
  if (environments.size() != arena.shape().envs_per_worker)
    return Error{ErrorCode::kBadInput, fmt::format("the worker made {} environments, the arena expects {}",
                                                   environments.size(), arena.shape().envs_per_worker)};
  for (int index = 0; index < environments.size(); ++index)
    if (!is_same(environments.at(index).shape(), arena.shape().trajectory.env))
      return Error{ErrorCode::kBadInput, "the scenario has " + shape_text(environments.at(index).shape()) +
                                             "; the arena was made for " +
                                             shape_text(arena.shape().trajectory.env)};
  return std::unique_ptr<SimWorker>(new SimWorker(environments, arena, options));
}

SimWorker::SimWorker(EnvironmentSet& environments, const shm::Arena& arena, const SimWorkerOptions& options)
    : environments_(environments), arena_(arena), options_(options) {
  const int count = environments.size();
  ports_.reserve(static_cast<std::size_t>(count));
  for (int index = 0; index < count; ++index)
    ports_.emplace_back(arena_, environments.at(index), options_.rules, options_.worker_index, index);
  observed_indices_.reserve(static_cast<std::size_t>(count));
  observed_targets_.reserve(static_cast<std::size_t>(count));
}

Status SimWorker::run(const std::atomic<bool>& stop) {
  shm::WorkerCounters& counters = arena_.sim_counters(options_.worker_index);
  counters.begin_life();
  // A predecessor of this index may have died; what it held is ours to give back before we take more.
  if (const uint64_t lost = arena_.reclaim_sim_worker(options_.worker_index); lost > 0)
    spdlog::warn("{} agent decisions of this worker's predecessor are lost", lost);
  if (await_start(stop)) {
    options_.rules.episodes = arena_.control().episodes_per_run.load(std::memory_order_acquire);
    for (EnvPort& port : ports_) COMRAD_TRY(port.start());
    stage_.begin();
    counters.state.store(shm::WorkerState::kRunning);

    const uint64_t agents = static_cast<uint64_t>(arena_.shape().trajectory.env.num_agents);
    while (!shm::is_stopping(stop, arena_)) {
      const int64_t began_ns = monotonic_ns(), waited_ns = waited_ns_;
      const uint32_t heard = shm::listen(arena_.control().slab_released);
      bool is_idle = true;
      for (int split = 0; split < arena_.shape().splits_per_worker; ++split) {
        if (!await_answers(split, stop)) {
          is_idle = false;
          break;
        }
        counters.decisions.fetch_add(static_cast<uint64_t>(play_round(split)) * agents,
                                     std::memory_order_relaxed);
        if (!failure_) return failure_;
        is_idle &= arena_.step_slots()
                       .round(options_.worker_index, split)
                       .request_count.load(std::memory_order_relaxed) == 0;
      }
      if (is_idle)
        wait_counted(arena_.control().slab_released, heard);  // every environment is parked or done
      const int64_t waiting_ns = waited_ns_ - waited_ns;
      counters.wait_ns.fetch_add(static_cast<uint64_t>(waiting_ns), std::memory_order_relaxed);
      counters.busy_ns.fetch_add(static_cast<uint64_t>(monotonic_ns() - began_ns - waiting_ns),
                                 std::memory_order_relaxed);
    }
  }
  counters.state.store(shm::WorkerState::kStopped);
  return {};
}

bool SimWorker::wait_counted(shm::Doorbell& doorbell, uint32_t heard) {
  const int64_t began_ns = monotonic_ns();
  const bool rang = shm::wait(doorbell, heard, kWaitUs);
  waited_ns_ += monotonic_ns() - began_ns;
  return rang;
}

bool SimWorker::await_start(const std::atomic<bool>& stop) {
  shm::ControlBlock& control = arena_.control();
  while (!shm::is_stopping(stop, arena_)) {
    const uint32_t heard_state = shm::listen(control.run_state_changed),
                   heard_gate = shm::listen(control.slab_released);
    if (control.run_state.load(std::memory_order_acquire) != shm::RunState::kRunning) {
      wait_counted(control.run_state_changed, heard_state);
    } else if (!options_.rules.evaluate && control.rollouts_allowed.load(std::memory_order_acquire) == 0) {
      wait_counted(control.slab_released,
                   heard_gate);  // the learner raises the gate last, journals are restored then
    } else {
      return true;
    }
  }
  return false;
}

bool SimWorker::await_answers(int split, const std::atomic<bool>& stop) {
  const shm::ArenaShape& shape = arena_.shape();
  shm::ControlBlock& control = arena_.control();
  shm::Doorbell& acted = arena_.step_slots().acted(options_.worker_index, split);
  while (!shm::is_stopping(stop, arena_)) {
    const uint32_t heard_state = shm::listen(control.run_state_changed);
    if (control.run_state.load(std::memory_order_acquire) == shm::RunState::kPaused) {
      wait_counted(control.run_state_changed, heard_state);
      continue;
    }
    const uint32_t heard = shm::listen(acted);
    bool is_complete = true;
    for (int index = shape.split_begin(split); index < shape.split_end(split) && is_complete; ++index) {
      const EnvPort& port = ports_[static_cast<std::size_t>(index)];
      is_complete = !port.is_outstanding() || port.has_answer();
    }
    if (is_complete) return true;
    wait_counted(acted, heard);
  }
  return false;
}

/// One round of a split. Returns how many environments were stepped.
int SimWorker::play_round(int split) {
  const shm::ArenaShape& shape = arena_.shape();
  const std::span<EnvPort> ports(ports_.data() + shape.split_begin(split),
                                 ports_.data() + shape.split_end(split));
  stage_.end(Stage::kHandOver);  // the wait for the answers
  // Read once, so that in lock step all environments of a split pass the gate in the same round.
  const uint64_t rollouts_allowed = arena_.control().rollouts_allowed.load(std::memory_order_acquire);

  // The environment that waits for a slab longest comes before those that are about to seal one.
  for (EnvPort& port : ports) port.try_begin_slab(rollouts_allowed);
  int stepped = 0;
  for (EnvPort& port : ports)
    if (port.is_outstanding()) stepped += port.advance(rollouts_allowed);
  stage_.end(Stage::kTic);

  observe(&EnvPort::wants_final, &EnvPort::final_target, split);  // before any reset
  stage_.end(Stage::kRender);
  for (EnvPort& port : ports)
    if (port.wants_final()) port.close_episode();
  for (const EnvPort& port : ports)
    if (!port.status()) failure_ = port.status();
  stage_.end(Stage::kTic);
  observe(&EnvPort::wants_row, &EnvPort::row_target, split);
  stage_.end(Stage::kRender);
  for (EnvPort& port : ports)
    if (port.wants_row()) port.mark_observed();

  uint32_t requests = 0;
  for (const EnvPort& port : ports) requests += port.wants_commit();
  arena_.step_slots()
      .round(options_.worker_index, split)
      .request_count.store(requests, std::memory_order_relaxed);
  for (EnvPort& port : ports)
    if (port.wants_commit()) port.commit();
  if (requests > 0)
    shm::ring(arena_.step_slots().ready(shape.policy_worker_of(options_.worker_index, split)));
  stage_.end(Stage::kHandOver);
  return stepped;
}

void SimWorker::observe(bool (EnvPort::*wants)() const, ObservationTarget (EnvPort::*target)() const,
                        int split) {
  observed_indices_.clear();
  observed_targets_.clear();
  for (int index = arena_.shape().split_begin(split); index < arena_.shape().split_end(split); ++index) {
    const EnvPort& port = ports_[static_cast<std::size_t>(index)];
    if (!(port.*wants)()) continue;
    observed_indices_.push_back(index);
    observed_targets_.push_back((port.*target)());
  }
  if (!observed_indices_.empty()) environments_.observe(observed_indices_, observed_targets_);
}

}  // namespace comrad::sim
