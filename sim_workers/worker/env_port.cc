#include "sim_workers/worker/env_port.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstring>
#include <string>
#include <vector>

#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/core/stage_clock.h"
#include "rollout_buffer/shm/episode_stream.h"
#include "rollout_buffer/shm/slab_pool.h"

namespace comrad::sim {

using shm::RequestKind;
using shm::SlotState;

EnvPort::EnvPort(const shm::Arena& arena, Environment& environment, const PortRules& rules, int sim_worker,
                 int local_index)
    : arena_(arena),
      environment_(environment),
      rules_(rules),
      sim_worker_(sim_worker),
      env_index_(sim_worker * arena.shape().envs_per_worker + local_index),
      slot_(&arena.step_slots().slot(env_index_)),
      journal_(&arena.journals().header(env_index_)),
      mailbox_(&arena.layout_mailboxes().of(env_index_)),
      account_(&arena.accounts().of(env_index_)),
      slab_(arena.slabs().view(0)) {}

Status EnvPort::start() {
  const uint64_t env = static_cast<uint64_t>(env_index_);
  step_id_ = journal_->step_id;
  rollout_index_ = journal_->rollout_index;
  if (rules_.evaluate) {
    const uint64_t first = journal_->in_use != 0 ? journal_->episode_id : env;
    journal_->in_use = 1;
    return begin_episode(first);
  }
  if (journal_->is_resume == 0) {
    const uint64_t first = journal_->in_use != 0 ? journal_->episode_id + 1 : 0;
    journal_->in_use = 1;
    return begin_episode(first);
  }
  // Exact resume: the same seed and the same actions give the same world back.
  const std::string name = fmt::format("journal of environment {}", env_index_);
  const uint32_t length = journal_->length;
  if (length > static_cast<uint32_t>(arena_.shape().journal_steps))
    return Error{ErrorCode::kBadFormat,
                 fmt::format("{} holds {} decisions of at most {}; the checkpoint cannot be resumed exactly",
                             name, length, arena_.shape().journal_steps)};
  episode_id_ = journal_->episode_id;
  episode_seed_ = journal_->episode_seed;
  if (rules_.layout_count > 0)
    COMRAD_TRY(environment_.choose_layout(static_cast<int>(mailbox_->playing.load())));
  environment_.reset(episode_seed_);
  const EnvShape& shape = arena_.shape().trajectory.env;
  std::vector<int32_t> action(static_cast<std::size_t>(shape.num_agents * shape.head_count));
  for (uint32_t step = 0; step < length; ++step) {
    const std::span<const uint8_t> recorded = arena_.journals().action(env_index_, static_cast<int>(step));
    std::copy(recorded.begin(), recorded.end(), action.begin());
    environment_.step(action);
    if (environment_.last_step().episode_over())
      return Error{ErrorCode::kBadFormat,
                   fmt::format("{} does not replay: the episode ends after {} of {} decisions; the "
                               "checkpoint belongs to another map or build",
                               name, step + 1, length)};
  }
  episode_step_ = length;
  journal_->in_use = 1;
  journal_->is_resume = 0;
  return {};
}

Status EnvPort::begin_episode(uint64_t episode_id) {
  episode_id_ = episode_id;
  episode_step_ = 0;
  journal_->episode_id = episode_id;
  journal_->length = 0;
  if (rules_.evaluate && episode_id >= rules_.episodes) {
    stage_ = Stage::kDone;
    return {};
  }
  COMRAD_TRY(choose_layout(episode_id));
  const RngKey run(rules_.seed);
  episode_seed_ =
      rules_.evaluate
          ? run.split("evaluation").split(episode_id).bits()
          : run.split("episode").split(static_cast<uint64_t>(env_index_)).split(episode_id).bits();
  journal_->episode_seed = episode_seed_;
  environment_.reset(episode_seed_);
  return {};
}

/// Evaluation plays every layout in turn. Training requests a layout of the learner's curriculum every layout_swap_every
/// episodes and stays where it is while no assignment lies in its mailbox.
Status EnvPort::choose_layout(uint64_t episode_id) {
  if (rules_.layout_count == 0) return {};
  if (rules_.evaluate) return environment_.choose_layout(static_cast<int>(episode_id % rules_.layout_count));
  if (episode_id % rules_.layout_swap_every == 0) mailbox_->take_assignment();
  return environment_.choose_layout(static_cast<int>(mailbox_->playing.load(std::memory_order_relaxed)));
}

void EnvPort::next_episode() {
  status_ =
      begin_episode(episode_id_ + (rules_.evaluate ? static_cast<uint64_t>(arena_.shape().env_count()) : 1));
  if (!status_) {  // the worker ends; the supervisor gives the slab back
    stage_ = Stage::kDone;
    return;
  }
  if (stage_ != Stage::kDone) {
    stage_ = Stage::kRow;
    return;
  }
  arena_.slabs().abandon(slab_index_);
}

bool EnvPort::begin_slab(uint64_t rollouts_allowed) {
  if (!rules_.evaluate && rollout_index_ >= rollouts_allowed) return false;
  const std::optional<uint32_t> slab_index = arena_.slabs().acquire(sim_worker_);
  if (!slab_index) return false;
  slab_index_ = *slab_index;
  slab_ = arena_.slabs().view(static_cast<int>(slab_index_));
  step_ = 0;
  final_count_ = 0;
  // Once a trajectory: in lock step the learner counts between two of them, so a resumed run has the same weights.
  if (!rules_.evaluate) environment_.set_env_frames(arena_.control().schedule_env_frames.load());
  shm::SlabHeader& header = arena_.slabs().header(static_cast<int>(slab_index_));
  header.env_index = static_cast<uint32_t>(env_index_);
  header.length = 0;
  std::atomic_signal_fence(std::memory_order_release);  // a kill must not leave our count with another's name
  header.rollout_index = rollout_index_;
  header.layout_id = environment_.layout_id();
  header.first_episode = {.episode_id = episode_id_, .episode_seed = episode_seed_};
  slab_.clear();
  return true;
}

void EnvPort::try_begin_slab(uint64_t rollouts_allowed) {
  if (stage_ == Stage::kParked && begin_slab(rollouts_allowed)) stage_ = Stage::kRow;
}

bool EnvPort::advance(uint64_t rollouts_allowed) {
  COMRAD_DCHECK(stage_ == Stage::kOutstanding, "only a committed slot has an answer");
  if (!shm::advance(*slot_, SlotState::kActed, SlotState::kIdle)) return false;
  switch (request_) {
    case RequestKind::kAct:
      act();
      return true;
    case RequestKind::kFinal:
      next_episode();
      return false;
    case RequestKind::kValue:
      finish_slab(rollouts_allowed);
      return false;
  }
  return false;
}

void EnvPort::act() {
  const EnvShape& shape = slab_.shape().env;
  const std::size_t agents = static_cast<std::size_t>(shape.num_agents);
  const std::span<const int32_t> action(slab_.action(step_, 0).data(),
                                        agents * static_cast<std::size_t>(shape.head_count));
  append_to_journal(action);
  account_->made.store(account_->made.load(std::memory_order_relaxed) + 1, std::memory_order_release);
  environment_.step(action);
  const Step& step = environment_.last_step();
  shape_rewards(step.reward, rules_.rewards, {&slab_.reward(step_, 0), agents});
  slab_.terminated(step_) = step.terminated;
  slab_.truncated(step_) = step.truncated;
  slab_.final_index(step_) = -1;
  slab_.layout_index(step_) = static_cast<int32_t>(played_layout());
  slab_.valid(step_) = 1;
  if (step.episode_over() && !rules_.evaluate) slab_.final_index(step_) = final_count_++;
  ++step_;
  ++step_id_;
  ++episode_step_;
  arena_.slabs().header(static_cast<int>(slab_index_)).length = static_cast<uint32_t>(step_);
  journal_->step_id = step_id_;
  // Evaluation keeps one slab for ever and writes its rows round and round.
  if (rules_.evaluate && step_ == slab_.shape().rollout_steps) step_ = 0;
  stage_ = step.episode_over() ? Stage::kFinal : Stage::kRow;
  if (rules_.evaluate && step.episode_over()) close_episode();
}

void EnvPort::append_to_journal(std::span<const int32_t> action) {
  if (journal_->length < static_cast<uint32_t>(arena_.shape().journal_steps)) {
    const std::span<uint8_t> recorded =
        arena_.journals().action(env_index_, static_cast<int>(journal_->length));
    for (std::size_t index = 0; index < recorded.size();
         ++index)  // what no head has, the environment takes as 0
      recorded[index] = action[index] < 0 || action[index] > 255 ? 0 : static_cast<uint8_t>(action[index]);
  }
  if (journal_->length != UINT32_MAX) ++journal_->length;
}

ObservationTarget EnvPort::target_of_row(const SlabView& slab, int step) const {
  return {.frame = slab.frame(step, 0).data(),
          .measurement = slab.shape().env.measurement_count > 0 ? slab.measurement(step, 0).data() : nullptr,
          .action_mask = slab.action_mask(step, 0).data(),
          .agent_active = &slab.agent_active(step, 0),
          .global_state = slab.shape().env.global_state_count > 0 ? slab.global_state(step).data() : nullptr};
}

ObservationTarget EnvPort::final_target() const {
  // The finals have neither mask nor activity flags; row t+1 lends its memory until the next
  // episode's first observation overwrites it.
  ObservationTarget target = target_of_row(slab_, step_);
  target.frame = slab_.final_frame(final_count_ - 1, 0).data();
  if (target.measurement != nullptr) target.measurement = slab_.final_measurement(final_count_ - 1, 0).data();
  if (target.global_state != nullptr) target.global_state = slab_.final_global_state(final_count_ - 1).data();
  return target;
}

void EnvPort::close_episode() {
  const Step& last = environment_.last_step();
  record_episode();
  if (last.truncated && !rules_.evaluate) {
    request_ = RequestKind::kFinal;
    stage_ = Stage::kObserved;
    return;
  }
  if (!rules_.evaluate)
    for (int agent = 0; agent < slab_.shape().env.num_agents; ++agent)
      slab_.final_value(final_count_ - 1, agent) = 0.0f;
  next_episode();
}

void EnvPort::record_episode() {
  EpisodeRecord record = environment_.summary();
  record.episode_id = episode_id_;
  record.episode_seed = episode_seed_;
  record.layout_id = environment_.layout_id();
  record.layout_index = played_layout();
  record.env_index = static_cast<uint32_t>(env_index_);
  record.terminated = environment_.last_step().terminated;
  arena_.episodes().write(record);
}

/// Its index in the run's pool; evaluations play all in turn.
uint32_t EnvPort::played_layout() const {
  return rules_.layout_count > 0 && !rules_.evaluate ? mailbox_->playing.load(std::memory_order_relaxed) : 0;
}

void EnvPort::mark_observed() {
  const bool is_last_row =
      step_ == slab_.shape().rollout_steps || final_count_ == slab_.shape().final_capacity;
  request_ = is_last_row ? RequestKind::kValue : RequestKind::kAct;
  stage_ = Stage::kObserved;
}

void EnvPort::commit() {
  slot_->step_id = step_id_;
  slot_->episode_id = episode_id_;
  slot_->episode_step = episode_step_;
  slot_->slab_index = slab_index_;
  slot_->step = static_cast<uint32_t>(step_);
  slot_->final_row = request_ == RequestKind::kFinal ? static_cast<uint32_t>(final_count_ - 1) : 0;
  slot_->kind = request_;
  slot_->reset_state = episode_step_ == 0;
  slot_->state.store(SlotState::kReady, std::memory_order_release);
  stage_ = Stage::kOutstanding;
}

void EnvPort::finish_slab(uint64_t rollouts_allowed) {
  const uint32_t sealed_index = slab_index_;
  const SlabView sealed = slab_;
  const int last_row = step_;
  slab_.pad(last_row);
  count_copied(static_cast<std::size_t>(slab_.shape().rollout_steps - last_row) * slab_.frames(0).size());
  arena_.slabs().header(static_cast<int>(sealed_index)).length = static_cast<uint32_t>(last_row);
  journal_->rollout_index = ++rollout_index_;
  // The next slab is taken before this one is let go, because its last row is the next one's first. Without a
  // free slab the environment parks, and the row is rendered again from the unchanged world when one comes.
  if (begin_slab(rollouts_allowed)) {
    copy_observation(target_of_row(sealed, last_row), row_target());
    mark_observed();
  } else {
    stage_ = Stage::kParked;
  }
  arena_.slabs().seal(sealed_index);
}

void EnvPort::copy_observation(const ObservationTarget& from, const ObservationTarget& to) const {
  const std::size_t agents = static_cast<std::size_t>(slab_.shape().env.num_agents);
  std::memcpy(to.frame, from.frame, slab_.frames(0).size());
  count_copied(slab_.frames(0).size());
  if (to.measurement != nullptr)
    std::memcpy(to.measurement, from.measurement, agents * slab_.measurement(0, 0).size_bytes());
  std::memcpy(to.action_mask, from.action_mask, agents * slab_.action_mask(0, 0).size());
  std::memcpy(to.agent_active, from.agent_active, agents);
  if (to.global_state != nullptr)
    std::memcpy(to.global_state, from.global_state, slab_.global_state(0).size_bytes());
}

}  // namespace comrad::sim
