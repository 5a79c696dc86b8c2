#include "learner/checkpoint/architecture.h"

#include <cstring>
#include <string>
#include <vector>

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/settings/encoder_layers.h"

namespace comrad::learn {
Expected<StateDict> architecture_of(const RunConfig& config) {
  const std::string& encoder = config.network.encoder;
  StateDict state;
  if (!is_encoder_file(encoder)) {
    Expected<std::vector<EncoderLayer>> layers = parse_encoder(encoder);
    if (layers && has_layer_norm(config)) layers = with_layer_norm(*layers);
    state.put("architecture/encoder", layers ? layers_text(*layers) : encoder);
    return state;
  }
  COMRAD_TRY_ASSIGN(const std::string bytes, read_encoder_file(encoder));
  torch::Tensor module = torch::empty({static_cast<int64_t>(bytes.size())}, torch::kUInt8);
  std::memcpy(module.data_ptr(), bytes.data(), bytes.size());
  state.put("architecture/encoder", std::string("module"));
  state.put("architecture/encoder_module", module);
  return state;
}

}  // namespace comrad::learn
