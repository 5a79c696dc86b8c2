#include "learner/batch/masked.h"

#include <algorithm>
#include <vector>

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/check.h"

namespace comrad::learn {
namespace {

template <typename T>
Spread spread_of_values(const Tensor& samples, const Tensor& mask) {
  const Tensor dense = samples.contiguous();
  const T* values = dense.data_ptr<T>();
  const uint8_t* counts = mask.data_ptr<uint8_t>();
  const int64_t places = mask.numel(), width = places > 0 ? dense.numel() / places : 0;
  const auto for_each = [&](auto&& use) {
    for (int64_t place = 0; place < places; ++place)
      if (counts[place] != 0)
        for (int64_t k = place * width; k < (place + 1) * width; ++k) use(static_cast<double>(values[k]));
  };
  Spread spread;
  double sum = 0;
  for_each([&](double value) {
    spread.min = spread.count == 0 ? value : std::min(spread.min, value);
    spread.max = spread.count == 0 ? value : std::max(spread.max, value);
    sum += value;
    ++spread.count;
  });
  if (spread.count == 0) return spread;
  spread.mean = sum / static_cast<double>(spread.count);
  for_each([&](double value) { spread.squares += (value - spread.mean) * (value - spread.mean); });
  return spread;
}

Tensor on_host(const Tensor& mask) {
  COMRAD_CHECK(mask.is_cpu() && mask.scalar_type() == torch::kUInt8, "a mask is u8 on the host");
  return mask.contiguous();
}

}  // namespace

int64_t count_of(const Tensor& mask) {
  const Tensor dense = on_host(mask);
  const uint8_t* bytes = dense.data_ptr<uint8_t>();
  return dense.numel() - std::count(bytes, bytes + dense.numel(), uint8_t{0});
}

Tensor positions_of(const Tensor& mask) {
  const Tensor dense = on_host(mask);
  const uint8_t* bytes = dense.data_ptr<uint8_t>();
  Tensor positions = torch::empty({count_of(dense)}, torch::kInt64);
  int64_t* next = positions.data_ptr<int64_t>();
  for (int64_t k = 0; k < dense.numel(); ++k)
    if (bytes[k] != 0) *next++ = k;
  return positions;
}

double Spread::variance(bool unbiased) const {
  const auto divisor = static_cast<double>(unbiased ? count - 1 : count);
  return unbiased && count < 2 ? 0.0 : squares / divisor;
}

Spread spread_of(const Tensor& samples, const Tensor& mask) {
  COMRAD_CHECK(samples.is_cpu(), "samples lie on the host");
  const Tensor counted = on_host(mask);
  switch (samples.scalar_type()) {
    case torch::kFloat32:
      return spread_of_values<float>(samples, counted);
    case torch::kFloat64:
      return spread_of_values<double>(samples, counted);
    case torch::kInt64:
      return spread_of_values<int64_t>(samples, counted);
    default:
      COMRAD_CHECK(false, "samples are f32, f64 or i64");
      return {};
  }
}

}  // namespace comrad::learn
