// From an agent's observation to features. An encoder is made by its name, from layers, or from a TorchScript module; each kind is one
// file (layer_encoder.h, script_encoder.h) behind this interface. Serves forward and update.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "policy_workers/network/input_normalizer.h"
#include "policy_workers/network/layers.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/spec.h"

namespace comrad::policy {

/// What an encoder is made from.
struct EncoderInput {
  EnvShape env;
  std::string encoder = "simple";  ///< the setting: a name, layers, or the path of a module
  bool layer_norm = false;         ///< of an encoder of layers: behind its linear ones
  /// Shared by all encoders of a network.
  std::shared_ptr<const ObservationNormalizer> normalizer;
};

class Encoder {
 public:
  virtual ~Encoder() = default;

  /// Features [B, F] f32 of frame u8 [B, C, H, W] on any device and measurement f32 [B, M] (undefined when M = 0). Differentiable
  /// in the parameters. A row's features depend on that row alone.
  virtual Tensor forward(const Tensor& frame, const Tensor& measurement) const = 0;
  /// The same without a gradient from B frames that lie anywhere in CPU memory, C*H*W bytes each.
  virtual Tensor forward_rows(std::span<const uint8_t* const> frames, const Tensor& measurement) const;

  virtual int64_t feature_count() const = 0;
  /// Parameters as "encoder.<name>", in a fixed order.
  virtual NamedTensors named_parameters() const = 0;
  /// Which code computes it, for one line at the start: "oneDNN convolutions", "operators".
  virtual std::string implementation() const = 0;

 protected:
  Encoder(const EnvShape& env, torch::Device device) : env_(env), device_(device) {}
  EnvShape env_;
  torch::Device device_;
};

/// Makes an encoder whose weights `make` draws; on `make.device`.
using EncoderFactory = std::shared_ptr<const Encoder> (*)(const EncoderInput& input, const LayerMaker& make);

/// Makes an encoder of a new name known. Threads: one, before networks are made.
void add_encoder(const std::string& name, EncoderFactory factory);

/// Aborts for an encoder that check_encoder() refuses.
std::shared_ptr<const Encoder> make_encoder(const EncoderInput& input, const LayerMaker& make);

/// Whether the setting names an encoder that can be made here. Errors: kBadInput for an unknown name, listing the known ones, or a
/// layer that does not fit; kNotFound or kBadFormat for a module that is missing or does not do what an encoder does.
Status check_encoder(const std::string& encoder, const EnvShape& env);

}  // namespace comrad::policy
