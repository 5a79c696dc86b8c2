// What a peer of the link between hosts may send: fragments of trajectories and chunks of weights, whose numbers and
// bytes come from the input. Where a slab came whole it must be one that the learner can be given.
#include <cstring>
#include <vector>

#include "rollout_buffer/core/checksum.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/link/trajectories/slab_stream.h"
#include "rollout_buffer/link/trajectories/weights_stream.h"
#include "tests/fuzz/input.h"

namespace {

using namespace comrad;
using namespace comrad::fuzz;

constexpr int64_t kWeightsCapacity = 3 << 20;

/// A fragment as the cutter makes it, with some of its numbers changed.
void feed_fragments(Input& input, const SlabOffsets& offsets, std::vector<std::byte>& memory) {
  std::vector<std::byte> source(static_cast<std::size_t>(offsets.slab_bytes));
  const SlabView from(offsets, source.data()), to(offsets, memory.data());
  for (int step = 0; step < offsets.shape.rollout_steps; ++step) {
    from.final_index(step) = input.number<int8_t>() % 4;
    from.truncated(step) = input.number<uint8_t>() & 1;
    for (int agent = 0; agent < 2; ++agent)
      for (int32_t& choice : from.action(step, agent)) choice = input.number<int8_t>() % 8;
  }
  shm::SlabHeader header{};
  header.length = input.number<uint8_t>() % 8;
  link::SlabCutter cutter(offsets);
  cutter.begin(from, header, {});
  link::SlabAssembler assembler(offsets);
  assembler.begin(to);
  while (!input.is_empty()) {
    dds::TrajectoryFragment fragment = cutter.cut(input.number<uint8_t>() % cutter.fragment_count());
    const uint8_t changes = input.number<uint8_t>();
    if (changes & 1) fragment.fragment_index = input.number<uint32_t>();
    if (changes & 2) fragment.fragment_count = input.number<uint32_t>();
    if (changes & 4) fragment.offset_bytes = input.number<uint64_t>();
    if (changes & 8) fragment.raw_bytes = input.number<uint32_t>();
    if (changes & 16) fragment.length = input.number<uint32_t>();
    if (changes & 32) fragment.payload = input.bytes(input.number<uint16_t>());
    const Expected<bool> taken = assembler.take(fragment);
    if (!taken) require(!taken.error().message.empty());
    if (!taken || *taken) assembler.begin(to);
    if (taken && *taken) {
      require(fragment.length >= 1 && fragment.length <= 4);
      for (int step = 0; step < static_cast<int>(fragment.length); ++step)
        require(to.final_index(step) >= -1 && to.final_index(step) < offsets.shape.final_capacity &&
                to.action(step, 0)[0] >= 0 && to.action(step, 0)[0] < 3);
    }
  }
}

void feed_weights(Input& input) {
  link::WeightsAssembler assembler(kWeightsCapacity);
  const std::vector<std::byte> zeros(dds::kChunkBytes);
  while (!input.is_empty()) {
    dds::WeightsChunk chunk;
    chunk.version = input.number<uint8_t>() & 3;
    chunk.bytes = input.number<uint32_t>() >> (input.number<uint8_t>() & 31);
    chunk.chunk_index = input.number<uint8_t>() & 7;
    chunk.chunk_count = input.number<uint8_t>() & 7;
    if (input.number<uint8_t>() & 1)
      chunk.bf16_count = input.number<uint32_t>() >> (input.number<uint8_t>() & 31);
    chunk.payload =
        std::span(zeros).first(std::min<std::size_t>(input.number<uint32_t>() & 0x1FFFFF, zeros.size()));
    if (input.number<uint8_t>() & 1)
      chunk.checksum = checksum64(std::span(zeros).first(std::min<std::size_t>(chunk.bytes, zeros.size())));
    const Expected<bool> taken = assembler.take(chunk);
    if (taken && *taken) require(static_cast<int64_t>(assembler.weights().size()) <= kWeightsCapacity);
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, std::size_t size) {
  static const SlabOffsets kOffsets(small_shape());
  // Its own block size: one byte beyond it and the address sanitizer speaks.
  static std::vector<std::byte> memory(static_cast<std::size_t>(kOffsets.slab_bytes));
  if (size == 0 || size > 1 << 15) return 0;
  Input input(data, size);
  if (input.number<uint8_t>() & 1)
    feed_fragments(input, kOffsets, memory);
  else
    feed_weights(input);
  return 0;
}
