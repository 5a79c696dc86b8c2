#include "rollout_buffer/link/trajectories/narrow_weights.h"

#include <spdlog/fmt/fmt.h>

#include <bit>
#include <cmath>
#include <cstring>
#include <string>

#include "rollout_buffer/core/bfloat16.h"

namespace comrad::link {
namespace {

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

/// Numbers behind the parameters. Errors: kBadFormat.
Expected<std::size_t> statistics_in(std::size_t bytes, uint64_t parameter_count, std::size_t parameter_size,
                                    std::size_t statistic_size) {
  if (parameter_count > bytes / parameter_size ||
      (bytes - parameter_count * parameter_size) % statistic_size != 0)
    return Error{ErrorCode::kBadFormat,
                 fmt::format("{} bytes are no weights with {} parameters", bytes, parameter_count)};
  return (bytes - parameter_count * parameter_size) / statistic_size;
}

}  // namespace

Status narrow_weights(std::span<const std::byte> weights, uint64_t parameter_count,
                      std::vector<std::byte>& narrow) {
  COMRAD_TRY_ASSIGN(const std::size_t statistics,
                    statistics_in(weights.size(), parameter_count, sizeof(float), sizeof(double)));
  narrow.resize(weights.size() / 2);
  convert<float, uint16_t>(weights.data(), narrow.data(), parameter_count, bf16_of);
  convert<double, float>(weights.data() + parameter_count * sizeof(float),
                         narrow.data() + parameter_count * sizeof(uint16_t), statistics,
                         [](double value) { return static_cast<float>(value); });
  return {};
}

Status widen_weights(std::span<const std::byte> narrow, uint64_t parameter_count,
                     std::vector<std::byte>& weights) {
  COMRAD_TRY_ASSIGN(const std::size_t statistics,
                    statistics_in(narrow.size(), parameter_count, sizeof(uint16_t), sizeof(float)));
  weights.resize(narrow.size() * 2);
  convert<uint16_t, float>(narrow.data(), weights.data(), parameter_count, widened);
  convert<float, double>(narrow.data() + parameter_count * sizeof(uint16_t),
                         weights.data() + parameter_count * sizeof(float), statistics,
                         [](float value) { return static_cast<double>(value); });
  return {};
}

}  // namespace comrad::link
