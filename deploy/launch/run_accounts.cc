#include "deploy/launch/run_accounts.h"

#include <spdlog/fmt/fmt.h>

#include <utility>
#include <vector>

#include "rollout_buffer/core/text.h"
#include "rollout_buffer/shm/accounts.h"

namespace comrad::deploy {

std::string DecisionAccounts::text(const char* done) const {
  std::vector<std::string> parts;
  const auto add = [&parts](uint64_t count, const char* words) {
    if (count > 0) parts.push_back(fmt::format("{} {}", count, words));
  };
  add(lost_with_simulators, "lost with simulators");
  add(lost_with_learners, "lost with the learner");
  add(lost_in_restarts, "lost when all workers started again");
  add(lost_on_the_way, "lost on the way to a run that began anew");
  add(waiting, "wait");
  add(left, "left at the end");
  std::string text = fmt::format("of {} decisions made {} {}", made, trained, done);
  if (forgotten > 0) text += fmt::format(" ({} of them forgotten)", forgotten);
  return parts.empty() ? text : text + ", " + joined(parts);
}

void RunAccounts::use(const shm::Arena* arena, uint64_t trained) {
  if (arena_ != nullptr) {
    const DecisionAccounts now = read(trained);
    sums_.made = now.made;
    sums_.lost_with_simulators = now.lost_with_simulators;
    sums_.lost_with_learners = now.lost_with_learners;
    sums_.lost_on_the_way = now.lost_on_the_way;
    sums_.lost_in_restarts += now.waiting;
  }
  arena_ = arena;
  trained_before_ = trained;
  lost_with_learners_ = 0;
}

uint64_t RunAccounts::learner_ended(uint64_t trained) {
  if (arena_ == nullptr) return 0;
  const uint64_t taken = arena_->accounts().counts().taken;
  const uint64_t known = trained - trained_before_ + lost_with_learners_;
  if (known > taken) {
    fault_ = fmt::format("the accounts do not add up: the learner counted {} decisions, the arena gave it {}",
                         known, taken);
    return 0;
  }
  lost_with_learners_ += taken - known;
  return taken - known;
}

void RunAccounts::close(uint64_t trained) {
  if (arena_ == nullptr) return;
  const uint64_t waiting = read(trained).waiting;
  use(nullptr, trained);
  sums_.lost_in_restarts -= waiting;
  sums_.left += waiting;
}

DecisionAccounts RunAccounts::read(uint64_t trained) const {
  DecisionAccounts accounts = sums_;
  accounts.trained = trained;
  if (arena_ == nullptr) return accounts;
  const shm::DecisionCounts counts = arena_->accounts().counts();
  accounts.made += counts.made;
  accounts.lost_with_simulators += counts.lost;
  accounts.lost_with_learners += lost_with_learners_;
  const uint64_t on_the_way = arena_->control().decisions_lost_on_the_way.load(std::memory_order_acquire);
  accounts.lost_on_the_way += on_the_way;
  const uint64_t gone = trained - trained_before_ + counts.lost + lost_with_learners_ + on_the_way;
  accounts.waiting = counts.made > gone ? counts.made - gone : 0;
  return accounts;
}

}  // namespace comrad::deploy
