#include "rollout_buffer/link/trajectories/weights_stream.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <string>

#include "rollout_buffer/core/bfloat16.h"
#include "rollout_buffer/core/checksum.h"

namespace comrad::link {
namespace {

uint64_t chunks_of(uint64_t bytes) {
  return std::max<uint64_t>(1, (bytes + dds::kChunkBytes - 1) / dds::kChunkBytes);
}

uint16_t bf16_of(float value) {
  if (std::isnan(value))  // of which rounding could make an infinity
    return static_cast<uint16_t>(std::bit_cast<uint32_t>(value) >> 16 | 0x40);
  return rounded(value);
}

/// `count` numbers From at `in` become numbers To at `out`; neither need be aligned.
template <typename From, typename To, typename Convert>
void convert(const std::byte* in, std::byte* out, std::size_t count, const Convert& made_of) {
  for (std::size_t i = 0; i < count; ++i) {
    From from;
    std::memcpy(&from, in + i * sizeof from, sizeof from);
    const To to = made_of(from);
    std::memcpy(out + i * sizeof to, &to, sizeof to);
  }
}

/// Parameters, and the statistics behind them, as numbers of other types. Errors: kBadFormat.
template <typename FromParameter, typename ToParameter, typename FromStatistic, typename ToStatistic,
          typename Convert>
Status convert_weights(std::span<const std::byte> in, uint64_t parameter_count, const Convert& made_of,
                       std::vector<std::byte>& out) {
  if (parameter_count > in.size() / sizeof(FromParameter) ||
      (in.size() - parameter_count * sizeof(FromParameter)) % sizeof(FromStatistic) != 0)
    return Error{ErrorCode::kBadFormat,
                 fmt::format("{} bytes are no weights with {} parameters", in.size(), parameter_count)};
  const std::size_t from = parameter_count * sizeof(FromParameter),
                    to = parameter_count * sizeof(ToParameter),
                    statistics = (in.size() - from) / sizeof(FromStatistic);
  out.resize(to + statistics * sizeof(ToStatistic));
  convert<FromParameter, ToParameter>(in.data(), out.data(), parameter_count, made_of);
  convert<FromStatistic, ToStatistic>(in.data() + from, out.data() + to, statistics,
                                      [](FromStatistic value) { return static_cast<ToStatistic>(value); });
  return {};
}

}  // namespace

Status narrow_weights(std::span<const std::byte> weights, uint64_t parameter_count,
                      std::vector<std::byte>& narrow) {
  return convert_weights<float, uint16_t, double, float>(weights, parameter_count, bf16_of, narrow);
}

Status widen_weights(std::span<const std::byte> narrow, uint64_t parameter_count,
                     std::vector<std::byte>& weights) {
  return convert_weights<uint16_t, float, float, double>(narrow, parameter_count, widened, weights);
}

dds::WeightsChunk weights_chunk(std::span<const std::byte> weights, PolicyVersion version, uint64_t checksum,
                                uint32_t chunk_index, uint64_t bf16_count) {
  const std::size_t begin = std::size_t{chunk_index} * dds::kChunkBytes;
  return {.bytes = weights.size(),
          .checksum = checksum,
          .bf16_count = bf16_count,
          .chunk_index = chunk_index,
          .chunk_count = static_cast<uint32_t>(chunks_of(weights.size())),
          .version = version,
          .payload = weights.subspan(begin, std::min(dds::kChunkBytes, weights.size() - begin))};
}

Status send_weights(dds::LinkBus& bus, std::span<const std::byte> weights, PolicyVersion version,
                    uint64_t bf16_count) {
  const uint64_t checksum = checksum64(weights);
  for (uint32_t index = 0; index < chunks_of(weights.size()); ++index)
    COMRAD_TRY(bus.write(weights_chunk(weights, version, checksum, index, bf16_count)));
  return {};
}

Expected<bool> WeightsAssembler::take(const dds::WeightsChunk& chunk) {
  const auto refuse = [&](const std::string& what) {
    return Error{ErrorCode::kBadFormat, fmt::format("weights of version {}: {}", chunk.version, what)};
  };
  const auto capacity = static_cast<uint64_t>(capacity_bytes_) / (chunk.bf16_count > 0 ? 2 : 1);
  if (chunk.bytes > capacity)
    return refuse(fmt::format("{} bytes, the arena has room for {}", chunk.bytes, capacity));
  const uint64_t count = chunks_of(chunk.bytes), begin = uint64_t{chunk.chunk_index} * dds::kChunkBytes;
  if (chunk.chunk_count != count || chunk.chunk_index >= count ||
      chunk.payload.size() != std::min<uint64_t>(dds::kChunkBytes, chunk.bytes - begin))
    return refuse(fmt::format("chunk {} of {} with {} bytes is none of {}", chunk.chunk_index,
                              chunk.chunk_count, chunk.payload.size(), chunk.bytes));
  const auto is_of = [&](const Part& part) {
    return part.missing > 0 && part.version == chunk.version && part.checksum == chunk.checksum &&
           part.weights.size() == chunk.bytes && part.bf16_count == chunk.bf16_count;
  };
  auto part = std::ranges::find_if(parts_, is_of);
  if (part == parts_.end()) {
    std::swap(parts_[0], parts_[1]);
    part = parts_.begin();
    part->version = chunk.version;
    part->checksum = chunk.checksum;
    part->bf16_count = chunk.bf16_count;
    part->weights.resize(chunk.bytes);
    part->has_chunk.assign(count, false);
    part->missing = count;
  }
  if (part->has_chunk[chunk.chunk_index]) return false;
  if (!chunk.payload.empty())
    std::memcpy(part->weights.data() + begin, chunk.payload.data(), chunk.payload.size());
  part->has_chunk[chunk.chunk_index] = true;
  if (--part->missing > 0) return false;
  std::swap(parts_[0], *part);
  if (checksum64(parts_[0].weights) != chunk.checksum) return refuse("the checksum is another");
  if (chunk.bf16_count > 0)
    if (const Status widened = widen_weights(parts_[0].weights, chunk.bf16_count, wide_); !widened)
      return refuse(widened.error().message);
  return true;
}

}  // namespace comrad::link
