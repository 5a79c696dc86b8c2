#include "rollout_buffer/link/session/remote_workers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "rollout_buffer/shm/accounts.h"
#include "rollout_buffer/shm/remote_worker_slot.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "tests/support/small_arena.h"

namespace comrad::link {
namespace remote_workers_test {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

class RemoteWorkersTest : public ::testing::Test {
 protected:
  static shm::Arena make_arena() {
    shm::ArenaShape shape = test::small_arena_shape();
    shape.sim_worker_count = 4;
    shape.remote_worker_count = 3;
    auto arena = shm::Arena::create(shape, 7);
    EXPECT_TRUE(arena) << arena.error().message;
    return std::move(*arena);
  }
  /// As a receiver does with a rollout that its host calls `theirs`. False where it was sealed before.
  bool seal(RemoteWorkers& places, int env, uint64_t theirs) {
    const uint64_t ours = places.rollout_of(env, theirs);
    if (places.ahead(env, ours) < 0) return false;
    const uint32_t slab = *arena_.slabs().acquire(env / 4);
    EXPECT_EQ(
        places.seal(env, slab, {.rollout_index = ours, .length = 8, .layout_id = 1, .first_episode = {}}),
        16u);
    rollouts_.push_back(arena_.slabs().header(static_cast<int>(slab)).rollout_index);
    return true;
  }

  const shm::Arena arena_ = make_arena();
  std::vector<uint64_t> rollouts_;
};

TEST_F(RemoteWorkersTest, AReceiverThatIsRestartedRestoresWhichHostPlaysWhere) {
  RemoteWorkers places(arena_, 1, 3);
  EXPECT_EQ(places.free_count(), 3);
  EXPECT_THAT(places.take(11, 1), ElementsAre(1));
  EXPECT_THAT(places.take(22, 2), ElementsAre(2, 3));
  EXPECT_EQ(places.free_count(), 0);
  const RemoteWorkers successor(arena_, 1, 3);
  EXPECT_THAT(successor.of(22), ElementsAre(2, 3));
  places.free(11);
  EXPECT_THAT(successor.of(11), IsEmpty());
  EXPECT_THAT(successor.of(0), ElementsAre(1));
}

TEST_F(RemoteWorkersTest, RolloutsCountOnOverHostsWithOneLeftOutBetweenTwo) {
  RemoteWorkers places(arena_, 1, 3);
  places.take(11, 1);
  for (const uint64_t theirs : {40, 41}) EXPECT_TRUE(seal(places, 4, theirs));
  EXPECT_FALSE(seal(places, 4, 41)) << "sealed before";
  RemoteWorkers successor(arena_, 1, 3);
  EXPECT_FALSE(seal(successor, 4, 40)) << "by its predecessor";
  EXPECT_TRUE(seal(successor, 4, 42));
  EXPECT_EQ(places.sealed_for(11), 3u * 16);
  places.free(11);
  places.take(22, 1);
  EXPECT_EQ(places.sealed_for(22), 0u);
  EXPECT_TRUE(seal(places, 4, 0));
  EXPECT_EQ(places.sealed_for(22), 16u);
  EXPECT_THAT(rollouts_, ElementsAre(1, 2, 3, 5));
}

}  // namespace remote_workers_test
}  // namespace comrad::link
