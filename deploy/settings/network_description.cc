#include "deploy/settings/network_description.h"

#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <utility>

#include "deploy/process/child_program.h"
#include "deploy/settings/temporary_run.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/layers.h"

namespace comrad::deploy {

Expected<NetworkSize> parse_network_size(std::string_view text) {
  const nlohmann::json described = nlohmann::json::parse(text, nullptr, /*allow_exceptions=*/false);
  const auto number = [&described](const char* key, int64_t high) -> std::optional<int64_t> {
    if (!described.is_object()) return std::nullopt;
    const auto found = described.find(key);
    if (found == described.end() || !found->is_number_integer()) return std::nullopt;
    const auto value = found->get<int64_t>();
    return value >= 0 && value <= high ? std::optional(value) : std::nullopt;
  };
  const auto weights_bytes = number("weights_bytes", int64_t{1} << 40);
  const auto parameter_bytes = number("parameter_bytes", weights_bytes.value_or(0));
  const auto state_count = number("recurrent_state_count", std::numeric_limits<int32_t>::max());
  if (!weights_bytes || !parameter_bytes || !state_count)
    return Error{ErrorCode::kBadFormat,
                 "comrad-policy-worker --describe: no object with weights_bytes, parameter_bytes and "
                 "recurrent_state_count; rebuild with ./comrad"};
  return NetworkSize{*weights_bytes, *parameter_bytes, static_cast<int32_t>(*state_count)};
}

std::vector<std::string> shape_flags(const EnvShape& env) {
  const std::string heads = joined(std::span(env.head_sizes).first(static_cast<size_t>(env.head_count)), ",");
  return {"--num_agents",   std::to_string(env.num_agents),
          "--heads",        heads,
          "--measurements", std::to_string(env.measurement_count),
          "--global_state", std::to_string(env.global_state_count)};
}

Expected<NetworkSize> describe_network(const RunConfig& config, const EnvShape& env) {
  COMRAD_TRY_ASSIGN(const TemporaryFolder folder, TemporaryFolder::create());
  COMRAD_TRY(
      write_file_atomically(folder.path() + "/config.toml", settings_to_toml(config), /*durable=*/false));
  std::vector<std::string> command = {sibling_program("comrad-policy-worker"), "--run_dir", folder.path(),
                                      "--describe"};
  for (std::string& word : shape_flags(env)) command.push_back(std::move(word));
  COMRAD_TRY_ASSIGN(const ProgramResult described, run_program(command));
  if (described.exit_code != 0) {
    const std::string reason = last_words(described);
    return Error{ErrorCode::kBadInput, reason.empty() ? "comrad-policy-worker --describe failed" : reason};
  }
  return parse_network_size(described.output);
}

}  // namespace comrad::deploy
