// `comrad doctor`: looks at the machine, line by line OK, WARN or FAIL, and says what to do.

#include <cstdio>
#include <nlohmann/json.hpp>

#include "deploy/commands/command.h"
#include "deploy/commands/machine_check.h"
#include "deploy/process/child_program.h"
#include "deploy/settings/command_line.h"

namespace comrad::deploy {
namespace {

const char* level_text(CheckLevel level) {
  switch (level) {
    case CheckLevel::kOk:
      return "OK";
    case CheckLevel::kWarn:
      return "WARN";
    case CheckLevel::kFail:
      return "FAIL";
  }
  return "FAIL";
}

int examine(bool json) {
  nlohmann::ordered_json checks = nlohmann::ordered_json::array();
  bool failed = false;
  auto report = [&](const CheckResult& result) {
    failed |= result.level == CheckLevel::kFail;
    if (json) {
      checks.push_back({{"name", result.name},
                        {"level", level_text(result.level)},
                        {"found", result.found},
                        {"action", result.action}});
      return;
    }
    std::printf("%-4s  %-16s %s\n", level_text(result.level), result.name.c_str(), result.found.c_str());
    if (!result.action.empty()) std::printf("      %-16s -> %s\n", "", result.action.c_str());
    std::fflush(stdout);
  };
  // What builds and tests need concerns an installed program no more.
  if (!is_installed()) report(check_packages());
  report(check_report_packages());
  if (!is_installed()) {
    report(check_test_packages());
    report(check_test_python());
  }
  report(check_iwad());
  report(check_blas());
  report(check_memory());
  report(check_disk());
  for (const CheckResult& result : check_limits()) report(result);
  report(check_dds());
  report(check_rendering());
  report(check_inference());
  for (const CheckResult& result : check_libtorch()) report(result);
  if (json) std::printf("%s\n", nlohmann::ordered_json{{"ok", !failed}, {"checks", checks}}.dump().c_str());
  return failed ? kExitFailed : kExitDone;
}

}  // namespace

int doctor_command(Arguments arguments) {
  bool json = false;
  CommandLine line(
      "doctor [--json]",
      "Checks packages, what plots and the tests need, IWAD, BLAS, memory, disk, limits, DDS over loopback, "
      "rendering, "
      "inference, libtorch and CUDA.\n"
      "Every line says OK, WARN or FAIL and, where there is something to do, what. Exit code 1 on FAIL.");
  line.add_switch("json", json, "print one JSON object on stdout and nothing else");
  if (const Status parsed = line.parse(arguments); !parsed) return report_error("doctor", parsed.error());
  if (line.help_requested()) {
    std::fputs(line.help().c_str(), stdout);
    return kExitDone;
  }
  return examine(json);
}

}  // namespace comrad::deploy
