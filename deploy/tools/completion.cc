// `comrad completion`: a script with which bash completes commands, flags and their values. Flags are those that each
// command's `--help` lists; the words of a setting come from its row.

#include <cstdio>
#include <nlohmann/json.hpp>

#include "deploy/process/child_program.h"
#include "deploy/run/command.h"
#include "deploy/settings/command_line.h"
#include "deploy/tools/completion_script.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad::deploy {
namespace {

constexpr const char* kScenarioFlag = "scenario";
constexpr const char* kShell = "bash";

Expected<std::vector<std::string>> scenario_names() {
  COMRAD_TRY_ASSIGN(const ProgramResult result,
                    run_program({sibling_program("comrad-scenarios"), "list", "--json"}));
  if (result.exit_code != 0) return Error{ErrorCode::kSystem, last_words(result)};
  const auto json = nlohmann::json::parse(result.output, nullptr, /*allow_exceptions=*/false);
  std::vector<std::string> names;
  if (const auto all = json.is_object() ? json.find("scenarios") : json.end(); all != json.end())
    for (const auto& one : *all)
      if (one.is_object() && one.contains("name") && one["name"].is_string()) names.push_back(one["name"]);
  if (names.empty()) return Error{ErrorCode::kBadFormat, "comrad-scenarios list --json names no scenario"};
  return names;
}

/// What a setting's row adds to the flag beyond the line of the help.
void complete_from_row(CompletedFlag& flag, const SettingRow& row) {
  for (const std::string_view old : row.traits.old_names)
    if (!old.empty()) flag.names.emplace_back(old);
  if (row.kind == SettingKind::kWord) flag.words = row.words();
  if (row.kind == SettingKind::kBool) flag.words = {"True", "False"};
}

Expected<CompletedCommand> completed(const Command& command, const std::vector<std::string>& scenarios) {
  CompletedCommand result{.name = command.name};
  std::vector<std::string> words = {sibling_program("comrad"), command.name, "--help"};
  COMRAD_TRY_ASSIGN(ProgramResult help, run_program(words));
  if (help.output.find("comrad help " + command.name + " --all") != std::string::npos) {
    words.emplace_back("--all");
    COMRAD_TRY_ASSIGN(help, run_program(words));
  }
  if (help.exit_code != 0)
    return Error{ErrorCode::kSystem, "comrad " + command.name + " --help: " + last_words(help)};
  const bool takes_settings = help.output.find("\nSettings (") != std::string::npos;
  result.flags = flags_of_help(help.output);
  for (CompletedFlag& flag : result.flags) {
    if (const SettingRow* row = takes_settings ? find_setting(flag.names[0]) : nullptr)
      complete_from_row(flag, *row);
    if (flag.names[0] == kScenarioFlag) flag.words = scenarios;
  }
  for (const std::string& word : command.words) {
    if (word == kAnyScenario)
      result.words.insert(result.words.end(), scenarios.begin(), scenarios.end());
    else
      result.words.push_back(word);
  }
  return result;
}

Expected<std::string> script_for(const std::string& shell) {
  if (shell != kShell)
    return Error{ErrorCode::kBadInput, unknown_word("shell", shell, {kShell}) +
                                           "; zsh reads bash's script (comrad completion --help)"};
  COMRAD_TRY_ASSIGN(const std::vector<std::string> scenarios, scenario_names());
  std::vector<CompletedCommand> all;
  CompletedCommand help{.name = "help"};
  for (const Command& command : commands()) {
    COMRAD_TRY_ASSIGN(CompletedCommand one, completed(command, scenarios));
    help.words.push_back(one.name);
    all.push_back(std::move(one));
  }
  all.push_back(std::move(help));
  all.push_back({.name = "version"});
  return completion_script(all);
}

}  // namespace

int completion_command(Arguments arguments) {
  std::string shell;
  CommandLine line(
      "completion bash",
      "Prints a script with which the shell completes commands, flags, their values and names of scenarios. "
      "For this shell:\n  source <(comrad completion bash)\nzsh reads it after\n"
      "  autoload -U compinit bashcompinit && compinit && bashcompinit");
  line.add_positional("SHELL", shell, kShell);
  return run_command("completion", line, arguments, [&]() -> Expected<int> {
    COMRAD_TRY_ASSIGN(const std::string script, script_for(shell));
    std::fputs(script.c_str(), stdout);
    return kExitDone;
  });
}

}  // namespace comrad::deploy
