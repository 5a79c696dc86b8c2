// Running normalisation of every input element (training spec 1.2): of frames, measurements and the world's state.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "policy_workers/network/layers.h"
#include "rollout_buffer/schema/spec.h"

namespace comrad::policy {

/// Makes sums over one learner's part of a batch sums over the parts of all learners, in place.
using AddUp = std::function<void(Tensor& sums)>;

/// Values beyond +-kInputClip are clipped.
constexpr float kInputClip = 5.0f;

/// Running mean and variance of every element of one input, in double precision, and the normalisation
///
///   y = clamp((x / scale - mean) / sqrt(var + 1e-5), -5, 5)
///
/// Statistics start at mean 0, var 1, count 1; a batch's mean and unbiased variance are merged with the
/// parallel-variance formula. Call refresh() after writing the buffers from outside.
class InputNormalizer {
 public:
  InputNormalizer() = default;
  /// `scale` divides raw inputs before the statistics see them: 255 for frames, 1 for numbers. When not
  /// `enabled` the scale is all that is applied.
  static InputNormalizer create(int64_t element_count, double scale, bool enabled, torch::Device device);

  /// Normalises rows [B, elements] of u8 or f32 into f32, or into bf16, the f32 rounded, without a gradient.
  Tensor normalize(const Tensor& rows, torch::ScalarType type = torch::kFloat32) const;
  /// The same for u8 rows on the CPU that lie anywhere: one pass, no copy between. `out` has
  /// rows.size() rows.
  void normalize_rows(std::span<const uint8_t* const> rows, float* out) const;
  /// Merges a batch [B, elements] of u8 or f32 into the statistics. Any number of rows; none changes nothing. Where
  /// several learners have a part of the batch each, `add_up` makes sums those of all of them.
  void update(const Tensor& rows, const AddUp& add_up = {});
  /// Takes over what was written into the buffers.
  void refresh();

  /// y = clamp(x * factor + offset, -5, 5), both f32 [elements]. On a CPU never written in place: a graph of autograd
  /// may keep them. Elsewhere always in place, for recorded work that reads them.
  const Tensor& factor() const { return factor_; }
  const Tensor& offset() const { return offset_; }

  /// Buffers "mean", "var" [elements] and "count" [1], f64; empty when not enabled.
  NamedTensors named_buffers(const std::string& prefix) const;

 private:
  int64_t element_count_ = 0;
  double scale_ = 1.0;
  bool enabled_ = false;
  torch::Device device_ = torch::kCPU;
  void derive();  // factor and offset from mean and variance

  Tensor mean_, variance_, count_;  // f64
  std::optional<double> rows_seen_ =
      1;                     // count_, known without asking the device; none once it came from outside
  Tensor factor_, offset_;   // f32 [elements]
  Tensor lowest_, highest_;  // f32 [1], the clip
};

/// Rows [B, elements] of u8 on the CPU to f32: clamp(x * factor + offset), by the CPU's own loop.
Tensor normalize_bytes(const Tensor& rows, const Tensor& factor, const Tensor& offset);

/// The normalisers of an observation, and of the global state [S] that a team's critic or mixer sees. Networks that
/// live together (one per agent, actor and critic) share one.
struct ObservationNormalizer {
  /// The global state is normalised also where `enabled` is off: it counts in map units, points and whatever scripts export.
  static std::shared_ptr<ObservationNormalizer> create(const EnvShape& env, bool enabled,
                                                       torch::Device device, int64_t global_state_count = 0);
  void refresh();
  NamedTensors named_buffers() const;

  InputNormalizer frame, measurement, global_state;
};

}  // namespace comrad::policy
