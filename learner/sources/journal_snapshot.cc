#include "learner/sources/journal_snapshot.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <ctime>
#include <string>

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/shm/journal.h"
#include "rollout_buffer/shm/step_slots.h"

namespace comrad::learn {
namespace {

constexpr int64_t kHeaderFields = 5;

uint64_t next_rollout_of(const shm::Arena& arena, int env_index) {
  return std::atomic_ref<uint64_t>(arena.journals().header(env_index).rollout_index)
      .load(std::memory_order_acquire);
}

}  // namespace

Expected<JournalSnapshot> JournalSnapshot::capture(const shm::Arena& arena, uint64_t next_rollout,
                                                   int timeout_ms) {
  const shm::ArenaShape& shape = arena.shape();
  const EnvShape& env = shape.trajectory.env;
  JournalSnapshot snapshot;
  snapshot.next_rollout = next_rollout;
  snapshot.action_bytes = int64_t{env.num_agents} * env.head_count;
  snapshot.state_floats = int64_t{env.num_agents} * shape.trajectory.recurrent_state_count;
  const int64_t deadline_ns = monotonic_ns() + int64_t{timeout_ms} * 1'000'000;
  for (int index = 0; index < shape.env_count(); ++index) {
    // The slab is sealed before or after the journal is brought up to date; either way it happens at once.
    while (next_rollout_of(arena, index) != next_rollout) {
      if (monotonic_ns() > deadline_ns)
        return Error{
            ErrorCode::kTimeout,
            fmt::format("environment {} did not reach rollout {} in its journal", index, next_rollout)};
      timespec pause{.tv_sec = 0, .tv_nsec = 200'000};
      nanosleep(&pause, nullptr);
    }
    const shm::JournalHeader& journal = arena.journals().header(index);
    if (static_cast<int64_t>(journal.length) > shape.journal_steps)
      return Error{ErrorCode::kUnsupported,
                   fmt::format("the journal of environment {} overflowed ({} decisions since reset, room for "
                               "{}); no exact resume",
                               index, journal.length, shape.journal_steps)};
    for (const uint64_t field : {journal.episode_seed, journal.episode_id, journal.step_id,
                                 journal.rollout_index, uint64_t{journal.length}})
      snapshot.header.push_back(static_cast<int64_t>(field));
    for (uint32_t step = 0; step < journal.length; ++step) {
      const auto action = arena.journals().action(index, static_cast<int>(step));
      snapshot.action.insert(snapshot.action.end(), action.begin(), action.end());
    }
    for (const uint64_t parity : {0, 1}) {
      const auto state = arena.step_slots().recurrent(index, parity);
      snapshot.recurrent.insert(snapshot.recurrent.end(), state.begin(), state.end());
    }
  }
  return snapshot;
}

void JournalSnapshot::save(StateDict& state) const {
  const int64_t env_count = static_cast<int64_t>(header.size()) / kHeaderFields;
  state.put("journal/next_rollout", static_cast<int64_t>(next_rollout));
  state.put("journal/action_bytes", action_bytes);
  state.put("journal/header", torch::tensor(header, torch::kInt64).view({env_count, kHeaderFields}));
  torch::Tensor actions = torch::empty({static_cast<int64_t>(action.size())}, torch::kUInt8);
  if (!action.empty()) std::memcpy(actions.data_ptr(), action.data(), action.size());
  state.put("journal/action", actions);
  torch::Tensor states = torch::empty({env_count, 2, state_floats}, torch::kFloat32);
  if (!recurrent.empty()) std::memcpy(states.data_ptr(), recurrent.data(), recurrent.size() * sizeof(float));
  state.put("journal/recurrent", states);
}

Expected<JournalSnapshot> JournalSnapshot::load(const StateDict& state) {
  JournalSnapshot snapshot;
  COMRAD_TRY_ASSIGN(const int64_t next_rollout, state.integer("journal/next_rollout"));
  COMRAD_TRY_ASSIGN(snapshot.action_bytes, state.integer("journal/action_bytes"));
  COMRAD_TRY_ASSIGN(const torch::Tensor header, state.tensor("journal/header"));
  COMRAD_TRY_ASSIGN(const torch::Tensor action, state.tensor("journal/action"));
  COMRAD_TRY_ASSIGN(const torch::Tensor recurrent, state.tensor("journal/recurrent"));
  const bool fits = header.dim() == 2 && header.size(1) == kHeaderFields &&
                    header.scalar_type() == torch::kInt64 && action.dim() == 1 &&
                    action.scalar_type() == torch::kUInt8 && recurrent.dim() == 3 &&
                    recurrent.size(0) == header.size(0) && recurrent.size(1) == 2 &&
                    recurrent.scalar_type() == torch::kFloat32 && snapshot.action_bytes > 0;
  if (!fits)
    return Error{ErrorCode::kBadFormat, "the checkpoint's journal has another shape than this build writes"};
  snapshot.next_rollout = static_cast<uint64_t>(next_rollout);
  snapshot.state_floats = recurrent.size(2);
  const torch::Tensor dense_header = header.contiguous(), dense_action = action.contiguous(),
                      dense_state = recurrent.contiguous();
  snapshot.header.assign(dense_header.data_ptr<int64_t>(), dense_header.data_ptr<int64_t>() + header.numel());
  snapshot.action.assign(dense_action.data_ptr<uint8_t>(), dense_action.data_ptr<uint8_t>() + action.numel());
  snapshot.recurrent.assign(dense_state.data_ptr<float>(), dense_state.data_ptr<float>() + recurrent.numel());
  return snapshot;
}

Status JournalSnapshot::restore(const shm::Arena& arena) const {
  const shm::ArenaShape& shape = arena.shape();
  const EnvShape& env = shape.trajectory.env;
  const int64_t env_count = static_cast<int64_t>(header.size()) / kHeaderFields;
  if (env_count != shape.env_count() || action_bytes != int64_t{env.num_agents} * env.head_count ||
      state_floats != int64_t{env.num_agents} * shape.trajectory.recurrent_state_count)
    return Error{ErrorCode::kBadFormat,
                 fmt::format("the checkpoint holds {} environments with joint actions of {} bytes, this run "
                             "has {} with {}; a deterministic run resumes with the same --num_workers, "
                             "--num_envs_per_worker, --num_agents and model",
                             env_count, action_bytes, shape.env_count(), env.num_agents * env.head_count)};
  std::size_t read = 0;
  for (int64_t index = 0; index < env_count; ++index) {
    const int64_t* field = header.data() + index * kHeaderFields;
    const int64_t length = field[4];
    if (length < 0 || length > shape.journal_steps ||
        read + static_cast<std::size_t>(length * action_bytes) > action.size())
      return Error{
          ErrorCode::kBadFormat,
          fmt::format("the checkpoint's journal of environment {} has {} decisions; this run has room for {}",
                      index, length, shape.journal_steps)};
    const int env_index = static_cast<int>(index);
    shm::JournalHeader& journal = arena.journals().header(env_index);
    journal.episode_seed = static_cast<uint64_t>(field[0]);
    journal.episode_id = static_cast<uint64_t>(field[1]);
    journal.step_id = static_cast<uint64_t>(field[2]);
    journal.rollout_index = static_cast<uint64_t>(field[3]);
    journal.length = static_cast<uint32_t>(length);
    for (int64_t step = 0; step < length; ++step) {
      const auto target = arena.journals().action(env_index, static_cast<int>(step));
      std::copy_n(action.begin() + static_cast<std::ptrdiff_t>(read), action_bytes, target.begin());
      read += static_cast<std::size_t>(action_bytes);
    }
    for (int64_t parity = 0; parity < 2; ++parity) {
      const auto state = arena.step_slots().recurrent(env_index, static_cast<uint64_t>(parity));
      std::copy_n(recurrent.begin() + (index * 2 + parity) * state_floats, state_floats, state.begin());
    }
    journal.is_resume = 1;
  }
  return {};
}

}  // namespace comrad::learn
