#include "rollout_buffer/link/seats.h"

#include <algorithm>

namespace comrad::link {

// Nothing is played anew from a guest's journal, so it says: in_use, that the place is taken; episode_seed, by whom; episode_id,
// how many steps were sealed for others before; length 1, that step_id is the difference of its rollout indices to ours.

Seats::Seats(const shm::Arena& arena, int first_worker, int worker_count)
    : arena_(arena), first_worker_(first_worker), owner_(static_cast<std::size_t>(worker_count)) {
  for (std::size_t place = 0; place < owner_.size(); ++place) {
    const int worker = first_worker_ + static_cast<int>(place);
    const shm::JournalHeader& journal = arena_.journal(worker * arena_.shape().envs_per_worker);
    if (journal.in_use != 0) owner_[place] = journal.episode_seed;
  }
}

int Seats::free_count() const { return static_cast<int>(std::ranges::count(owner_, uint64_t{0})); }

std::vector<int> Seats::of(uint64_t feeder_id) const {
  std::vector<int> workers;
  for (std::size_t place = 0; place < owner_.size(); ++place)
    if (owner_[place] == feeder_id) workers.push_back(first_worker_ + static_cast<int>(place));
  return workers;
}

std::vector<int> Seats::take(uint64_t feeder_id, int count) {
  for (int taken = 0; taken < count; ++taken) *std::ranges::find(owner_, uint64_t{0}) = feeder_id;
  const std::vector<int> workers = of(feeder_id);
  const int envs = arena_.shape().envs_per_worker;
  for (const int worker : workers)
    for (int env = worker * envs; env < (worker + 1) * envs; ++env) {
      shm::JournalHeader& journal = arena_.journal(env);
      journal.episode_seed = feeder_id;
      journal.episode_id = arena_.env_account(env).sealed.load();
      journal.length = 0;
      journal.in_use = 1;
    }
  return workers;
}

void Seats::free(uint64_t feeder_id) {
  const int envs = arena_.shape().envs_per_worker;
  for (const int worker : of(feeder_id))
    for (int env = worker * envs; env < (worker + 1) * envs; ++env) arena_.journal(env).in_use = 0;
  std::ranges::replace(owner_, feeder_id, uint64_t{0});
}

uint64_t Seats::rollout_of(int env, uint64_t theirs) {
  shm::JournalHeader& journal = arena_.journal(env);
  if (journal.length == 0) {
    journal.step_id = journal.rollout_index + 1 - theirs;
    ++journal.rollout_index;
    journal.length = 1;
  }
  return theirs + journal.step_id;
}

uint64_t Seats::sealed_for(uint64_t feeder_id) const {
  const int envs = arena_.shape().envs_per_worker;
  uint64_t steps = 0;
  for (const int worker : of(feeder_id))
    for (int env = worker * envs; env < (worker + 1) * envs; ++env)
      steps += arena_.env_account(env).sealed.load() - arena_.journal(env).episode_id;
  return steps * static_cast<uint64_t>(arena_.shape().trajectory.env.num_agents);
}

}  // namespace comrad::link
