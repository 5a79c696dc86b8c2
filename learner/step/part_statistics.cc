#include "learner/step/part_statistics.h"

#include <algorithm>
#include <cmath>

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/check.h"

namespace comrad::learn {

const char* part_of_parameter(std::string_view name) {
  if (name.starts_with("critic.")) return "critic";
  if (name.starts_with("agent")) name.remove_prefix(std::min(name.find('.') + 1, name.size()));
  if (name.starts_with("value_head.")) return "critic";
  if (name.starts_with("core.") || name.starts_with("core_norm.")) return "core";
  for (const char* head : {"decoder.", "decoder_norm.", "action_head."})
    if (name.starts_with(head)) return "heads";
  return "encoder";
}

void PartStatistics::add(const AdamOptimizer& optimizer,
                         const std::vector<std::pair<std::string, torch::Tensor>>& named, const char* part) {
  for (std::size_t i = 0; i < optimizer.parameters().size(); ++i) {
    const torch::Tensor& parameter = optimizer.parameters()[i];
    const auto known =
        std::ranges::find_if(named, [&](const auto& entry) { return entry.second.is_same(parameter); });
    if (known == named.end() || !optimizer.has_stepped(i)) continue;
    const std::string_view wanted = part != nullptr ? part : part_of_parameter(known->first);
    const auto sums =
        std::ranges::find(sums_, wanted, [](const Sums& s) { return std::string_view(s.part); });
    COMRAD_CHECK(sums != sums_.end(), "a part has one of five names");
    const double norm = optimizer.gradient_norm(i), elements = static_cast<double>(parameter.numel());
    sums->squares += norm * norm;
    sums->gain += optimizer.step_multiplier(i) * elements;
    sums->elements += elements;
  }
}

void PartStatistics::append_to(NamedNumbers& values) const {
  for (const Sums& sums : sums_)
    if (sums.elements > 0)
      values.emplace_back(std::string("train/grad_norm_") + sums.part, std::sqrt(sums.squares));
  for (const Sums& sums : sums_)
    if (sums.elements > 0)
      values.emplace_back(std::string("train/adam_gain_") + sums.part, sums.gain / sums.elements);
}

}  // namespace comrad::learn
