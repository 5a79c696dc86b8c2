#include "deploy/commands/command.h"

#include <cstdio>

#include "deploy/settings/merged_settings.h"
#include "rollout_buffer/core/cores.h"

namespace comrad::deploy {

int print_settings_help(const std::string& command, const CommandLine& line) {
  if (line.typed().values.empty() && line.config_file().empty()) {
    std::fputs(line.help().c_str(), stdout);
    std::printf(
        "\nWith flags behind it, as `comrad help %s --algo vdn --scenario lava_pit`, this shows the values "
        "that hold for them.\n",
        command.c_str());
    return kExitDone;
  }
  const Expected<MergedSettings> merged =
      merge_new({line.config_file(), line.typed()}, describe_scenario, usable_cores());
  if (!merged) return report_error(command, merged.error());
  std::fputs(line.help(ValuesInForce{merged->config, merged->from}).c_str(), stdout);
  return kExitDone;
}

int report_error(const std::string& command, const Error& error) {
  std::fprintf(stderr, "comrad %s: error: %s\n", command.c_str(), error.message.c_str());
  return exit_code(error);
}

}  // namespace comrad::deploy
