#include "deploy/tools/completion_script.h"

#include <algorithm>
#include <cctype>

#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

/// Shells expand some characters of a word list; names of scenarios are folders that any user may have made.
bool is_plain(std::string_view word) {
  return !word.empty() && std::ranges::all_of(word, [](unsigned char c) {
    return std::isalnum(c) != 0 || c == '_' || c == '-' || c == '.' || c == ':';
  });
}

std::vector<std::string> plain(std::vector<std::string> words) {
  std::erase_if(words, [](const std::string& word) { return !is_plain(word); });
  return words;
}

std::vector<std::string> dashed(const std::vector<CompletedFlag>& flags) {
  std::vector<std::string> names;
  for (const CompletedFlag& flag : flags) names.push_back("--" + flag.names.front());
  return names;
}

/// Sets `found` to the words that fit. `command`, `flag` (the one that a value is typed for, or empty) and `cur` are set
/// before.
std::string choice_of_words(const std::vector<CompletedCommand>& commands) {
  std::string text = "  case \"${command}\" in\n";
  for (const CompletedCommand& command : commands) {
    text += "    " + command.name + ")\n      case \"${flag}\" in\n";
    for (const CompletedFlag& flag : command.flags) {
      if (!flag.takes_value && flag.words.empty()) continue;
      text += "        --" + joined(flag.names, "|--") + ") found=\"" + joined(plain(flag.words), " ") +
              "\" ;;\n";
    }
    text += "        *)\n          if [[ \"${cur}\" == -* ]]; then found=\"" +
            joined(dashed(command.flags), " ") + "\"\n          else found=\"" +
            joined(plain(command.words), " ") + "\"; fi ;;\n      esac ;;\n";
  }
  return text + "  esac\n";
}

std::string names_of(const std::vector<CompletedCommand>& commands) {
  std::vector<std::string> names;
  for (const CompletedCommand& command : commands) names.push_back(command.name);
  return joined(names, " ");
}

/// Whether what is typed behind this flag is its value: a switch has none.
std::string value_flags(const std::vector<CompletedCommand>& commands) {
  std::vector<std::string> names;
  for (const CompletedCommand& command : commands)
    for (const CompletedFlag& flag : command.flags)
      if (flag.takes_value)
        for (const std::string& name : flag.names) names.push_back("--" + name);
  std::ranges::sort(names);
  names.erase(std::unique(names.begin(), names.end()), names.end());
  return joined(names, "|");
}

}  // namespace

std::vector<CompletedFlag> flags_of_help(std::string_view help) {
  std::vector<CompletedFlag> flags;
  const auto is_name = [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '-';
  };
  while (!help.empty()) {
    std::string_view line = help.substr(0, help.find('\n'));
    help.remove_prefix(std::min(help.size(), line.size() + 1));
    if (!line.starts_with("  -")) continue;
    line.remove_prefix(2);
    CompletedFlag flag;
    for (bool more = true; more;) {  // "-o,--out"
      const std::size_t dashes = std::min(line.find_first_not_of('-'), line.size());
      line.remove_prefix(dashes);
      const auto end = static_cast<std::size_t>(std::ranges::find_if_not(line, is_name) - line.begin());
      if (dashes == 2 && end > 0) flag.names.emplace_back(line.substr(0, end));
      line.remove_prefix(end);
      if (line.starts_with("{"))
        line.remove_prefix(std::min(line.size(), line.find('}') + 1));  // what "--no-x" sets
      more = line.starts_with(",-");
      if (more) line.remove_prefix(1);
    }
    if (flag.names.empty()) continue;
    // "--out TEXT", "--format TEXT:{udmf,hexen}=udmf"; a switch has its help there, further to the right.
    flag.takes_value = line.size() > 1 && line[0] == ' ' && line[1] != ' ';
    if (flag.takes_value) {
      line.remove_prefix(1);
      const std::string_view value = line.substr(0, line.find(' '));
      if (const std::size_t open = value.find(":{"); open != std::string_view::npos) {
        std::string_view words = value.substr(open + 2, value.find('}') - open - 2);
        while (!words.empty()) {
          const std::string_view word = words.substr(0, words.find(','));
          flag.words.emplace_back(word);
          words.remove_prefix(std::min(words.size(), word.size() + 1));
        }
      }
    }
    flags.push_back(std::move(flag));
  }
  return flags;
}

std::string completion_script(const std::vector<CompletedCommand>& commands) {
  return R"(# Completion of comrad for bash, written by `comrad completion bash`. To use it:
#   source <(comrad completion bash)
_comrad() {
  local cur="${COMP_WORDS[COMP_CWORD]}" prev="${COMP_WORDS[COMP_CWORD - 1]}" command="${COMP_WORDS[1]}" flag="" found=""
  COMPREPLY=()
  if ((COMP_CWORD == 1)); then
    COMPREPLY=($(compgen -W ")" +
         names_of(commands) + R"(" -- "${cur}"))
    return
  fi
  # "--flag=value" comes as three words.
  if [[ "${cur}" == "=" ]]; then
    cur="" flag="${prev}"
  elif [[ "${prev}" == "=" ]]; then
    flag="${COMP_WORDS[COMP_CWORD - 2]}"
  elif [[ "${cur}" != -* ]]; then
    case "${prev}" in
      )" +
         value_flags(commands) +
         R"() flag="${prev}" ;;
    esac
  fi
)" + choice_of_words(commands) +
         R"(  COMPREPLY=($(compgen -W "${found}" -- "${cur}"))
}
complete -o default -F _comrad comrad
)";
}

}  // namespace comrad::deploy
