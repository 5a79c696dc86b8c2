#include "deploy/sweep/search_space.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

using nlohmann::ordered_json;

constexpr double kRounding = 1e-9;  // of a value that was text on its way

std::string number_text(const SearchedSetting& searched, double value) {
  return searched.is_whole ? std::to_string(std::llround(value)) : real_text(value);
}

ordered_json space_json(const SearchedSetting& searched) {
  if (!searched.choices.empty()) return {{"setting", searched.setting}, {"choices", searched.choices}};
  return {{"setting", searched.setting}, {"low", searched.low},    {"high", searched.high},
          {"step", searched.step},       {"log", searched.is_log}, {"whole", searched.is_whole}};
}

}  // namespace

std::string SearchedSetting::words() const {
  if (!choices.empty()) return joined(choices, " or ");
  std::string text = number_text(*this, low) + " to " + number_text(*this, high);
  if (step > 0) text += " in steps of " + number_text(*this, step);
  return is_log ? text + " (log)" : text;
}

std::string SearchedSetting::text(double value) const {
  if (step > 0) value = low + std::round((value - low) / step) * step;
  if (is_whole) value = std::round(value);
  return number_text(*this, std::clamp(value, low, high));
}

bool SearchedSetting::holds(const std::string& value) const {
  if (!choices.empty()) return std::ranges::find(choices, value) != choices.end();
  const double number = read_real(value).value_or(std::nan("")),
               room = kRounding * std::max(std::abs(low), std::abs(high));
  return number >= low - room && number <= high + room && (!is_whole || number == std::round(number));
}

std::vector<std::string> SearchedSetting::extremes() const {
  return choices.empty() ? std::vector{text(low), text(high)} : choices;
}

double SweepSearch::end_of_step(int64_t steps, double goal) const {
  double end = goal;
  if (method == SearchMethod::kPbt) end = every_env_frames * static_cast<double>(steps + 1);
  if (method == SearchMethod::kHalving)
    end = first_env_frames * std::pow(static_cast<double>(reduction), static_cast<double>(steps));
  return std::min(end, goal);
}

const std::vector<std::string>& search_methods() {
  static const std::vector<std::string> kWords = {"random", "tpe", "halving", "pbt"};
  return kWords;
}

const char* word_of(SearchMethod method) {
  return method == SearchMethod::kNone ? "" : search_methods()[static_cast<std::size_t>(method) - 1].c_str();
}

std::optional<SearchMethod> search_method(std::string_view word) {
  const auto found = std::ranges::find(search_methods(), word);
  if (found == search_methods().end()) return std::nullopt;
  return static_cast<SearchMethod>(found - search_methods().begin() + 1);
}

Status check_in_space(const SweepSearch& search, const SettingValues& values, const std::string& origin) {
  for (const SearchedSetting& searched : search.space) {
    const auto found = std::ranges::find(values, searched.setting, &SettingValues::value_type::first);
    if (found == values.end()) return Error{ErrorCode::kBadFormat, origin + " names no " + searched.setting};
    if (!searched.holds(found->second))
      return Error{ErrorCode::kBadFormat, origin + ": " + searched.setting + " is " + found->second +
                                              "; the search is among " + searched.words()};
  }
  if (values.size() != search.space.size())
    return Error{ErrorCode::kBadFormat, origin + " names settings that are not searched"};
  return {};
}

ordered_json to_json(const SweepSearch& search) {
  if (!search.is_on()) return nullptr;
  ordered_json json = {{"method", word_of(search.method)}, {"runs", search.runs}, {"seed", search.seed}};
  json["space"] = ordered_json::array();
  for (const SearchedSetting& searched : search.space) json["space"].push_back(space_json(searched));
  if (search.method == SearchMethod::kHalving)
    json["first_env_frames"] = search.first_env_frames, json["reduction"] = search.reduction;
  if (search.method == SearchMethod::kPbt)
    json["every_env_frames"] = search.every_env_frames, json["quantile"] = search.quantile,
    json["perturb"] = search.perturb, json["resample_probability"] = search.resample_probability;
  return json;
}

Expected<SweepSearch> search_from_json(const ordered_json& json) {
  SweepSearch search;
  if (json.is_null()) return search;
  try {
    const std::optional<SearchMethod> method = search_method(json.at("method").get<std::string>());
    if (!method) return Error{ErrorCode::kBadFormat, ""};
    search.method = *method;
    json.at("runs").get_to(search.runs);
    json.at("seed").get_to(search.seed);
    for (const ordered_json& one : json.at("space")) {
      SearchedSetting& searched = search.space.emplace_back();
      one.at("setting").get_to(searched.setting);
      if (one.contains("choices")) {
        one.at("choices").get_to(searched.choices);
        continue;
      }
      one.at("low").get_to(searched.low);
      one.at("high").get_to(searched.high);
      one.at("step").get_to(searched.step);
      one.at("log").get_to(searched.is_log);
      one.at("whole").get_to(searched.is_whole);
    }
    if (search.method == SearchMethod::kHalving) {
      json.at("first_env_frames").get_to(search.first_env_frames);
      json.at("reduction").get_to(search.reduction);
    }
    if (search.method == SearchMethod::kPbt) {
      json.at("every_env_frames").get_to(search.every_env_frames);
      json.at("quantile").get_to(search.quantile);
      json.at("perturb").get_to(search.perturb);
      json.at("resample_probability").get_to(search.resample_probability);
      if (search.perturb.empty()) return Error{ErrorCode::kBadFormat, ""};
    }
  } catch (const nlohmann::json::exception&) {
    return Error{ErrorCode::kBadFormat, ""};
  }
  return search;
}

ordered_json to_json(const SettingValues& values) {
  ordered_json json = ordered_json::object();
  for (const auto& [setting, value] : values) json[setting] = value;
  return json;
}

Expected<SettingValues> setting_values_from_json(const ordered_json& json) {
  if (!json.is_object()) return Error{ErrorCode::kBadFormat, ""};
  SettingValues values;
  for (const auto& [setting, value] : json.items()) {
    if (!value.is_string()) return Error{ErrorCode::kBadFormat, ""};
    values.emplace_back(setting, value.get<std::string>());
  }
  return values;
}

}  // namespace comrad::deploy
