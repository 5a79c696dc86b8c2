// Several learners in one process: a thread for each. For tests of what they do together.
#pragma once

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/mman.h>
#include <unistd.h>

#include <functional>
#include <thread>
#include <vector>

#include "learner/ranks/rank_group.h"

namespace comrad::test {

/// Calls work(ranks) in a thread of each rank.
inline void in_ranks(int count, const std::function<void(learn::RankGroup&)>& work) {
  (void)signal(SIGPIPE,
               SIG_IGN);  // as in every program (prepare_process): Gloo writes to ranks that have left
  const int rendezvous = memfd_create("ranks", MFD_CLOEXEC);
  ASSERT_GE(rendezvous, 0);
  std::vector<std::thread> threads;
  for (int rank = 0; rank < count; ++rank)
    threads.emplace_back([&, rank] {
      auto ranks = learn::RankGroup::join(
          {.rank = rank, .count = count, .rendezvous = rendezvous, .join_timeout_s = 20}, {});
      ASSERT_TRUE(ranks) << ranks.error().message;
      work(**ranks);
    });
  for (std::thread& thread : threads) thread.join();
  close(rendezvous);
}

}  // namespace comrad::test
