// The flags of a program, by CLI11: its headers cost 5 s of compiling in every source that includes them, so flags.cc alone
// does. Stage: beside the flow.
#pragma once

#include <cstdint>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace comrad {

/// One flag, to say more about. Valid as long as its Flags.
class Flag {
 public:
  explicit Flag(CLI::Option* option) : option_(option) {}

  Flag& required();
  Flag& range(double low, double high);  ///< both ends allowed
  Flag& one_of(std::initializer_list<const char*> words);
  Flag& separated_by(char delimiter);  ///< of a list: 3,2
  bool is_given() const;

 private:
  CLI::Option* option_;
};

/// Adds flags that write into variables, then reads a command line. A variable keeps its value where its flag is not given,
/// and outlives parse(). Threads: main.
class Flags {
 public:
  /// `name` of the program and what it is for, for --help.
  Flags(std::string description, std::string name);
  ~Flags();

  /// `names` as "--seed" or "-o,--out"; `help` in one line for --help.
  Flag add(const std::string& names, bool& target, const std::string& help);
  Flag add(const std::string& names, int& target, const std::string& help);
  Flag add(const std::string& names, uint64_t& target, const std::string& help);
  Flag add(const std::string& names, double& target, const std::string& help);
  Flag add(const std::string& names, std::string& target, const std::string& help);
  Flag add(const std::string& names, std::vector<int>& target, const std::string& help);

  /// The exit code to end with (core/process.h) after --help or a command line that cannot be read, which is printed; else
  /// nothing.
  std::optional<int> parse(int argc, const char* const* argv);

 private:
  std::unique_ptr<CLI::App> app_;
};

}  // namespace comrad
