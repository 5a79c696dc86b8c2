// What bash needs to complete `comrad ...`: the commands, their flags and the words that follow them, as a script. zsh reads
// it too (bashcompinit). Pure text; completion.cc finds out what there is.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace comrad::deploy {

struct CompletedFlag {
  std::vector<std::string>
      names;  ///< without dashes; the first is offered, old names behind it are understood
  bool takes_value = false;
  std::vector<std::string> words = {};  ///< values to offer; none: names of files
};

struct CompletedCommand {
  std::string name;
  std::vector<std::string> words = {};  ///< that may follow without dashes; none: names of files
  std::vector<CompletedFlag> flags = {};
};

/// The flags that a `--help` text lists, ours or CLI11's: a line each that begins with two blanks and dashes.
std::vector<CompletedFlag> flags_of_help(std::string_view help);

/// Words that a shell could take for more than a word are left out.
std::string completion_script(const std::vector<CompletedCommand>& commands);

}  // namespace comrad::deploy
