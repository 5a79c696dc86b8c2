#include "rollout_buffer/core/checksum.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <vector>

#include "rollout_buffer/core/rng.h"

namespace comrad {
namespace checksum_test {

std::vector<std::byte> noise(std::size_t count) {
  Rng rng(uint64_t{count});
  std::vector<std::byte> bytes(count);
  for (std::byte& byte : bytes) byte = static_cast<std::byte>(rng.next());
  return bytes;
}

// Of libxxhash's own test vectors: the files and peers that hold a checksum were written with these.
TEST(Checksum64, IsXxh3) { EXPECT_EQ(checksum64({}), 0x2D06800538D394C2ull); }

TEST(Checksum64, EverySingleBitCounts) {
  for (const std::size_t count : {1u, 7u, 8u, 31u, 32u, 33u, 64u, 100u}) {
    std::vector<std::byte> bytes = noise(count);
    const uint64_t original = checksum64(bytes);
    for (std::size_t bit = 0; bit < 8 * count; ++bit) {
      bytes[bit / 8] ^= std::byte{1} << (bit % 8);
      ASSERT_NE(checksum64(bytes), original) << count << " bytes, bit " << bit;
      bytes[bit / 8] ^= std::byte{1} << (bit % 8);
    }
    EXPECT_EQ(checksum64(bytes), original);
  }
}

TEST(Checksum64, LengthAndOrderCount) {
  std::set<uint64_t> seen;
  for (std::size_t count = 0; count < 200; ++count) seen.insert(checksum64(std::vector<std::byte>(count)));
  EXPECT_EQ(seen.size(), 200u) << "zeros of different lengths differ";

  std::vector<std::byte> bytes = noise(128);
  const uint64_t original = checksum64(bytes);
  for (const std::size_t distance : {8u, 16u, 32u, 64u}) {  // swapped words of one lane and of two
    std::vector<std::byte> swapped = bytes;
    std::swap_ranges(swapped.begin(), swapped.begin() + 8,
                     swapped.begin() + static_cast<std::ptrdiff_t>(distance));
    EXPECT_NE(checksum64(swapped), original) << distance;
  }
}

}  // namespace checksum_test
}  // namespace comrad
