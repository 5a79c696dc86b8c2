#include "deploy/run/command.h"

#include <cstdio>

#include "deploy/settings/merged_settings.h"
#include "rollout_buffer/core/cores.h"

namespace comrad::deploy {

int print_settings_help(const std::string& command, const CommandLine& line) {
  const Expected<MergedSettings> merged =
      merge_new({line.config_file(), line.typed()}, describe_scenario, usable_cores());
  if (!merged) return report_error(command, merged.error());
  const RunConfig& config = merged->config;
  const bool asks_for_some = !line.typed().values.empty() || !line.config_file().empty();
  std::fputs(line.help(ValuesInForce{config, merged->from, asks_for_some}, line.help_extent()).c_str(),
             stdout);
  std::printf(
      "\nThe values are those of %s with %s, preset %s, on this machine; with flags behind it, as `comrad "
      "help "
      "%s --algo vdn --scenario lava_pit`, those that hold for them.\n",
      config.run.scenario.c_str(), config.run.algo.name().c_str(), word_of(config.run.preset),
      command.c_str());
  return kExitDone;
}

int run_command(const std::string& command, CommandLine& line, Arguments arguments,
                const std::function<Expected<int>()>& work) {
  if (const Status parsed = line.parse(arguments); !parsed) return report_error(command, parsed.error());
  if (line.help_requested()) {
    std::fputs(line.help().c_str(), stdout);
    return kExitDone;
  }
  const Expected<int> done = work();
  return done ? *done : report_error(command, done.error());
}

int report_error(const std::string& command, const Error& error) {
  std::fprintf(stderr, "comrad %s: error: %s\n", command.c_str(), error.message.c_str());
  return exit_code(error);
}

}  // namespace comrad::deploy
