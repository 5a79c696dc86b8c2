#include "deploy/config/command_line.h"

#include <CLI/CLI.hpp>
#include <cmath>
#include <deque>
#include <functional>
#include <type_traits>
#include <utility>

#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

constexpr size_t kHelpColumn = 34;
constexpr size_t kHelpWidth = 110;

bool is_boolean_word(const std::string& word) {
  for (const char* known : {"true", "false", "True", "False", "TRUE", "FALSE", "1", "0"})
    if (word == known) return true;
  return false;
}

std::string default_text(const std::string& value) { return value.empty() ? "empty" : value; }
std::string default_text(int64_t value) { return std::to_string(value); }
std::string default_text(bool value) { return value ? "True" : "False"; }
std::string default_text(double value) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.10g", value);
  return text;
}

template <typename T>
std::string value_name(const T&) {
  if constexpr (std::is_same_v<T, bool>) return "BOOL";
  if constexpr (std::is_same_v<T, int64_t>) return "INT";
  if constexpr (std::is_same_v<T, double>) return "NUMBER";
  return "TEXT";
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

/// CLI11's view of the flags: each one is a text option; types are checked where the text is used.
struct CommandLine::Parser {
  struct Flag {
    std::string name;                       ///< canonical, no dashes
    std::vector<std::string> spelled = {};  ///< canonical and old names
    std::string help_text = {};             ///< ready to print
    bool is_boolean = false;
    bool is_setting = false;
    bool is_positional = false;
    std::string text = {};  ///< what was typed last
    CLI::Option* option = nullptr;
    std::function<Status(const std::string&)> assign = {};  ///< empty for settings
  };

  CLI::App app;
  std::deque<Flag> flags;  ///< a deque: CLI11 keeps references to `text`

  Flag& add(Flag flag) {
    flags.push_back(std::move(flag));
    Flag& kept = flags.back();
    std::string spelled;
    for (const std::string& name : kept.spelled) spelled += (spelled.empty() ? "--" : ",--") + name;
    if (kept.is_positional) spelled = kept.name;
    kept.option = app.add_option(spelled, kept.text)->multi_option_policy(CLI::MultiOptionPolicy::TakeLast);
    return kept;
  }

  const Flag* find(const std::string& spelled) const {
    for (const Flag& flag : flags)
      for (const std::string& name : flag.spelled)
        if (name == spelled) return &flag;
    return nullptr;
  }

  std::vector<std::string> known_names() const {
    std::vector<std::string> names;
    for (const Flag& flag : flags) names.insert(names.end(), flag.spelled.begin(), flag.spelled.end());
    return names;
  }
};

CommandLine::CommandLine(std::string usage, std::string about)
    : parser_(std::make_unique<Parser>()), usage_(std::move(usage)), about_(std::move(about)) {
  parser_->app.set_help_flag("");
  parser_->app.set_config();  // files of settings go through read_settings_toml, which names unknown keys
}

CommandLine::~CommandLine() = default;

void CommandLine::add_settings() {
  add_option("config", config_file_, "FILE",
             "settings from a TOML file; flags on the command line win over it");
  RunConfig defaults;
  visit_settings(defaults, [this](const char* name, auto& value, const char* help,
                                  std::initializer_list<const char*> aliases) {
    Parser::Flag flag;
    flag.name = name;
    flag.spelled = {name};
    for (const char* alias : aliases) flag.spelled.push_back(alias);
    flag.is_setting = true;
    flag.is_boolean = std::is_same_v<std::decay_t<decltype(value)>, bool>;
    std::string text = std::string(help) + " (default " + default_text(value);
    for (const char* alias : aliases) text += std::string("; also --") + alias;
    flag.help_text = help_line("--" + flag.name + " " + value_name(value), text + ")");
    parser_->add(std::move(flag));
  });
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
  Parser::Flag flag{.name = name, .help_text = help_line(name, help), .is_positional = true};
  flag.assign = [&target](const std::string& text) {
    target = text;
    return Status();
  };
  Parser::Flag& kept = parser_->add(std::move(flag));
  if (target.empty()) kept.option->required();
}

Status CommandLine::parse(std::span<const std::string> arguments) {
  // Unknown flags are named before CLI11 sees anything, so that it can never take one for a value. A boolean
  // is given its value here: CLI11 has no option that takes the next word only if it is a boolean.
  std::vector<std::string> words;
  for (size_t i = 0; i < arguments.size(); ++i) {
    const std::string& word = arguments[i];
    if (word == "-h" || word == "--help") {
      help_requested_ = true;
      return {};
    }
    if (!word.starts_with("--")) {
      words.push_back(word);
      continue;
    }
    const size_t equals = word.find('=');
    const std::string name = word.substr(2, equals == std::string::npos ? equals : equals - 2);
    const Parser::Flag* flag = parser_->find(name);
    if (flag == nullptr) {
      const std::string nearest = nearest_word(name, parser_->known_names());
      return Error{ErrorCode::kBadInput, "unknown flag --" + name +
                                             (nearest.empty() ? "" : "; did you mean --" + nearest + "?") +
                                             " (comrad help lists every flag)"};
    }
    if (equals != std::string::npos) {
      words.push_back("--" + name);
      words.push_back(word.substr(equals + 1));
    } else if (flag->is_boolean) {
      const bool has_value = i + 1 < arguments.size() && is_boolean_word(arguments[i + 1]);
      words.push_back(word);
      words.push_back(has_value ? arguments[++i] : "True");
    } else {
      if (i + 1 >= arguments.size() || arguments[i + 1].starts_with("--"))
        return Error{ErrorCode::kBadInput, "--" + name + " needs a value"};
      words.push_back(word);
      words.push_back(arguments[++i]);
    }
  }

  try {
    std::vector<std::string> reversed(words.rbegin(), words.rend());
    parser_->app.parse(reversed);
  } catch (const CLI::ExtrasError&) {
    std::string extras;
    for (const std::string& word : parser_->app.remaining()) extras += " '" + word + "'";
    return Error{ErrorCode::kBadInput, "unexpected argument" + extras + "; usage: comrad " + usage_};
  } catch (const CLI::ParseError& error) {
    return Error{ErrorCode::kBadInput, std::string(error.what()) + "; usage: comrad " + usage_};
  }

  for (const Parser::Flag& flag : parser_->flags) {
    if (flag.option->count() == 0) continue;
    if (flag.is_setting)
      typed_.values.emplace_back(flag.name, flag.text);
    else
      COMRAD_TRY(flag.assign(flag.text));
  }
  return {};
}

bool CommandLine::was_typed(const std::string& name) const {
  for (const Parser::Flag& flag : parser_->flags)
    if (flag.name == name) return flag.option->count() > 0;
  return false;
}

std::string CommandLine::help() const {
  std::string text = "usage: comrad " + usage_ + "\n\n" + about_ + "\n";
  std::string own, settings;
  for (const Parser::Flag& flag : parser_->flags) (flag.is_setting ? settings : own) += flag.help_text;
  if (!own.empty()) text += "\nThis command:\n" + own;
  if (!settings.empty())
    text +=
        "\nSettings (built-in < algorithm < preset < TOML file < command line; `comrad config` shows the "
        "result):\n" +
        settings;
  return text;
}

}  // namespace comrad::deploy
