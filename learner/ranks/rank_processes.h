// The processes of a run's learners: the first becomes several before it does anything else. They live and die together:
// where one ends, the first gives up and is started again by the supervisor, from the last checkpoint; where the first
// ends, the others are killed. Stage: start.
#pragma once

#include <sys/types.h>

#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::learn {

class RankProcesses {
 public:
  /// Returns in each of `count` processes, with another rank(); the caller is rank 0. What is mapped and open stays so in
  /// all of them. Call while this process has one thread. Errors: kSystem.
  static Expected<RankProcesses> fork(int count);

  RankProcesses(RankProcesses&& other) noexcept;
  RankProcesses& operator=(RankProcesses&&) = delete;
  /// In the first: requests the others to stop, and kills those that do not.
  ~RankProcesses();

  int rank() const { return rank_; }
  int count() const { return count_; }
  /// A file without a name that all have open, for RankGroup.
  int rendezvous() const { return rendezvous_; }
  /// In the first: whether the others live. Errors: kPeerLost, naming the one that ended and how.
  Status check();
  /// Requests the others to stop.
  void stop();

 private:
  RankProcesses() = default;
  int rank_ = 0, count_ = 1;
  int rendezvous_ = -1;
  std::vector<pid_t> others_;  ///< by rank - 1; 0: has ended
};

}  // namespace comrad::learn
