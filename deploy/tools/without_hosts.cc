// What takes the place of deploy/hosts, `comrad serve`, `comrad join` and `comrad doctor --hosts` in a build with
// -DCOMRAD_HOSTS=OFF.
#include "deploy/hosts/host_calls.h"
#include "deploy/hosts/serving.h"
#include "deploy/run/command.h"
#include "deploy/tools/doctor_hosts.h"

namespace comrad::deploy {
namespace {

Error without_hosts(const std::string& what) {
  return Error{ErrorCode::kUnsupported,
               what + ": this build of comrad plays on one host only (COMRAD_HOSTS is OFF); " +
                   "configure it with -DCOMRAD_HOSTS=ON and build it again"};
}

}  // namespace

int serve_command(Arguments) { return report_error("serve", without_hosts("comrad serve")); }
int join_command(Arguments) { return report_error("join", without_hosts("comrad join")); }

std::vector<CheckResult> check_hosts(const std::string& where, const RunConfig&) {
  return {{where, CheckLevel::kFail, without_hosts("--hosts").message, "see deploy/HOSTS.md"}};
}

std::string environment_variable(const char*) { return ""; }

std::vector<HostStart> host_calls(const RunConfig&, const Variable&, const std::string&) { return {}; }

Status prepare_serving(RunConfig& config, const std::string&) {
  if (config.hosts.link == LinkKind::kDds) return without_hosts("--link dds");
  if (!config.hosts.hosts.empty() && config.hosts.hosts != "none") return without_hosts("--hosts");
  if (config.hosts.serve) return without_hosts("--serve");
  return {};
}
Expected<std::string> open_join_endpoint(const std::string&, const RunConfig&, const std::string&) {
  return without_hosts("--serve");
}
HostStart own_simulators(const RunConfig&, const std::string&, const std::string&) { return {}; }
std::string join_note(const std::string&, const RunConfig&) { return ""; }

}  // namespace comrad::deploy
