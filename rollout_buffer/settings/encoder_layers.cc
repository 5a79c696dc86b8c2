#include "rollout_buffer/settings/encoder_layers.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <charconv>
#include <optional>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/parts.h"
#include "rollout_buffer/core/text.h"

namespace comrad {
namespace {

constexpr std::size_t kLayersMax = 64;
constexpr std::size_t kFileBytesMax = std::size_t{1} << 30;
constexpr int64_t kChannelsMax = 1024, kFeaturesMax = 8192, kKernelMax = 32, kStrideMax = 16;
constexpr LayerShape kFrame = {3, 72, 128};

struct NamedEncoder {
  std::string_view name, old_name, layers;
};
/// Shapes of simple, impala and atari: Mnih et al. 2015 and Espeholt et al. 2018, IMPALA, arXiv:1802.01561, figure 3, whose ResNet is
/// the fourth, with ELU and 512 features. The others are smaller (policy_workers/ENCODERS.md has their rates).
constexpr NamedEncoder kEncoders[] = {
    {"simple", "convnet_simple", "conv 32 8x8/4, conv 64 4x4/2, conv 128 3x3/2, flatten, linear 512"},
    {"impala", "convnet_impala", "conv 16 8x8/4, conv 32 4x4/2, flatten, linear 512"},
    {"atari", "convnet_atari", "conv 32 8x8/4, conv 64 4x4/2, conv 64 3x3, flatten, linear 512"},
    {"resnet", "resnet_impala",
     "conv 16 3x3 pad 1 none, pool 3x3/2 pad 1, residual, residual, "
     "conv 32 3x3 pad 1 none, pool 3x3/2 pad 1, residual, residual, "
     "conv 32 3x3 pad 1 none, pool 3x3/2 pad 1, residual, residual, elu, flatten, linear 512"},
    {"simple_half", "", "conv 16 8x8/4, conv 32 4x4/2, conv 64 3x3/2, flatten, linear 256"},
    {"impala_small", "", "conv 16 8x8/4, conv 32 4x4/2, flatten, linear 256"},
};

/// In the order of LayerKind; an activation alone is named by itself.
constexpr std::array<std::string_view, 6> kKinds = {"conv",      "pool",    "residual",
                                                    "layernorm", "flatten", "linear"};
constexpr std::array<std::string_view, 6> kActivations = {"none", "elu", "relu", "tanh", "gelu", "silu"};
constexpr std::string_view kForms =
    "conv CHANNELS KxK[/STRIDE] [pad N] [ACTIVATION], pool KxK[/STRIDE] [pad N], residual, layernorm, "
    "flatten, "
    "linear FEATURES [ACTIVATION], or an activation (elu, relu, tanh, gelu, silu)";

std::optional<Activation> activation_of(std::string_view word) {
  const auto* const found = std::ranges::find(kActivations, word);
  if (found == kActivations.end()) return std::nullopt;
  return static_cast<Activation>(found - kActivations.begin());
}

std::optional<int64_t> number(std::string_view text, int64_t low, int64_t high) {
  int64_t value = 0;
  const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (code != std::errc() || end != text.data() + text.size() || value < low || value > high)
    return std::nullopt;
  return value;
}

/// "8x8/4" into `layer`.
bool read_window(std::string_view text, EncoderLayer& layer) {
  const std::size_t slash = std::min(text.find('/'), text.size());
  const std::string_view window = text.substr(0, slash);
  const std::size_t cross = std::min(window.find('x'), window.size());
  const auto height = number(window.substr(0, cross), 1, kKernelMax);
  if (cross == window.size() || !height || number(window.substr(cross + 1), 1, kKernelMax) != height)
    return false;
  layer.kernel = *height;
  if (slash == text.size()) return true;
  const auto stride = number(text.substr(slash + 1), 1, kStrideMax);
  layer.stride = stride.value_or(1);
  return stride.has_value();
}

/// The words behind the layer's kind; empty where they are as they should be, else what is wrong.
std::string read_words(std::vector<std::string> words, EncoderLayer& layer) {
  const bool has_outputs = layer.kind == LayerKind::kConv || layer.kind == LayerKind::kLinear;
  const bool has_window = layer.kind == LayerKind::kConv || layer.kind == LayerKind::kPool;
  std::size_t next = 1;
  if (has_outputs) {
    const int64_t most = layer.kind == LayerKind::kConv ? kChannelsMax : kFeaturesMax;
    const auto outputs = next < words.size() ? number(words[next], 1, most) : std::nullopt;
    if (!outputs)
      return fmt::format("{} is a number between 1 and {}",
                         layer.kind == LayerKind::kConv ? "CHANNELS" : "FEATURES", most);
    layer.outputs = *outputs;
    layer.activation = Activation::kElu;
    ++next;
  }
  if (has_window) {
    if (next >= words.size() || !read_window(words[next], layer))
      return fmt::format("a window is square, KxK or KxK/STRIDE, K up to {}, STRIDE up to {}", kKernelMax,
                         kStrideMax);
    ++next;
    if (next + 1 < words.size() && words[next] == "pad") {
      const auto padding = number(words[next + 1], 0, layer.kernel / 2);
      if (!padding) return fmt::format("padding is at most half of the window, {}", layer.kernel / 2);
      layer.padding = *padding;
      next += 2;
    }
  }
  if (has_outputs && next < words.size()) {
    const auto activation = activation_of(words[next]);
    if (!activation) return "'" + words[next] + "' is no activation (" + joined(kActivations) + ")";
    layer.activation = *activation;
    ++next;
  }
  return next < words.size() ? "unexpected '" + words[next] + "'" : "";
}

Expected<EncoderLayer> parse_layer(std::string_view text) {
  const auto refuse = [&](const std::string& why) {
    return Error{ErrorCode::kBadInput,
                 "encoder layer '" + std::string(text) + "': " + why + "; a layer is " + std::string(kForms)};
  };
  const std::vector<std::string> words = parts_of(text, ' ');
  EncoderLayer layer;
  const auto* const kind = std::ranges::find(kKinds, words.front());
  if (kind != kKinds.end()) {
    layer.kind = static_cast<LayerKind>(kind - kKinds.begin());
  } else {
    const auto activation = activation_of(words.front());
    if (!activation || *activation == Activation::kNone) return refuse("'" + words.front() + "' is unknown");
    layer.activation = *activation;
  }
  if (const std::string wrong = read_words(words, layer); !wrong.empty()) return refuse(wrong);
  return layer;
}

const NamedEncoder* find_encoder(std::string_view name) {
  const auto* const found = std::ranges::find_if(kEncoders, [name](const NamedEncoder& encoder) {
    return same_ignoring_case(name, encoder.name) ||
           (!encoder.old_name.empty() && same_ignoring_case(name, encoder.old_name));
  });
  return found == std::end(kEncoders) ? nullptr : found;
}

std::string shape_text(const LayerShape& shape) {
  if (shape.is_flat) return fmt::format("{} features", shape.channels);
  return fmt::format("{} x {} x {}", shape.channels, shape.height, shape.width);
}

}  // namespace

std::string EncoderLayer::text() const {
  const std::string window =
      fmt::format(" {}x{}{}{}", kernel, kernel, (stride > 1 ? fmt::format("/{}", stride) : ""),
                  (padding > 0 ? fmt::format(" pad {}", padding) : ""));
  const std::string word(kActivations[static_cast<std::size_t>(activation)]);
  const std::string after = activation == Activation::kElu ? "" : " " + word;
  switch (kind) {
    case LayerKind::kConv:
      return fmt::format("conv {}{}{}", outputs, window, after);
    case LayerKind::kPool:
      return "pool" + window;
    case LayerKind::kResidual:
      return "residual";
    case LayerKind::kLayerNorm:
      return "layernorm";
    case LayerKind::kFlatten:
      return "flatten";
    case LayerKind::kLinear:
      return fmt::format("linear {}{}", outputs, after);
    case LayerKind::kActivation:
      return word;
  }
  return "";
}

Expected<LayerShape> shape_after(const EncoderLayer& layer, const LayerShape& input) {
  const auto refuse = [&](const char* why) {
    return Error{ErrorCode::kBadInput,
                 "encoder layer '" + layer.text() + "' gets " + shape_text(input) + "; " + why};
  };
  LayerShape output = input;
  switch (layer.kind) {
    case LayerKind::kConv:
    case LayerKind::kPool: {
      if (input.is_flat) return refuse("it must stand before flatten");
      const int64_t height = input.height + 2 * layer.padding - layer.kernel,
                    width = input.width + 2 * layer.padding - layer.kernel;
      if (height < 0 || width < 0) return refuse("its window must not be larger than that");
      if (layer.kind == LayerKind::kConv) output.channels = layer.outputs;
      output.height = height / layer.stride + 1;
      output.width = width / layer.stride + 1;
      return output;
    }
    case LayerKind::kResidual:
      if (input.is_flat) return refuse("it must stand before flatten");
      return output;
    case LayerKind::kFlatten:
      if (input.is_flat) return refuse("flatten stands once");
      return LayerShape{input.elements(), 1, 1, true};
    case LayerKind::kLinear:
      if (!input.is_flat) return refuse("put flatten before it");
      output.channels = layer.outputs;
      return output;
    case LayerKind::kLayerNorm:
    case LayerKind::kActivation:
      return output;
  }
  return output;
}

bool is_encoder_file(std::string_view encoder) { return encoder.ends_with(".pt"); }

Expected<std::string> read_encoder_file(const std::string& path) {
  return read_short_file(path, kFileBytesMax);
}

bool is_encoder_name(std::string_view encoder) {
  return !is_encoder_file(encoder) && encoder.find_first_of(", \n") == std::string_view::npos &&
         std::ranges::find(kKinds, encoder) == kKinds.end() && !activation_of(encoder);
}

std::vector<std::string> encoder_names() {
  std::vector<std::string> names;
  for (const NamedEncoder& encoder : kEncoders) names.emplace_back(encoder.name);
  return names;
}

std::string canonical_encoder(std::string_view encoder) {
  const std::string_view text = trimmed(encoder);
  if (is_encoder_file(text)) return std::string(text);
  if (const NamedEncoder* named = find_encoder(text)) return std::string(named->name);
  const Expected<std::vector<EncoderLayer>> layers = parse_encoder(std::string(text));
  return layers ? layers_text(*layers) : std::string(text);
}

Expected<std::vector<EncoderLayer>> parse_encoder(const std::string& encoder) {
  const std::string_view text = trimmed(encoder);
  const NamedEncoder* named = find_encoder(text);
  if (named == nullptr && is_encoder_name(text))
    return Error{ErrorCode::kBadInput,
                 "encoder is " + std::string(text) + "; it must be one of " + joined(encoder_names()) +
                     ", layers (\"conv 16 8x8/4, conv 32 4x4/2, flatten, linear 256\"), or the path of a "
                     "TorchScript module that ends in .pt" +
                     did_you_mean(text, encoder_names())};
  std::vector<EncoderLayer> layers;
  LayerShape shape = kFrame;
  for (const std::string& part : parts_of(named != nullptr ? named->layers : text, ',')) {
    const std::string_view one = trimmed(part);
    if (one.empty()) continue;
    COMRAD_TRY_ASSIGN(const EncoderLayer layer, parse_layer(lower_case(one)));
    COMRAD_TRY_ASSIGN(shape, shape_after(layer, shape));
    if (layers.size() == kLayersMax)
      return Error{ErrorCode::kBadInput, fmt::format("encoder has more than {} layers", kLayersMax)};
    layers.push_back(layer);
  }
  if (!shape.is_flat)
    return Error{ErrorCode::kBadInput,
                 "encoder '" + encoder + "' ends with " + shape_text(shape) +
                     "; it must end in features: put flatten, and usually a linear layer, behind it"};
  if (shape.channels > kEncoderFeaturesMax)
    return Error{
        ErrorCode::kBadInput,
        fmt::format(
            "encoder '{}' ends with {}; at most {} may reach the core, put a linear layer behind flatten",
            encoder, shape_text(shape), kEncoderFeaturesMax)};
  return layers;
}

std::vector<EncoderLayer> with_layer_norm(const std::vector<EncoderLayer>& layers) {
  std::vector<EncoderLayer> normalised;
  for (EncoderLayer layer : layers) {
    const Activation activation = layer.kind == LayerKind::kLinear ? layer.activation : Activation::kNone;
    if (activation != Activation::kNone) layer.activation = Activation::kNone;
    normalised.push_back(layer);
    if (activation == Activation::kNone) continue;
    normalised.push_back({.kind = LayerKind::kLayerNorm});
    normalised.push_back({.kind = LayerKind::kActivation, .activation = activation});
  }
  return normalised;
}

std::string layers_text(const std::vector<EncoderLayer>& layers) {
  std::vector<std::string> words;
  for (const EncoderLayer& layer : layers) words.push_back(layer.text());
  return joined(words);
}

Expected<CoreText> parse_core(std::string_view text) {
  const std::vector<std::string> words = parts_of(lower_case(trimmed(text)), ' ');
  const auto refuse = [&] {
    return Error{ErrorCode::kBadInput,
                 "core is '" + std::string(text) +
                     "'; it must be none, gru SIZE or lstm SIZE, with xN behind it for N "
                     "layers (gru 256, lstm 512 x2)"};
  };
  if (words.empty()) return refuse();
  CoreText core;
  if (words.front() == "none" && words.size() == 1) return core;
  core.use_rnn = true;
  core.is_lstm = words.front() == "lstm";
  if (!core.is_lstm && words.front() != "gru") return refuse();
  const auto size = words.size() >= 2 ? number(words[1], 1, 4096) : std::nullopt;
  if (!size || words.size() > 3) return refuse();
  core.size = *size;
  if (words.size() == 3) {
    const std::string_view layers = words[2];
    const auto count = layers.starts_with("x") ? number(layers.substr(1), 1, 8) : std::nullopt;
    if (!count) return refuse();
    core.layers = *count;
  }
  return core;
}

}  // namespace comrad
