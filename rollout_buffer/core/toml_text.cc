#include "rollout_buffer/core/toml_text.h"

#include "rollout_buffer/core/text.h"

namespace comrad {

std::optional<std::string> toml_scalar_text(const toml::node& node) {
  if (const auto* value = node.as_string()) return value->get();
  if (const auto* value = node.as_integer()) return std::to_string(value->get());
  if (const auto* value = node.as_floating_point()) return real_text(value->get());
  if (const auto* value = node.as_boolean()) return value->get() ? "true" : "false";
  return std::nullopt;
}

}  // namespace comrad
