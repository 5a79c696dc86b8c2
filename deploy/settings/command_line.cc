#include "deploy/settings/command_line.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <functional>
#include <optional>
#include <sstream>
#include <utility>

#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/other_names.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad::deploy {
namespace {

constexpr size_t kHelpColumn = 34;
constexpr size_t kHelpWidth = 110;

bool is_boolean_word(const std::string& word) {
  for (const char* known : {"true", "false", "True", "False", "TRUE", "FALSE", "1", "0"})
    if (word == known) return true;
  return false;
}

const char* value_name(SettingKind kind) {
  switch (kind) {
    case SettingKind::kBool:
      return "BOOL";
    case SettingKind::kInt:
      return "INT";
    case SettingKind::kReal:
      return "NUMBER";
    case SettingKind::kSchedule:
      return "SCHEDULE";
    case SettingKind::kText:
      return "TEXT";
    case SettingKind::kWord:
      return "WORD";
  }
  return "";
}

/// The help of a setting: what it is, the words that it takes where the help does not name them, its value and where that
/// comes from, what it applies with, old names.
std::string setting_help(const SettingRow& row, const std::optional<ValuesInForce>& values) {
  std::string help(row.help);
  if (row.kind == SettingKind::kWord)
    for (const std::string& word : row.words())
      if (row.help.find(word) == std::string_view::npos) {
        help += ": one of " + joined(row.words());
        break;
      }
  const auto shown = [](const std::string& value) { return value.empty() ? "empty" : value; };
  const std::string value = shown(row.text(RunConfig()));
  const std::string from = values ? values->from.at(std::string(row.name)) : "built-in";
  if (from == "built-in")
    help += " (default " + value;
  else
    help += " (" + shown(row.text(values->config)) + ", " + from + "; built-in " + value;
  if ((!values || !values->parts_idle) && !row.traits.applies_when.words.empty())
    help += "; with " + std::string(row.traits.applies_when.words);
  for (const std::string_view old : row.traits.old_names)
    if (!old.empty()) help += "; also --" + std::string(old);
  return help + ")";
}

/// "On policy" of on_policy, the name of a .def file.
std::string group_title(std::string_view subject) {
  std::string title(subject);
  std::ranges::replace(title, '_', ' ');
  if (!title.empty()) title[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(title[0])));
  return title;
}

/// "  --name VALUE   help", the help broken at kHelpWidth and aligned.
std::string help_line(const std::string& left, const std::string& help) {
  std::string text = "  " + left;
  size_t column = text.size();
  if (column + 2 > kHelpColumn) {
    text += "\n";
    column = 0;
  }
  text.append(kHelpColumn - column, ' ');
  column = kHelpColumn;
  size_t begin = 0;
  while (begin < help.size()) {
    const size_t end = std::min(help.find(' ', begin), help.size());
    if (column + (end - begin) > kHelpWidth) {
      text.back() = '\n';  // it was the space between two words
      text.append(kHelpColumn, ' ');
      column = kHelpColumn;
    }
    text.append(help, begin, end - begin);
    text += ' ';
    column += end - begin + 1;
    begin = end + 1;
  }
  while (!text.empty() && text.back() == ' ') text.pop_back();
  return text + "\n";
}

}  // namespace

struct CommandLine::Parser {
  struct Flag {
    std::string name;                       ///< canonical, no dashes
    std::vector<std::string> spelled = {};  ///< canonical and old names; none for a positional
    std::string help_text = {};             ///< ready to print; empty for settings
    const SettingRow* row = nullptr;        ///< of a setting that the help lists
    bool is_boolean = false;
    bool is_setting = false;
    bool is_a_list = false;      ///< every value counts, else the last one
    bool is_other_name = false;  ///< of a system that is not this one
    bool is_required = false;
    std::function<Status(const std::string&)> assign = {};  ///< empty for settings
    std::optional<std::string> typed = {};

    void take(std::string text) { typed = is_a_list && typed ? *typed + "," + text : std::move(text); }
  };

  std::vector<Flag> flags;
  std::vector<std::string>* words = nullptr;  ///< takes what no positional does
  std::string words_help;

  void add(Flag flag) { flags.push_back(std::move(flag)); }

  Flag* find(std::string_view spelled) {
    for (Flag& flag : flags)
      if (std::ranges::find(flag.spelled, spelled) != flag.spelled.end()) return &flag;
    return nullptr;
  }
  /// The first positional that nothing was typed for.
  Flag* next_positional() {
    for (Flag& flag : flags)
      if (flag.spelled.empty() && !flag.typed) return &flag;
    return nullptr;
  }

  std::vector<std::string> known_names() const {
    std::vector<std::string> names;
    for (const Flag& flag : flags)
      if (!flag.is_other_name) names.insert(names.end(), flag.spelled.begin(), flag.spelled.end());
    return names;
  }
};

CommandLine::CommandLine(std::string usage, std::string about)
    : parser_(std::make_unique<Parser>()), usage_(std::move(usage)), about_(std::move(about)) {}

CommandLine::~CommandLine() = default;

void CommandLine::add_settings(SettingsListed listed) {
  add_option("config", config_file_, "FILE",
             "settings from a TOML file; flags on the command line win over it");
  if (listed == SettingsListed::kAll)
    add_switch("all", all_requested_, "of the help: every setting, not only those that people change first");
  for (const SettingRow& row : setting_rows()) {
    Parser::Flag flag;
    flag.name = row.name;
    flag.spelled = {flag.name};
    for (const std::string_view old : row.traits.old_names)
      if (!old.empty()) flag.spelled.emplace_back(old);
    flag.is_setting = true;
    flag.is_a_list = row.traits.is_a_list;
    flag.is_boolean = row.kind == SettingKind::kBool;
    if (listed == SettingsListed::kAll || row.traits.used_by_eval) flag.row = &row;
    parser_->add(std::move(flag));
  }
  for (const OtherName& other : other_names()) {
    const std::string name(other.name);
    parser_->add({.name = name,
                  .spelled = {name},
                  .is_boolean = other.is_boolean,
                  .is_setting = true,
                  .is_other_name = true});
  }
}

void CommandLine::add_option(const std::string& name, std::string& target, const std::string& value_name,
                             const std::string& help) {
  Parser::Flag flag{
      .name = name, .spelled = {name}, .help_text = help_line("--" + name + " " + value_name, help)};
  flag.assign = [&target](const std::string& text) {
    target = text;
    return Status();
  };
  parser_->add(std::move(flag));
}

void CommandLine::add_option(const std::string& name, double& target, const std::string& value_name,
                             const std::string& help) {
  Parser::Flag flag{
      .name = name, .spelled = {name}, .help_text = help_line("--" + name + " " + value_name, help)};
  flag.assign = [&target, name](const std::string& text) -> Status {
    char* end = nullptr;
    const double number = std::strtod(text.c_str(), &end);
    if (text.empty() || *end != '\0' || !std::isfinite(number))
      return Error{ErrorCode::kBadInput, "--" + name + "=" + text + ": not a number"};
    target = number;
    return {};
  };
  parser_->add(std::move(flag));
}

void CommandLine::add_option(const std::string& name, std::vector<std::string>& target,
                             const std::string& value_name, const std::string& help) {
  Parser::Flag flag{
      .name = name, .spelled = {name}, .help_text = help_line("--" + name + " " + value_name, help)};
  flag.is_a_list = true;
  flag.assign = [&target, name](const std::string& text) -> Status {
    std::istringstream words(text + ",");
    for (std::string word; std::getline(words, word, ',');) {
      if (word.empty()) return Error{ErrorCode::kBadInput, "--" + name + "=" + text + ": the value is empty"};
      target.push_back(std::move(word));
    }
    return {};
  };
  parser_->add(std::move(flag));
}

void CommandLine::add_switch(const std::string& name, bool& target, const std::string& help) {
  Parser::Flag flag{.name = name, .spelled = {name}, .help_text = help_line("--" + name, help)};
  flag.is_boolean = true;
  flag.assign = [&target, name](const std::string& text) -> Status {
    if (!is_boolean_word(text))
      return Error{ErrorCode::kBadInput, "--" + name + "=" + text + ": must be True or False"};
    target = text == "1" || text[0] == 't' || text[0] == 'T';
    return {};
  };
  parser_->add(std::move(flag));
}

void CommandLine::add_positional(const std::string& name, std::string& target, const std::string& help) {
  Parser::Flag flag{.name = name, .help_text = help_line(name, help), .is_required = target.empty()};
  flag.assign = [&target](const std::string& text) {
    target = text;
    return Status();
  };
  parser_->add(std::move(flag));
}

void CommandLine::add_words(const std::string& name, std::vector<std::string>& target,
                            const std::string& help) {
  parser_->words = &target;
  parser_->words_help = help_line(name, help);
}

Status CommandLine::parse(std::span<const std::string> arguments) {
  const auto bad = [](std::string message) { return Error{ErrorCode::kBadInput, std::move(message)}; };
  std::string extras;
  for (size_t i = 0; i < arguments.size(); ++i) {
    const std::string& word = arguments[i];
    if (word == "-h" || word == "--help") {
      help_requested_ = true;
      continue;
    }
    if (!word.starts_with("--")) {
      if (Parser::Flag* positional = parser_->next_positional())
        positional->take(word);
      else if (parser_->words != nullptr)
        parser_->words->push_back(word);
      else
        extras += " '" + word + "'";
      continue;
    }
    const size_t equals = word.find('=');
    const std::string name = word.substr(2, equals == std::string::npos ? equals : equals - 2);
    Parser::Flag* flag = parser_->find(name);
    if (flag == nullptr) {
      const std::string nearest = nearest_word(name, parser_->known_names());
      return bad("unknown flag --" + name + (nearest.empty() ? "" : "; did you mean --" + nearest + "?") +
                 " (comrad help " + usage_.substr(0, usage_.find(' ')) + " lists every flag)");
    }
    const bool has_next = i + 1 < arguments.size();
    if (equals != std::string::npos) {
      flag->take(word.substr(equals + 1));
    } else if (flag->is_boolean) {
      flag->take(has_next && is_boolean_word(arguments[i + 1]) ? arguments[++i] : "True");
    } else {
      if (!has_next || arguments[i + 1].starts_with("--")) return bad("--" + name + " needs a value");
      flag->take(arguments[++i]);
    }
  }
  if (!extras.empty()) return bad("unexpected argument" + extras + "; usage: comrad " + usage_);
  for (const Parser::Flag& flag : parser_->flags)
    if (flag.is_required && !flag.typed && !help_requested_)
      return bad(flag.name + " is missing; usage: comrad " + usage_);

  for (const Parser::Flag& flag : parser_->flags) {
    if (!flag.typed) continue;
    if (flag.is_setting)
      typed_.values.emplace_back(flag.name, *flag.typed);
    else
      COMRAD_TRY(flag.assign(*flag.typed));
  }
  if (all_requested_ && !help_requested_)
    return bad("--all belongs to the help: comrad help " + usage_.substr(0, usage_.find(' ')) + " --all");
  return {};
}

bool CommandLine::was_typed(const std::string& name) const {
  for (const Parser::Flag& flag : parser_->flags)
    if (flag.name == name) return flag.typed.has_value();
  return false;
}

std::string CommandLine::help(const std::optional<ValuesInForce>& values, HelpExtent extent) const {
  std::string text = "usage: comrad " + usage_ + "\n\n" + about_ + "\n";
  std::string own = parser_->words_help, settings;
  std::vector<std::string> idle;
  std::string_view group;
  std::size_t left_out = 0;
  for (const Parser::Flag& flag : parser_->flags) {
    own += flag.help_text;
    if (flag.row == nullptr) continue;
    if (extent == HelpExtent::kFirst && !flag.row->traits.is_changed_first) {
      ++left_out;
      continue;
    }
    if (values && values->parts_idle && !flag.row->applies(values->config)) {
      idle.push_back(flag.name);
      continue;
    }
    if (extent == HelpExtent::kAll && flag.row->subject != group) {
      group = flag.row->subject;
      settings += "\n" + group_title(group) + "\n";
    }
    settings +=
        help_line("--" + flag.name + " " + value_name(flag.row->kind), setting_help(*flag.row, values));
  }
  if (!own.empty()) text += "\nThis command:\n" + own;
  if (!settings.empty())
    text +=
        "\nSettings (built-in < algorithm < preset < scenario < TOML file < command line; `comrad config`\n"
        "shows the result):\n" +
        settings;
  if (left_out > 0)
    text += fmt::format("\n{} more: comrad help {} --all\n", left_out, usage_.substr(0, usage_.find(' ')));
  if (!idle.empty()) text += "\nWithout effect with these values:\n" + help_line("", joined(idle));
  return text;
}

}  // namespace comrad::deploy
