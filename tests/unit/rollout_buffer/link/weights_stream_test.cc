#include "rollout_buffer/link/weights_stream.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "rollout_buffer/core/checksum.h"
#include "rollout_buffer/core/rng.h"

namespace comrad::link {
namespace {

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

}  // namespace
}  // namespace comrad::link
