#include "policy_workers/network/encoder.h"

#include <algorithm>
#include <map>

#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/layer_encoder.h"
#include "policy_workers/network/script_encoder.h"
#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/encoder_layers.h"

namespace comrad::policy {
namespace {

/// Encoders written in C++, beside those that are layers.
std::map<std::string, EncoderFactory>& factories() {
  static std::map<std::string, EncoderFactory> made;
  return made;
}

}  // namespace

Tensor Encoder::forward_rows(std::span<const uint8_t* const> frames, const Tensor& measurement) const {
  const auto rows = static_cast<int64_t>(frames.size());
  // A quarter of the bytes of normalised pixels crosses to an accelerator.
  const Tensor bytes = torch::empty({rows, env_.channels, env_.height, env_.width}, torch::kUInt8);
  for (int64_t row = 0; row < rows; ++row)
    std::copy_n(frames[static_cast<size_t>(row)], env_.frame_bytes(),
                bytes.data_ptr<uint8_t>() + row * env_.frame_bytes());
  return forward(bytes, measurement);
}

void add_encoder(const std::string& name, EncoderFactory factory) {
  COMRAD_CHECK(!factories().contains(name) && !parse_encoder(name).has_value(),
               "an encoder's name must be new");
  factories()[name] = factory;
}

std::shared_ptr<const Encoder> make_encoder(const EncoderInput& input, const LayerMaker& make) {
  if (is_encoder_file(input.encoder)) return make_script_encoder(input, make);
  const auto own = factories().find(input.encoder);
  return own != factories().end() ? own->second(input, make) : make_layer_encoder(input, make);
}

Status check_encoder(const std::string& encoder, const EnvShape& env) {
  if (is_encoder_file(encoder)) return check_script_encoder(encoder, env);
  if (factories().contains(encoder)) return {};
  COMRAD_TRY(parse_encoder(encoder));
  return {};
}

}  // namespace comrad::policy
