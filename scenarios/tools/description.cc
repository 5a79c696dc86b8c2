#include "scenarios/tools/description.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdio>
#include <map>

#include "rollout_buffer/core/text.h"
#include "scenarios/spec/action_heads.h"
#include "scenarios/spec/exported_variables.h"
#include "scenarios/spec/global_state.h"
#include "scenarios/spec/registry.h"
#include "scenarios/spec/scenario_files.h"
#include "scenarios/spec/scenario_spec.h"

namespace comrad::scenarios {
namespace {

using Json = nlohmann::ordered_json;

Json bound(const std::optional<double>& value) { return value ? Json(*value) : Json(nullptr); }

Json rewards_of(const ScenarioSpec& spec) {
  Json rewards = Json::array();
  for (const RewardTerm& term : spec.rewards)
    rewards.push_back({{"name", term.name},
                       {"variable", term.variable},
                       {"agent_stride", term.agent_stride},
                       {"kind", term.kind},
                       {"weight", term.weight.last()},
                       {"scope", term.scope},
                       {"per_agent", term.per_agent},
                       {"cap", term.cap},
                       {"when", term.when},
                       {"unless", term.unless},
                       {"meaning", term.meaning}});
  return rewards;
}

Json measurements_of(const ScenarioSpec& spec) {
  Json terms = Json::array();
  for (const MeasurementTerm& term : spec.measurements)
    terms.push_back({{"variable", term.variable},
                     {"agent_stride", term.agent_stride},
                     {"scale", term.scale},
                     {"offset", term.offset},
                     {"clip", term.clip},
                     {"low", bound(term.low)},
                     {"high", bound(term.high)}});
  return terms;
}

Json masks_of(const ScenarioSpec& spec) {
  Json masks = Json::array();
  for (const MaskTerm& term : spec.masks)
    masks.push_back({{"agent", term.agent}, {"head", term.head}, {"allowed", term.allowed}});
  return masks;
}

/// Of the recipe that this build has for the scenario's name; none for a map that was brought along.
Json layout_parameters_of(const ScenarioSpec& spec) {
  Json parameters = Json::array();
  if (const auto known = layout_parameters(spec.maps_of); known && spec.wad.empty())
    for (const LayoutParameter& one : *known)
      parameters.push_back({{"name", one.name},
                            {"default", one.default_value},
                            {"low", one.low},
                            {"high", one.high},
                            {"help", one.help}});
  return parameters;
}

std::string words_of(const Json& list) {
  std::vector<std::string> words;
  for (const Json& one : list) words.push_back(one.is_string() ? one.get<std::string>() : one.dump());
  return joined(words);
}

/// A title, then a line for each row; columns as wide as their longest cell. Nothing where there are no rows.
std::string table(const std::string& title, const std::vector<std::vector<std::string>>& rows) {
  if (rows.empty()) return "";
  std::vector<std::size_t> widths;
  for (const auto& row : rows)
    for (std::size_t i = 0; i < row.size(); ++i) {
      if (i == widths.size()) widths.push_back(0);
      widths[i] = std::max(widths[i], row[i].size());
    }
  std::string text = "\n" + title + "\n";
  for (const auto& row : rows) {
    std::string line;
    for (std::size_t i = 0; i < row.size(); ++i)
      line += "  " + row[i] + std::string(widths[i] - row[i].size(), ' ');
    line.erase(line.find_last_not_of(' ') + 1);
    text += line + "\n";
  }
  return text;
}

std::string number(const Json& value) {
  if (!value.is_number_float()) return value.dump();
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value.get<double>());
  return text;
}

/// A number that a scenario may leave out, as 0.
std::string known_number(const Json& value) { return value == 0 ? "unknown" : number(value); }

/// Names of exports, by their USER variables.
using ExportNames = std::map<std::string, std::string>;

/// "cleared (USER24)", or the name of a game variable.
std::string variable_text(const std::string& variable, const ExportNames& names) {
  const auto name = names.find(variable);
  return name == names.end() ? variable : name->second + " (" + variable + ")";
}

std::string variable_text(const Json& term, const ExportNames& names) {
  const int stride = term["agent_stride"].get<int>();
  return variable_text(term["variable"].get<std::string>(), names) +
         (stride == 0 ? "" : fmt::format(" + {} for each agent", stride));
}

std::vector<std::string> reward_row(const Json& term, const ExportNames& names) {
  std::string rest = term["scope"] == "team" ? "of the team" : "own";
  if (term["per_agent"].get<bool>()) rest += ", divided by the agents";
  if (term["cap"].get<double>() > 0) rest += ", clipped to +-" + number(term["cap"]);
  if (term["when"] != "") rest += ", when " + variable_text(term["when"].get<std::string>(), names);
  if (term["unless"] != "") rest += ", unless " + variable_text(term["unless"].get<std::string>(), names);
  return {term["name"].get<std::string>(),
          number(term["weight"]),
          term["kind"].get<std::string>(),
          variable_text(term, names),
          rest,
          term["meaning"].get<std::string>()};
}

std::vector<std::string> measurement_row(const Json& term, const ExportNames& names) {
  std::string bounds;
  if (term["clip"].get<double>() > 0) bounds = "clipped to +-" + number(term["clip"]);
  if (!term["low"].is_null()) bounds += (bounds.empty() ? "at least " : ", at least ") + number(term["low"]);
  if (!term["high"].is_null()) bounds += (bounds.empty() ? "at most " : ", at most ") + number(term["high"]);
  return {variable_text(term, names), "x " + number(term["scale"]), "+ " + number(term["offset"]), bounds};
}

}  // namespace

Expected<Json> describe(const std::string& name, int num_agents, const std::string& heads) {
  COMRAD_TRY_ASSIGN(ScenarioSpec spec, load_scenario(name));
  COMRAD_TRY(change_heads(spec, heads));
  if (num_agents == 0) num_agents = spec.default_agents;
  if (std::count(spec.supported_agents.begin(), spec.supported_agents.end(), num_agents) == 0) {
    return Error{ErrorCode::kBadInput, fmt::format("scenario {} is not for {} agents; num_agents may be {}",
                                                   name, num_agents, joined(spec.supported_agents))};
  }
  const EnvShape shape = spec.shape(num_agents, /*use_measurements=*/true);
  Json head_sizes = Json::array(), head_buttons = Json::array(), training = Json::object();
  for (int head = 0; head < shape.head_count; ++head) {
    head_sizes.push_back(shape.head_sizes[head]);
    head_buttons.push_back(spec.heads[head].buttons);
  }
  for (const auto& [key, value] : spec.training.values) training[key] = value;
  Json exported = Json::array();
  for (const ExportedVariable& one : exported_variables(spec, num_agents))
    exported.push_back({{"variable", fmt::format("USER{}", one.user)},
                        {"name", one.name},
                        {"meaning", one.meaning},
                        {"read_by", one.read_by}});
  const std::vector<std::string> recipes = layout_recipes();
  COMRAD_TRY_ASSIGN(const auto ceilings, default_ceilings(spec));
  const auto ceiling = ceilings.find(num_agents);
  return Json{
      {"name", spec.name},
      {"version", spec.version},
      {"variants", list_variants(spec.folder)},
      {"title", spec.title},
      {"summary", spec.summary},
      {"difficulty", spec.difficulty},
      {"num_agents", num_agents},
      {"supported_agents", spec.supported_agents},
      {"heads", head_sizes},
      {"head_buttons", head_buttons},
      {"masks", masks_of(spec)},
      {"measurements", shape.measurement_count},
      {"measurement_terms", measurements_of(spec)},
      {"global_state", global_state_names(spec, num_agents).size()},
      {"global_state_names", global_state_names(spec, num_agents)},
      {"rewards", rewards_of(spec)},
      {"exported_variables", exported},
      {"decision_limit", spec.decision_limit},
      {"ceiling", ceiling != ceilings.end() ? ceiling->second : 0.0},
      {"shared_reward_alpha", spec.shared_reward_alpha},
      {"observation",
       {{"status_bar", spec.hud},
        {"crosshair", spec.crosshair},
        {"weapon", spec.weapon},
        {"screen_flashes", spec.screen_flashes}}},
      {"score", spec.score},
      {"score_meaning", spec.score_meaning},
      {"score_unit", spec.score_unit},
      {"score_scale", spec.score_scale},
      {"score_divisor", spec.score_divisor},
      {"has_layout_recipe", spec.wad.empty() && std::count(recipes.begin(), recipes.end(), spec.maps_of) > 0},
      {"maps_of", spec.maps_of},
      {"wad", spec.wad},
      {"map", spec.map},
      {"warnings", spec.warnings},
      {"layout_parameters", layout_parameters_of(spec)},
      {"training", training}};
}

std::string description_text(const Json& description) {
  const auto word = [&](const char* key) { return description[key].get<std::string>(); };
  ExportNames names;
  for (const Json& one : description["exported_variables"])
    if (one["name"] != "") names[one["variable"].get<std::string>()] = one["name"].get<std::string>();
  std::string score = variable_text(word("score"), names);
  if (description["score_scale"] != 1.0) score += " x " + number(description["score_scale"]);
  if (!word("score_divisor").empty()) score += " / " + variable_text(word("score_divisor"), names);
  std::string text = word("title") + " (" + word("name") + "), version " + number(description["version"]) +
                     ", difficulty " + known_number(description["difficulty"]) + "\n" + word("summary") +
                     "\n\n";
  text += "agents          " + number(description["num_agents"]) + " (it supports " +
          words_of(description["supported_agents"]) + ")\n";
  text += "decision limit  " + number(description["decision_limit"]) + "\n";
  if (!description["variants"].empty())
    text += "variants        default, " + words_of(description["variants"]) + " (--variant)\n";
  text += "score J         " + score + " (unit: " + word("score_unit") + "), ceiling " +
          known_number(description["ceiling"]) + "\n";
  text += "global state    " + number(description["global_state"]) +
          " numbers that a team's critic sees with --critic_state=global\n";
  text += "shared reward   " + number(description["shared_reward_alpha"]) + "\n";
  text += "map             " + (word("wad").empty() ? "drawn by comrad doomgen" : word("wad")) +
          (word("maps_of") == word("name") ? "" : ", of " + word("maps_of")) + "\n";

  std::vector<std::vector<std::string>> heads, masks, rewards, measurements, exported, parameters, training,
      warnings;
  for (std::size_t head = 0; head < description["head_buttons"].size(); ++head)
    heads.push_back({std::to_string(head), words_of(description["head_buttons"][head])});
  for (const Json& mask : description["masks"])
    masks.push_back(
        {"agent " + number(mask["agent"]), "head " + number(mask["head"]), words_of(mask["allowed"])});
  for (const Json& term : description["rewards"]) rewards.push_back(reward_row(term, names));
  for (const Json& term : description["measurement_terms"])
    measurements.push_back(measurement_row(term, names));
  for (const Json& one : description["exported_variables"])
    exported.push_back({one["variable"].get<std::string>(), one["name"].get<std::string>(),
                        words_of(one["read_by"]), one["meaning"].get<std::string>()});
  for (const Json& one : description["layout_parameters"])
    parameters.push_back({one["name"].get<std::string>() + " = " + number(one["default"]),
                          number(one["low"]) + ".." + number(one["high"]), one["help"].get<std::string>()});
  for (const auto& [key, value] : description["training"].items())
    training.push_back({key, words_of({value})});
  for (const Json& one : description["warnings"]) warnings.push_back({one.get<std::string>()});
  return text + table("Action heads (choice 0 presses nothing)", heads) +
         table("Masks: what one agent may choose", masks) +
         table("Rewards: name, weight, kind, variable, scope, meaning", rewards) +
         table("Measurements, with --use_additional_input", measurements) +
         table("Exported variables: number, name in [exports], read by, meaning", exported) +
         table("Layout parameters: default, range, meaning", parameters) +
         table("The scenario's training settings", training) +
         table("Not understood, or not served", warnings);
}

}  // namespace comrad::scenarios
