#include "rollout_buffer/core/flags.h"

#include <CLI/CLI.hpp>
#include <utility>

#include "rollout_buffer/core/process.h"

namespace comrad {

Flag& Flag::required() {
  option_->required();
  return *this;
}
Flag& Flag::range(double low, double high) {
  option_->check(CLI::Range(low, high));
  return *this;
}
Flag& Flag::one_of(std::initializer_list<const char*> words) {
  option_->check(CLI::IsMember(std::vector<std::string>(words.begin(), words.end())));
  return *this;
}
Flag& Flag::separated_by(char delimiter) {
  option_->delimiter(delimiter);
  return *this;
}
bool Flag::is_given() const { return option_->count() > 0; }

Flags::Flags(std::string description, std::string name)
    : app_(std::make_unique<CLI::App>(std::move(description), std::move(name))) {}
Flags::~Flags() = default;

Flag Flags::add(const std::string& names, bool& target, const std::string& help) {
  return Flag(app_->add_flag(names, target, help));
}
Flag Flags::add(const std::string& names, int& target, const std::string& help) {
  return Flag(app_->add_option(names, target, help));
}
Flag Flags::add(const std::string& names, uint64_t& target, const std::string& help) {
  return Flag(app_->add_option(names, target, help));
}
Flag Flags::add(const std::string& names, double& target, const std::string& help) {
  return Flag(app_->add_option(names, target, help));
}
Flag Flags::add(const std::string& names, std::string& target, const std::string& help) {
  return Flag(app_->add_option(names, target, help));
}
Flag Flags::add(const std::string& names, std::vector<int>& target, const std::string& help) {
  return Flag(app_->add_option(names, target, help));
}

std::optional<int> Flags::parse(int argc, const char* const* argv) {
  try {
    app_->parse(argc, argv);
  } catch (const CLI::ParseError& failure) {
    return app_->exit(failure) == 0 ? kExitDone : kExitBadInput;
  }
  return std::nullopt;
}

}  // namespace comrad
