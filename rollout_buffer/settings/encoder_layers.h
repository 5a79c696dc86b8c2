// A pixel encoder as text, as --encoder takes it: a name of the table below, layers, or the path of a TorchScript module.
// The learner, policy workers and Python build the network from the layers. Stage: before a run.
//
//   conv CHANNELS KxK[/STRIDE] [pad N] [ACTIVATION]   convolution of K x K; ELU where no activation is named
//   pool KxK[/STRIDE] [pad N]                         maximum of K x K
//   residual                                          x + conv(elu(conv(elu(x)))), both 3x3 with padding 1
//   layernorm                                         mean 0, variance 1 over a whole row, with weight and bias per element
//   flatten                                           [C, H, W] to [C H W]; linear layers follow it
//   linear FEATURES [ACTIVATION]                      ELU where no activation is named
//   elu, relu, tanh, gelu, silu                       an activation alone; none after conv or linear leaves it out
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad {

enum class LayerKind { kConv, kPool, kResidual, kLayerNorm, kFlatten, kLinear, kActivation };
enum class Activation { kNone, kElu, kRelu, kTanh, kGelu, kSilu };

struct EncoderLayer {
  LayerKind kind = LayerKind::kActivation;
  int64_t outputs = 0;  ///< channels of a convolution, features of a linear layer
  int64_t kernel = 0, stride = 1, padding = 0;
  Activation activation = Activation::kNone;

  bool operator==(const EncoderLayer&) const = default;
  /// The layer as it is written, activations named where they are not ELU.
  std::string text() const;
};

/// Sizes of one row: [channels, height, width], or [features, 1, 1] behind flatten.
struct LayerShape {
  int64_t channels = 0, height = 1, width = 1;
  bool is_flat = false;
  int64_t elements() const { return channels * height * width; }
};

/// What the layer makes of a row of that shape. Errors: kBadInput for a layer that does not fit, naming both.
Expected<LayerShape> shape_after(const EncoderLayer& layer, const LayerShape& input);

/// How many features of a row may reach the core.
constexpr int64_t kEncoderFeaturesMax = 32768;

/// Whether `encoder` is the path of a TorchScript module: it ends in ".pt".
bool is_encoder_file(std::string_view encoder);
/// The bytes of that file, 1 GiB at most. Errors: those of read_short_file().
Expected<std::string> read_encoder_file(const std::string& path);
/// Whether `encoder` is one name, known or not, rather than layers.
bool is_encoder_name(std::string_view encoder);
/// simple, impala, ...: the names of the table.
std::vector<std::string> encoder_names();
/// One spelling for every way to write an encoder: its present name (convnet_simple is simple), or its layers as "a, b, c".
std::string canonical_encoder(std::string_view encoder);

/// The layers of a name or of "conv 16 8x8/4, flatten, linear 256". Frames of 3 x 72 x 128 were tried.
/// Errors: kBadInput naming the layer, what is wrong with it and what it may be; an unknown name lists the known ones.
Expected<std::vector<EncoderLayer>> parse_encoder(const std::string& encoder);

/// The same with a layernorm between each linear layer and its activation; convolutions stay as they are.
/// Source: Gallici et al. 2025, PQN, arXiv:2407.04811.
std::vector<EncoderLayer> with_layer_norm(const std::vector<EncoderLayer>& layers);

/// "conv 16 8x8/4, flatten, linear 256".
std::string layers_text(const std::vector<EncoderLayer>& layers);

/// A recurrent core as text: "gru 512", "lstm 256 x2" (two layers) or "none".
struct CoreText {
  bool use_rnn = false, is_lstm = false;
  int64_t size = 512, layers = 1;
};
/// Errors: kBadInput with what it may be.
Expected<CoreText> parse_core(std::string_view text);

}  // namespace comrad
