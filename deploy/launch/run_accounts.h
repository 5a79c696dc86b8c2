// Where every agent decision of a run went, to the decision, also when workers are killed. Simulators count what they
// make and seal, the learner what it takes and trains on, in words that stay behind in the arena when they die
// (shm::EnvAccount); this class looks at them when a worker has ended. What other hosts play counts as made here when it is
// delivered; on such a host its trajectory sender takes the learner's place.
#pragma once

#include <cstdint>
#include <string>

#include "rollout_buffer/shm/arena.h"

namespace comrad::deploy {

/// Agent decisions of this process's life:
///
///   made = trained + lost() + waiting
///
/// What the run has learned from is what it had when this process began, + trained - forgotten.
struct DecisionAccounts {
  uint64_t made = 0;                  ///< by simulators
  uint64_t trained = 0;               ///< counted by learners; where another host learns: delivered there
  uint64_t forgotten = 0;             ///< of them, by learners that went back to a checkpoint
  uint64_t lost_with_simulators = 0;  ///< in trajectories that dead simulators left half full
  uint64_t lost_with_learners = 0;    ///< taken by learners that died before they trained on them
  uint64_t lost_in_restarts = 0;      ///< lock step: of all workers, when one had died
  uint64_t lost_on_the_way = 0;       ///< sent to a learner's host that began anew: learned there or not
  uint64_t left = 0;                  ///< at the end of the run, anywhere
  uint64_t waiting = 0;               ///< in the arena and in the learner; 0 at the end

  uint64_t lost_with_the_dead() const {
    return lost_with_simulators + lost_with_learners + lost_in_restarts + lost_on_the_way;
  }
  uint64_t lost() const { return lost_with_the_dead() + left; }
  /// "of 1000 decisions made 900 were trained on, 60 lost with simulators, 40 left at the end".
  std::string text(const char* done = "were trained on") const;
};

/// Threads: the supervisor's. `trained` is always the learners' total since this object was made.
class RunAccounts {
 public:
  /// From now on `arena` counts, whose counts begin at 0 (null: none). What lay in the one before is lost.
  void use(const shm::Arena* arena, uint64_t trained);
  /// A learner has ended and is reaped, reclaim_learner() was called. Gives what was lost with it.
  uint64_t learner_ended(uint64_t trained);
  void forgot(uint64_t decisions) { sums_.forgotten += decisions; }
  /// All workers have ended: what is still there stays behind.
  void close(uint64_t trained);
  DecisionAccounts read(uint64_t trained) const;
  /// What does not add up, which would be a fault of this program; empty while all is well.
  const std::string& fault() const { return fault_; }

 private:
  const shm::Arena* arena_ = nullptr;
  DecisionAccounts sums_;            // of earlier arenas; trained and waiting are not kept
  uint64_t trained_before_ = 0;      // when this arena came
  uint64_t lost_with_learners_ = 0;  // in this arena
  std::string fault_;
};

}  // namespace comrad::deploy
