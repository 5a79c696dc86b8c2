#include "rollout_buffer/link/trajectories/weights_stream.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>

#include "rollout_buffer/core/checksum.h"
#include "rollout_buffer/core/rng.h"

namespace comrad::link {
namespace weights_stream_test {

using ::testing::HasSubstr;

constexpr int64_t kCapacity = 8 << 20;

std::vector<std::byte> weights_of(uint64_t seed, std::size_t bytes) {
  std::vector<std::byte> weights(bytes);
  Rng rng(seed);
  for (std::byte& byte : weights) byte = static_cast<std::byte>(rng.next());
  return weights;
}

dds::WeightsChunk chunk_of(const std::vector<std::byte>& weights, PolicyVersion version, uint32_t index) {
  return weights_chunk(weights, version, checksum64(weights), index);
}

TEST(WeightsStream, ChunksInAnyOrderMakeTheVersion) {
  const std::vector<std::byte> weights = weights_of(1, 2 * dds::kChunkBytes + 1000);
  WeightsAssembler assembler(kCapacity);
  for (const uint32_t index : {2u, 0u, 0u}) {
    const Expected<bool> whole = assembler.take(chunk_of(weights, 7, index));
    ASSERT_TRUE(whole) << whole.error().message;
    EXPECT_FALSE(*whole);
  }
  const Expected<bool> whole = assembler.take(chunk_of(weights, 7, 1));
  ASSERT_TRUE(whole && *whole);
  EXPECT_EQ(assembler.version(), 7u);
  EXPECT_TRUE(std::ranges::equal(assembler.weights(), weights));
}

TEST(WeightsStream, ANewerVersionThatOvertakesAnOlderOnesLastChunksStillCompletes) {
  const std::vector<std::byte> older = weights_of(1, 3 * dds::kChunkBytes),
                               newer = weights_of(2, 3 * dds::kChunkBytes);
  WeightsAssembler assembler(kCapacity);
  ASSERT_TRUE(assembler.take(chunk_of(older, 7, 0)));
  ASSERT_TRUE(assembler.take(chunk_of(newer, 8, 0)));
  ASSERT_TRUE(assembler.take(chunk_of(older, 7, 1)));
  ASSERT_TRUE(assembler.take(chunk_of(newer, 8, 1)));
  const Expected<bool> whole = assembler.take(chunk_of(newer, 8, 2));
  ASSERT_TRUE(whole && *whole);
  EXPECT_EQ(assembler.version(), 8u);
  EXPECT_TRUE(std::ranges::equal(assembler.weights(), newer));
}

TEST(WeightsStream, NoWeightsAreAVersionToo) {
  const std::vector<std::byte> none;
  WeightsAssembler assembler(0);
  const Expected<bool> whole = assembler.take(chunk_of(none, 1, 0));
  ASSERT_TRUE(whole && *whole);
  EXPECT_TRUE(assembler.weights().empty());
}

TEST(WeightsStream, AFlippedBitIsSeenByTheChecksum) {
  std::vector<std::byte> weights = weights_of(1, 5000);
  const uint64_t checksum = checksum64(weights);
  weights[4000] ^= std::byte{4};
  WeightsAssembler assembler(kCapacity);
  const Expected<bool> damaged = assembler.take(weights_chunk(weights, 3, checksum, 0));
  ASSERT_FALSE(damaged);
  EXPECT_THAT(damaged.error().message, HasSubstr("version 3"));
}

TEST(WeightsStream, AChunkThatIsNoneOfTheWeightsIsRefused) {
  const std::vector<std::byte> weights = weights_of(1, dds::kChunkBytes + 10);
  const auto refused = [&](auto bend) {
    WeightsAssembler assembler(kCapacity);
    dds::WeightsChunk chunk = chunk_of(weights, 1, 1);
    bend(chunk);
    return !assembler.take(chunk);
  };
  EXPECT_FALSE(refused([](dds::WeightsChunk&) {}));
  EXPECT_TRUE(refused([](dds::WeightsChunk& chunk) { chunk.chunk_index = 2; }));
  EXPECT_TRUE(refused([](dds::WeightsChunk& chunk) { chunk.chunk_index = ~0u; }));
  EXPECT_TRUE(refused([](dds::WeightsChunk& chunk) { chunk.chunk_count = 3; }));
  EXPECT_TRUE(refused([](dds::WeightsChunk& chunk) { chunk.bytes = ~uint64_t{0}; }));
  EXPECT_TRUE(refused([](dds::WeightsChunk& chunk) { chunk.bytes = kCapacity + 1; }));
  EXPECT_TRUE(refused([](dds::WeightsChunk& chunk) { chunk.bytes -= 1; }));
  EXPECT_TRUE(refused([](dds::WeightsChunk& chunk) { chunk.payload = chunk.payload.first(9); }));
  EXPECT_TRUE(refused([](dds::WeightsChunk& chunk) { chunk.payload = {}; }));
}

TEST(WeightsStream, NarrowWeightsAreWideOnceTheyAreWhole) {
  const std::vector<float> parameters = {0.1f, -3};
  const double statistic = 0.1;
  std::vector<std::byte> weights(16), narrow;
  std::memcpy(weights.data(), parameters.data(), 8);
  std::memcpy(weights.data() + 8, &statistic, 8);
  ASSERT_TRUE(narrow_weights(weights, 2, narrow));
  const auto taken = [&narrow](uint64_t bf16_count, int64_t capacity, std::vector<std::byte>& wide) {
    WeightsAssembler assembler(capacity);
    const Expected<bool> whole = assembler.take(weights_chunk(narrow, 1, checksum64(narrow), 0, bf16_count));
    if (whole && *whole) wide.assign(assembler.weights().begin(), assembler.weights().end());
    return whole && *whole;
  };
  std::vector<std::byte> wide, expected;
  ASSERT_TRUE(taken(2, 16, wide));
  ASSERT_TRUE(widen_weights(narrow, 2, expected));
  EXPECT_EQ(wide, expected);
  EXPECT_FALSE(taken(2, 15, wide));  // wide they have no room
  EXPECT_FALSE(taken(3, 16, wide));  // no whole number of statistics is left
  EXPECT_FALSE(taken(5, 16, wide));  // more parameters than bytes
  EXPECT_FALSE(taken(~uint64_t{0}, 16, wide));
  ASSERT_TRUE(taken(0, 8, wide));
  EXPECT_EQ(wide, narrow);  // of which the chunk does not say that they are narrow
}

TEST(WeightsStream, APublishersNextVersionMayBeWideAfterANarrowOne) {
  const std::vector<std::byte> weights = weights_of(1, 4000);
  std::vector<std::byte> narrow;
  ASSERT_TRUE(narrow_weights(weights, 1000, narrow));
  WeightsAssembler assembler(kCapacity);
  ASSERT_TRUE(assembler.take(weights_chunk(narrow, 1, checksum64(narrow), 0, 1000)));
  EXPECT_EQ(assembler.weights().size(), weights.size());
  ASSERT_TRUE(assembler.take(chunk_of(weights, 2, 0)));
  EXPECT_TRUE(std::ranges::equal(assembler.weights(), weights));
}

}  // namespace weights_stream_test
}  // namespace comrad::link
