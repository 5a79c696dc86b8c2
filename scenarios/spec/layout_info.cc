#include "scenarios/spec/layout_info.h"

#include <spdlog/fmt/fmt.h>

#include <toml++/toml.h>

#include <charconv>
#include <cmath>
#include <string>

#include "rollout_buffer/core/text.h"
#include "rollout_buffer/core/toml_text.h"

namespace comrad::scenarios {
namespace {

constexpr std::size_t kMaxTextBytes = 64 * 1024;  // a hostile lump must not keep the parser busy
constexpr int64_t kFormat = 1;

Error bad(const std::string& what) {
  return Error{ErrorCode::kBadFormat, std::string("lump ") + kLayoutInfoLump + ": " + what};
}

}  // namespace

std::string write_layout_info(const LayoutInfo& info) {
  std::string text =
      fmt::format("format = {}\nscenario = \"{}\"\n{}seed = {}\nattempt = {}\n\n[parameters]\n", kFormat,
                  info.scenario, (info.version == 1 ? "" : fmt::format("version = {}\n", info.version)),
                  static_cast<int64_t>(info.seed), info.attempt);
  for (const auto& [name, value] : info.parameters) text += fmt::format("{} = {}\n", name, value);
  if (info.ceiling.empty()) return text;
  text += "\n[ceiling]\n";
  for (const auto& [agents, ceiling] : info.ceiling)
    text += fmt::format("{} = {}\n", agents, real_text(ceiling));
  return text;
}

Status check_scenario(const LayoutInfo& info, const std::string& scenario, const std::string& path) {
  if (info.scenario == scenario) return {};
  return Error{ErrorCode::kBadInput, path + " is a map of scenario " + info.scenario + ", not of " +
                                         scenario + "; play it with --scenario " + info.scenario +
                                         ", or draw it for your own with `comrad doomgen " + info.scenario +
                                         " --as " + scenario + " -o " + path + "`"};
}

Expected<LayoutInfo> parse_layout_info(std::string_view text) {
  if (text.size() > kMaxTextBytes) return bad("longer than 64 KB");
  COMRAD_TRY(check_toml_text(text, std::string("lump ") + kLayoutInfoLump));
  LayoutInfo info;
  try {  // toml++ throws; nothing of it leaves this function
    const toml::table table = toml::parse(text);
    if (table["format"].value<int64_t>() != kFormat) return bad(fmt::format("format is not {}", kFormat));
    const auto scenario = table["scenario"].value<std::string>();
    const auto seed = table["seed"].value<int64_t>();
    const auto attempt = table["attempt"].value<int64_t>();
    const int64_t version = table["version"].value_or<int64_t>(1);
    if (!scenario || !seed || !attempt || *attempt < 0 || *attempt > 1'000'000 || version < 1 ||
        version > 1000)
      return bad("scenario, version, seed or attempt is missing or out of range");
    info.scenario = *scenario;
    info.version = static_cast<int>(version);
    info.seed = static_cast<uint64_t>(*seed);
    info.attempt = static_cast<int>(*attempt);
    if (const toml::table* parameters = table["parameters"].as_table())
      for (const auto& [key, value] : *parameters) {
        const auto number = value.value_exact<int64_t>();
        if (!number) return bad("parameter " + std::string(key.str()) + " is no whole number");
        info.parameters[std::string(key.str())] = *number;
      }
    if (const toml::table* ceilings = table["ceiling"].as_table())
      for (const auto& [key, value] : *ceilings) {
        int agents = 0;
        const std::string_view digits = key.str();
        const auto [end, failure] = std::from_chars(digits.data(), digits.data() + digits.size(), agents);
        const auto number = value.value<double>();
        if (failure != std::errc() || end != digits.data() + digits.size() || agents < 1 || !number ||
            !(*number > 0) || !std::isfinite(*number))
          return bad("ceiling " + std::string(digits) + " is no positive number for a number of agents");
        info.ceiling[agents] = *number;
      }
  } catch (const toml::parse_error& error) {
    return bad(fmt::format("line {}, column {}: {}", error.source().begin.line, error.source().begin.column,
                           error.description()));
  }
  return info;
}

}  // namespace comrad::scenarios
