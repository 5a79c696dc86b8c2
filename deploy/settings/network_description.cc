#include "deploy/settings/network_description.h"

#include <unistd.h>

#include <cstdlib>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "deploy/process/child_program.h"
#include "rollout_buffer/core/files.h"
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
  const auto state_count = number("recurrent_state_count", std::numeric_limits<int32_t>::max());
  if (!weights_bytes || !state_count)
    return Error{
        ErrorCode::kBadFormat,
        "comrad-policy-worker --describe: no object with weights_bytes and recurrent_state_count; rebuild "
        "with ./comrad"};
  return NetworkSize{*weights_bytes, static_cast<int32_t>(*state_count)};
}

namespace {

/// Writes the settings into `folder` and lets the network read them there.
Expected<NetworkSize> ask(const RunConfig& config, const EnvShape& env, const std::string& folder) {
  COMRAD_TRY(write_file_atomically(folder + "/config.toml", settings_to_toml(config), /*durable=*/false));
  std::string heads;
  for (int32_t head = 0; head < env.head_count; ++head)
    heads += (head > 0 ? "," : "") + std::to_string(env.head_sizes[static_cast<size_t>(head)]);
  COMRAD_TRY_ASSIGN(const ProgramResult described,
                    run_program({sibling_program("comrad-policy-worker"), "--run_dir", folder, "--describe",
                                 "--num_agents", std::to_string(env.num_agents), "--heads", heads,
                                 "--measurements", std::to_string(env.measurement_count)}));
  if (described.exit_code != 0) {
    const std::string reason = last_words(described);
    return Error{ErrorCode::kBadInput, reason.empty() ? "comrad-policy-worker --describe failed" : reason};
  }
  return parse_network_size(described.output);
}

}  // namespace

Expected<NetworkSize> describe_network(const RunConfig& config, const EnvShape& env) {
  const char* parent = std::getenv("TMPDIR");
  std::string folder = std::string(parent != nullptr && *parent != '\0' ? parent : "/tmp") + "/comrad-XXXXXX";
  if (mkdtemp(folder.data()) == nullptr)
    return system_error("cannot make " + folder + " (TMPDIR names another place)");
  Expected<NetworkSize> size = ask(config, env, folder);
  unlink((folder + "/config.toml").c_str());
  rmdir(folder.c_str());
  return size;
}

}  // namespace comrad::deploy
