#include "rollout_buffer/shm/segment.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>

#include "tests/support/small_arena.h"

namespace comrad::shm {
namespace segment_test {

using ::testing::HasSubstr;

TEST(Segment, IsZeroedAndCannotBeResized) {
  Expected<Segment> segment = Segment::create("test", 10000);
  ASSERT_TRUE(segment) << segment.error().message;
  EXPECT_EQ(segment->size_bytes(), 10000);
  for (int index = 0; index < 10000; ++index) ASSERT_EQ(segment->data()[index], std::byte{0});
  EXPECT_NE(ftruncate(segment->descriptor(), 4096), 0) << "a peer could make us fault";
  EXPECT_NE(ftruncate(segment->descriptor(), 20000), 0);
}

TEST(Segment, BothMappingsSeeTheSameBytes) {
  Expected<Segment> mine = Segment::create("test", 4096);
  ASSERT_TRUE(mine);
  Expected<Segment> peer = Segment::adopt(dup(mine->descriptor()));
  ASSERT_TRUE(peer) << peer.error().message;
  ASSERT_EQ(peer->size_bytes(), 4096);
  mine->data()[77] = std::byte{42};
  EXPECT_EQ(peer->data()[77], std::byte{42});
}

TEST(Segment, TooLittleMemoryNamesTheNeedTheRestAndTheFlags) {
  const Expected<Segment> segment = Segment::create("test", int64_t{1} << 52);
  ASSERT_FALSE(segment);
  EXPECT_EQ(segment.error().code, ErrorCode::kNoSpace);
  for (const char* part : {"needs 4503599.6 GB", "but only", "is free", "--trajectory_slabs", "--num_workers",
                           "--num_envs_per_worker", "--rollout"})
    EXPECT_THAT(segment.error().message, HasSubstr(part));
}

TEST(Segment, FreeMemoryIsPositiveAndBelowThePhysicalMemory) {
  EXPECT_GT(free_memory_bytes(), 0);
  EXPECT_LE(free_memory_bytes(), static_cast<int64_t>(sysconf(_SC_PHYS_PAGES)) * sysconf(_SC_PAGESIZE));
}

TEST(Segment, AdoptRefusesWhatCouldShrinkUnderneath) {
  const std::byte zero{0};
  for (const int seals : {0, F_SEAL_GROW, F_SEAL_SHRINK}) {
    const Expected<Segment> segment = Segment::adopt(test::sealed_copy(&zero, 1, 4096, seals));
    ASSERT_FALSE(segment) << seals;
    EXPECT_EQ(segment.error().code, ErrorCode::kBadFormat);
  }
  EXPECT_FALSE(Segment::adopt(open("/dev/zero", O_RDWR | O_CLOEXEC)));
  EXPECT_FALSE(Segment::adopt(-1));
  EXPECT_FALSE(Segment::adopt(test::sealed_copy(&zero, 0, 0))) << "empty";
}

TEST(Segment, AdoptTakesTheDescriptorOverEvenWhenItFails) {
  const std::byte zero{0};
  const int descriptor = test::sealed_copy(&zero, 1, 4096, 0);
  ASSERT_FALSE(Segment::adopt(descriptor));
  EXPECT_EQ(fcntl(descriptor, F_GETFD), -1) << "closed, not leaked";
}

}  // namespace segment_test
}  // namespace comrad::shm
