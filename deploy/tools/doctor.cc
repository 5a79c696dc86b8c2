// `comrad doctor`: looks at the machine, line by line OK, WARN or FAIL, and reports what to do.

#include <cstdio>
#include <nlohmann/json.hpp>

#include "deploy/process/child_program.h"
#include "deploy/run/command.h"
#include "deploy/settings/command_line.h"
#include "deploy/tools/doctor_hosts.h"
#include "deploy/tools/machine_check.h"

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

int examine(bool json, const std::string& hosts, const RunConfig& config) {
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
  const auto finish = [&] {
    if (json) std::printf("%s\n", nlohmann::ordered_json{{"ok", !failed}, {"checks", checks}}.dump().c_str());
    return failed ? kExitFailed : kExitDone;
  };
  if (!hosts.empty()) {
    for (const CheckResult& result : check_limits())
      if (result.name == "receive buffers") report(result);
    for (const CheckResult& result : check_hosts(hosts, config)) report(result);
    return finish();
  }
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
  return finish();
}

}  // namespace

int doctor_command(Arguments arguments) {
  bool json = false;
  CommandLine line(
      "doctor [--json] [--hosts ADDRESS or NAMES]",
      "Checks packages, what plots and the tests need, IWAD, BLAS, memory, disk, limits, DDS over loopback, "
      "rendering, "
      "inference, libtorch and CUDA.\n"
      "With --hosts: latency, bandwidth and clocks between this host and others. ADDRESS is that of a run "
      "that serves\n(as for `comrad join`); NAMES are asked through ssh, from the host that will learn.\n"
      "Every line begins with OK, WARN or FAIL and ends with what to do, if anything. Exit code 1 on FAIL.");
  std::string hosts, interface;
  RunConfig config;
  line.add_option("hosts", hosts, "ADDRESS|NAMES",
                  "measure the connection to a serving run, or from hosts a,b,c to this one");
  line.add_option("interface", interface, "NAME", "network interface; default: the one that leads there");
  line.add_switch("insecure_network", config.hosts.insecure_network, "measure on a network without keys");
  line.add_switch("json", json, "print one JSON object on stdout and nothing else");
  return run_command("doctor", line, arguments, [&]() -> Expected<int> {
    if (!interface.empty()) config.hosts.interface = interface;
    return examine(json, hosts, config);
  });
}

}  // namespace comrad::deploy
