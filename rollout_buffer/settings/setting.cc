#include "rollout_buffer/settings/setting.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>
#include <type_traits>

#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/other_names.h"
#include "rollout_buffer/settings/reward_weights.h"

namespace comrad {
namespace {

// Upper bounds of reals that have no nearer one: beyond them numbers overflow on the way, or mean nothing.
constexpr double kCoefficientMax = 1e6;
constexpr double kScoreMax = 1e12;   // rewards, returns, scores
constexpr double kFramesMax = 1e15;  // env frames: counters stay exact in a double
constexpr double kSecondsMax = 1e9;  // 31 years

bool parse(std::string_view text, std::string& value) {
  value = text;
  return true;
}

bool parse(std::string_view given, double& value) {
  const std::optional<double> real = read_real(given);
  value = real.value_or(value);
  return real.has_value();
}

bool parse(std::string_view given, Schedule& value) {
  const Expected<Schedule> schedule = Schedule::parse(given);
  if (schedule) value = *schedule;
  return schedule.has_value();
}

bool parse(std::string_view given, int64_t& value) {
  std::string_view text = trimmed(given);
  if (text.starts_with('+')) text.remove_prefix(1);
  int64_t parsed = 0;
  const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), parsed);
  if (failure == std::errc() && end == text.data() + text.size()) {
    value = parsed;
    return true;
  }
  double real = 0;  // 1e6 and 4096.0 are integers too
  if (!parse(given, real) || real != std::floor(real) || std::fabs(real) > 9.0e15) return false;
  value = static_cast<int64_t>(real);
  return true;
}

bool parse(std::string_view given, bool& value) {
  const std::string text = lower_case(trimmed(given));
  if (text != "true" && text != "1" && text != "false" && text != "0") return false;
  value = text == "true" || text == "1";
  return true;
}

bool parse(std::string_view text, AlgorithmName& value) {
  const AlgorithmRow* row = find_algorithm(trimmed(text));
  if (row != nullptr) value = *row;
  return row != nullptr;
}

template <typename Enum>
requires std::is_enum_v<Enum>
bool parse(std::string_view text, Enum& value) {
  const auto& words = Words<Enum>::words;
  for (std::size_t i = 0; i < words.size(); ++i)
    if (same_ignoring_case(words[i], trimmed(text))) {
      value = static_cast<Enum>(i);
      return true;
    }
  return false;
}

std::string to_text(const std::string& value) { return value; }
std::string to_text(bool value) { return value ? "true" : "false"; }
std::string to_text(int64_t value) { return std::to_string(value); }
std::string to_text(double value) { return real_text(value); }
std::string to_text(const Schedule& value) { return value.text(); }
std::string to_text(const AlgorithmName& value) { return value.name(); }
template <typename Enum>
requires std::is_enum_v<Enum> std::string to_text(Enum value) { return word_of(value); }

template <typename T>
constexpr SettingKind kind_of() {
  if constexpr (std::is_same_v<T, bool>) return SettingKind::kBool;
  if constexpr (std::is_same_v<T, int64_t>) return SettingKind::kInt;
  if constexpr (std::is_same_v<T, double>) return SettingKind::kReal;
  if constexpr (std::is_same_v<T, Schedule>) return SettingKind::kSchedule;
  if constexpr (std::is_same_v<T, std::string>) return SettingKind::kText;
  return SettingKind::kWord;
}

template <typename T>
std::vector<std::string> words_of() {
  if constexpr (std::is_same_v<T, AlgorithmName>) return algorithm_names();
  if constexpr (std::is_enum_v<T>) return {Words<T>::words.begin(), Words<T>::words.end()};
  return {};
}

template <typename T>
bool within(const T& value, const Limits& limits) {
  if constexpr (std::is_same_v<T, int64_t> || std::is_same_v<T, double>)
    return limits.holds(static_cast<double>(value));
  if constexpr (std::is_same_v<T, Schedule>)
    return std::ranges::all_of(
        value.points(), [&limits](double of_point) { return limits.holds(of_point); },
        &Schedule::Point::value);
  if constexpr (std::is_same_v<T, std::string>)
    return is_utf8(value) && limits.holds(std::string_view(value));
  return true;
}

// The tests of text that rows name.
bool is_folder_name(std::string_view text) {
  return text.find('/') == std::string_view::npos && text != "." && text != "..";
}

bool is_device(std::string_view device) {
  if (device == "auto" || device == "cpu" || device == "cuda" || device == "gpu") return true;
  if (!device.starts_with("cuda:")) return false;
  device.remove_prefix(5);
  return !device.empty() && device.size() <= 3 &&
         std::all_of(device.begin(), device.end(), [](char c) { return c >= '0' && c <= '9'; });
}

bool is_frame_size(std::string_view size) {
  const std::size_t cross = size.find('x');
  if (cross == std::string_view::npos) return false;
  const auto is_side = [](std::string_view text) {
    int64_t pixels = 0;
    return parse(text, pixels) && pixels >= 16 && pixels <= 4096;
  };
  return is_side(size.substr(0, cross)) && is_side(size.substr(cross + 1));
}

/// Every part of a list separated by commas passes; an empty list does.
template <typename Test>
bool all_parts(std::string_view list, Test test) {
  while (!list.empty()) {
    const std::size_t comma = std::min(list.find(','), list.size());
    if (!test(list.substr(0, comma))) return false;
    list.remove_prefix(std::min(comma + 1, list.size()));
  }
  return true;
}

bool are_devices(std::string_view text) { return all_parts(text, is_device); }

/// As ssh takes them, and nothing that ssh or a shell could take for anything else.
bool are_host_names(std::string_view text) {
  return all_parts(text, [](std::string_view host) {
    const auto is_plain = [](char c) {
      return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
             c == '-' || c == '_' || c == '@';
    };
    return !host.empty() && host.size() <= 255 && host.front() != '-' &&
           std::all_of(host.begin(), host.end(), is_plain);
  });
}

bool are_addresses(std::string_view text) {
  return all_parts(text, [](std::string_view address) {
    int parts = 0;
    for (std::string_view rest = address; parts < 5; ++parts) {
      const std::size_t dot = std::min(rest.find('.'), rest.size());
      int64_t number = -1;
      if (dot == 0 || dot > 3 || !parse(rest.substr(0, dot), number) || number < 0 || number > 255)
        return false;
      if (dot == rest.size()) return parts == 3;
      rest.remove_prefix(dot + 1);
    }
    return false;
  });
}

bool is_interface(std::string_view name) {
  return !name.empty() && name.size() <= 15 && std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
           c == '-' || c == '.' || c == ':' || c == '@';
  });
}

constexpr std::string_view kWidthsWords = "none, or up to 8 widths between 1 and 8192 as 512,256";
bool are_widths(std::string_view text) { return parse_widths(std::string(text)).has_value(); }

bool are_reward_weights(std::string_view text) { return parse_reward_weights(std::string(text)).has_value(); }

std::vector<SettingRow> make_rows() {
  using namespace limits;  // NOLINT: the rows' vocabulary
  std::vector<SettingRow> rows;
  AppliesWhen applies_when = with::everything;  // of the file's rows that name no condition
  const auto add = [&rows, &applies_when](SettingRow row) {
    if (row.traits.applies_when.holds == nullptr) row.traits.applies_when = applies_when;
    rows.push_back(std::move(row));
  };
#define SETTING(TYPE, NAME, DEFAULT, LIMITS, HELP, ...)                                                  \
  add({.name = #NAME,                                                                                    \
       .subject = subject,                                                                               \
       .kind = kind_of<TYPE>(),                                                                          \
       .limits = LIMITS,                                                                                 \
       .help = HELP,                                                                                     \
       .traits = {__VA_ARGS__},                                                                          \
       .words = words_of<TYPE>,                                                                          \
       .text = [](const RunConfig& config) { return to_text(config.PART.NAME); },                        \
       .assign = [](RunConfig& config, std::string_view text) { return parse(text, config.PART.NAME); }, \
       .holds = [](const RunConfig& config,                                                              \
                   const Limits& limits) { return within(config.PART.NAME, limits); }});
  std::string_view subject = "run";
#define PART run
#include "rollout_buffer/settings/run.def"
#undef PART
  subject = "environment";
#define PART environment
#include "rollout_buffer/settings/environment.def"
#undef PART
  subject = "collection";
#define PART collection
#include "rollout_buffer/settings/collection.def"
#undef PART
  subject = "network";
#define PART network
#include "rollout_buffer/settings/network.def"
#undef PART
  subject = "optimisation";
#define PART optimisation
#include "rollout_buffer/settings/optimisation.def"
#undef PART
  subject = "on_policy", applies_when = with::on_policy;
#define PART on_policy
#include "rollout_buffer/settings/on_policy.def"
#undef PART
  subject = "q_learning", applies_when = with::q_learning;
#define PART q_learning
#include "rollout_buffer/settings/q_learning.def"
#undef PART
  subject = "replay", applies_when = with::q_learning;
#define PART replay
#include "rollout_buffer/settings/replay.def"
#undef PART
  subject = "mixers", applies_when = with::mixers;
#define PART mixers
#include "rollout_buffer/settings/mixers.def"
#undef PART
  subject = "curriculum", applies_when = with::everything;
#define PART curriculum
#include "rollout_buffer/settings/curriculum.def"
#undef PART
  subject = "hosts";
#define PART hosts
#include "rollout_buffer/settings/hosts.def"
#undef PART
#undef SETTING
  return rows;
}

/// A bound as people write it: 4096, 0.5, 1e+15.
std::string number_text(double value) {
  std::array<char, 40> digits{};
  const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
  return {digits.data(), end};
}

/// Text as a TOML basic string.
std::string toml_string(std::string_view value) {
  std::string text = "\"";
  for (const char c : value) {
    if (c == '"' || c == '\\') {
      text += '\\';
      text += c;
    } else if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F) {
      std::array<char, 8> escaped{};
      std::snprintf(escaped.data(), escaped.size(), "\\u%04X",
                    static_cast<unsigned>(static_cast<unsigned char>(c)));
      text += escaped.data();
    } else {
      text += c;
    }
  }
  return text + "\"";
}

}  // namespace

bool Limits::holds(double value) const {
  if (value == other) return true;
  const bool is_high_enough = is_low_open ? value > low : value >= low;
  const bool is_low_enough = is_high_open ? value < high : value <= high;
  return is_high_enough && is_low_enough;
}

std::string Limits::words() const {
  if (text_passes != nullptr) return std::string(text_words);
  std::string text;
  if (high == std::numeric_limits<double>::infinity())
    text = "at least " + number_text(low);
  else if (is_low_open)
    text = "greater than " + number_text(low) + " and at most " + number_text(high);
  else if (is_high_open)
    text = "at least " + number_text(low) + " and below " + number_text(high);
  else
    text = "between " + number_text(low) + " and " + number_text(high);
  if (!other_words.empty()) text += ", or " + number_text(other) + " for " + std::string(other_words);
  return text;
}

bool SettingRow::has_name(std::string_view key) const {
  return key == name || std::ranges::any_of(traits.old_names, [&key](std::string_view old) {
           return !old.empty() && key == old;
         });
}

bool SettingRow::is_text(std::string_view value) const {
  return kind == SettingKind::kText || kind == SettingKind::kWord ||
         (kind == SettingKind::kSchedule && !read_real(value));
}

std::string SettingRow::must_be() const {
  switch (kind) {
    case SettingKind::kBool:
      return "true or false";
    case SettingKind::kInt:
      return "a whole number";
    case SettingKind::kReal:
      return "a number";
    case SettingKind::kSchedule:
      return "a number, or numbers at growing env frames: 1e-3@0,1e-4@2e6 (steps), 1e-3@0..1e-4@2e6 (a line)";
    case SettingKind::kText:
      return "text";
    case SettingKind::kWord:
      return "one of " + joined(words());
  }
  return "";
}

std::span<const SettingRow> setting_rows() {
  static const std::vector<SettingRow> rows = make_rows();
  return rows;
}

const SettingRow* find_setting(std::string_view name) {
  for (const SettingRow& row : setting_rows())
    if (row.has_name(name)) return &row;
  const OtherName* other = find_other_name(name);
  if (other == nullptr) return nullptr;
  const std::string_view setting = other->applies_when.holds != nullptr ? other->sets[0] : other->setting;
  return setting.empty() ? nullptr : find_setting(setting);
}

std::vector<std::string> setting_names() {
  std::vector<std::string> names;
  for (const SettingRow& row : setting_rows()) {
    names.emplace_back(row.name);
    for (const std::string_view old : row.traits.old_names)
      if (!old.empty()) names.emplace_back(old);
  }
  return names;
}

std::string setting_text(const RunConfig& config, std::string_view name) {
  const SettingRow* row = find_setting(name);
  return row == nullptr ? "" : row->text(config);
}

std::string setting_toml(const SettingRow& row, const std::string& text) {
  return std::string(row.name) + " = " + (row.is_text(text) ? toml_string(text) : text) + "\n";
}

Status set(RunConfig& config, const std::string& origin, std::string_view key, std::string_view text) {
  std::string opposite;
  if (const OtherName* other = find_other_name(key)) {
    if (other->assign != nullptr) {
      RunConfig unused = config;
      return other->assign(other->applies(config) ? config : unused, origin, text);
    }
    if (other->setting.empty()) return other->accept(origin, text);
    bool value = false;
    if (parse(text, value)) text = opposite = to_text(!value);
  }
  const SettingRow* row = find_setting(key);
  if (row == nullptr) {
    const std::string hint = did_you_mean(key, setting_names());
    return Error{ErrorCode::kBadInput, origin + ": unknown setting '" + std::string(key) + "'" +
                                           (hint.empty() ? "; `comrad help train` lists them all" : hint)};
  }
  if (row->assign(config, text)) return {};
  const std::string hint = row->kind == SettingKind::kWord ? did_you_mean(text, row->words()) : "";
  return Error{ErrorCode::kBadInput, origin + ": " + std::string(key) + " is '" + std::string(text) +
                                         "'; it must be " + row->must_be() + hint};
}

Status check_limits(const RunConfig& config) {
  for (const SettingRow& row : setting_rows()) {
    if (row.holds(config, row.limits)) continue;
    const std::string value = row.text(config);
    const bool is_readable = row.kind != SettingKind::kText || is_utf8(value);
    return Error{ErrorCode::kBadInput, std::string(row.name) + " is " +
                                           (!is_readable ? "no UTF-8; it must be text in UTF-8"
                                                         : (value.empty() ? "empty" : value) +
                                                               "; it must be " + row.limits.words())};
  }
  return {};
}

Expected<std::vector<int64_t>> parse_widths(const std::string& text) {
  std::vector<int64_t> widths;
  std::string_view rest = trimmed(text);
  if (rest == "none") return widths;
  while (!rest.empty()) {
    const std::size_t end = std::min(rest.find_first_of(", "), rest.size());
    int64_t width = 0;
    if (!parse(rest.substr(0, end), width) || width < 1 || width > 8192 || widths.size() == 8)
      return Error{ErrorCode::kBadInput, "'" + text + "' must be " + std::string(kWidthsWords)};
    widths.push_back(width);
    if (end < rest.size() && rest[end] == ',' && trimmed(rest.substr(end + 1)).empty())
      return Error{ErrorCode::kBadInput, "'" + text + "' ends in a comma"};
    rest = trimmed(rest.substr(std::min(end + 1, rest.size())));
  }
  return widths;
}

}  // namespace comrad
