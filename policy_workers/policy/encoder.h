// From an agent's observation to features: running normalisation of every input element, the pixel path
// (convnet_simple unless another is chosen) and, where a scenario has one, the measurement branch (training
// spec 1.1 and 1.2).
#pragma once

#include <ATen/core/Generator.h>
#include <torch/types.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "policy_workers/policy/precision.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/spec.h"

namespace comrad::policy {

using torch::Tensor;
using NamedTensors = std::vector<std::pair<std::string, Tensor>>;
/// Makes sums over one learner's part of a batch sums over the parts of all learners, in place.
using AddUp = std::function<void(Tensor& sums)>;

/// Running mean and variance of every element of one input, in double precision, and the normalisation
///
///   y = clamp((x / scale - mean) / sqrt(var + 1e-5), -5, 5)
///
/// Statistics start at mean 0, var 1, count 1; a batch's mean and unbiased variance are merged with the
/// parallel-variance formula. Whoever writes the buffers from outside calls refresh() afterwards.
class InputNormalizer {
 public:
  InputNormalizer() = default;
  /// `scale` divides raw inputs before the statistics see them: 255 for frames, 1 for numbers. When not
  /// `enabled` the scale is all that is applied.
  static InputNormalizer create(int64_t element_count, double scale, bool enabled, torch::Device device);

  /// Normalises rows [B, elements] of u8 or f32 into f32.
  Tensor normalize(const Tensor& rows) const;
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
      1;                    // count_, known without asking the device; none once it came from outside
  Tensor factor_, offset_;  // f32 [elements]
};

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

/// How weights of linear and convolution layers begin.
enum class Initialization {
  kOrthogonal,        ///< orthogonal with a gain, zero biases
  kFrameworkDefault,  ///< weights and biases uniform in +-1/sqrt(inputs), PyTorch's default
  kZero,              ///< for networks that are given others' weights
};

/// What an encoder is made from.
struct EncoderOptions {
  EnvShape env = {};
  std::string architecture = "convnet_simple";
  Initialization init = Initialization::kOrthogonal;
  double init_gain = 1.0;
  bool normalize_input = true;
  Precision precision = Precision::kFp32;
};

/// One convolution: kernels of kernel x kernel, no padding.
struct ConvShape {
  int64_t channels, kernel, stride;
};
/// An encoder by its convolutions, each followed by ELU; a linear layer to 512 features ends it.
struct ConvStack {
  std::string name;
  std::vector<ConvShape> convs;
};
/// Makes an encoder of one's own known. `stack.name` must be new. Threads: one, before networks are made.
void add_encoder(ConvStack stack);

/// What --encoder_conv_architecture may be called.
std::vector<std::string> encoder_names();
/// Errors: kBadInput for an unknown encoder, naming the known ones.
Status check_encoder(const std::string& name);

/// Convolutions and a linear layer to 512 features, ELU after each, with the measurement branch (128
/// features) beside it. `channels@kernel/stride` without padding, parameters at 3 x 72 x 128:
///
///   convnet_simple  32@8/4 64@4/2 128@3/2                                                   1 293 024
///   convnet_impala  16@8/4 32@4/2                                                           1 617 456
///   convnet_atari   32@8/4 64@4/2 64@3/1                                                    2 042 528
///   resnet_impala   3 stages of 16, 32, 32 channels: 3x3 convolution, 3x3/2 max-pooling,
///                   2 residual blocks of two 3x3 convolutions, all padded by 1              2 457 408
///
/// Source: the shapes are those of Mnih et al. 2015 (atari) and Espeholt et al. 2018,
/// IMPALA, arXiv:1802.01561, figure 3 (impala), with ELU and 512 features as the others.
class Encoder {
 public:
  Encoder() = default;
  /// Without `normalizer` the encoder makes its own.
  static Encoder create(const EncoderOptions& options, at::Generator generator, torch::Device device,
                        std::shared_ptr<ObservationNormalizer> normalizer = nullptr);

  /// Features [B, F] of frame u8 [B, C, H, W] and measurement f32 [B, M] (ignored when the shape has none).
  Tensor forward(const Tensor& frame, const Tensor& measurement) const;
  /// The same from frames that lie anywhere in CPU memory, measurements [B, M] as above.
  Tensor forward_rows(std::span<const uint8_t* const> frames, const Tensor& measurement) const;

  /// `frame` is this learner's part where `add_up_frames` is given, `measurement` is always whole.
  void update_statistics(const Tensor& frame, const Tensor& measurement, const AddUp& add_up_frames = {});

  int64_t feature_count() const;
  NamedTensors named_parameters() const;
  NamedTensors named_buffers() const;

 private:
  struct Layer {
    std::string name;
    Tensor weight, bias;
  };
  Tensor convolutions(Tensor pixels) const;
  Tensor features(const Tensor& map, const Tensor& measurement) const;

  EnvShape env_;
  torch::Device device_ = torch::kCPU;
  Precision precision_ = Precision::kFp32;
  std::shared_ptr<ObservationNormalizer> normalizer_;
  bool is_resnet_ = false;
  std::vector<Layer> conv_;
  std::vector<int64_t> strides_;    // of a plain stack
  Layer image_;                     // flattened map -> 512
  std::vector<Layer> measurement_;  // M -> 128 -> 128
};

/// Weight of these sizes (outputs first) and bias [outputs] of a fresh layer.
std::pair<Tensor, Tensor> initial_layer(at::IntArrayRef sizes, Initialization init, double gain,
                                        at::Generator generator);

/// Orthogonal matrix with `gain`, rows x columns being the first axis x all others; drawn from `generator`.
Tensor orthogonal(at::IntArrayRef sizes, double gain, at::Generator generator);

}  // namespace comrad::policy
