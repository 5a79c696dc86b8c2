#include "deploy/tools/doctor_hosts.h"

#include <sys/random.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>

#include "deploy/hosts/host_calls.h"
#include "deploy/process/child_process.h"
#include "deploy/process/child_program.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/link/join/link_address.h"

namespace comrad::deploy {
namespace {

constexpr double kAnswerWaitS = 20;
constexpr double kHostTimeoutS = 60;
constexpr double kFarMs = 20;        // 4 trajectories of a host are under way at once
constexpr double kNarrowUp = 12e6;   // bytes/s: 100 Mbit/s
constexpr double kNarrowDown = 5e6;  // bytes/s
constexpr double kClockApartMs = 1000;

template <typename... Numbers>
std::string text(const char* format, Numbers... numbers) {
  char buffer[256];
  std::snprintf(buffer, sizeof buffer, format, numbers...);
  return buffer;
}

CheckResult failed(const std::string& name, const Error& error) {
  return {name, CheckLevel::kFail, error.message, "see deploy/HOSTS.md"};
}

Expected<uint64_t> fresh_id() {
  uint64_t id = 0;
  if (getrandom(&id, sizeof id, 0) != sizeof id) return system_error("getrandom");
  return id;
}

Expected<link::LinkReport> measure_link(const link::LinkAddress& address, const RunConfig& config) {
  COMRAD_TRY_ASSIGN(const std::string interface, link::interface_towards(address.host));
  COMRAD_TRY_ASSIGN(const uint64_t visitor, fresh_id());
  COMRAD_TRY_ASSIGN(dds::LinkBus bus,
                    dds::LinkBus::open(link::joining_config(address, config.hosts, interface)));
  link::JoinClient client(bus, visitor, kAnswerWaitS);
  return link::check_link(bus, client);
}

/// Lets one host measure the connection to this one.
std::vector<CheckResult> ask_host(const HostStart& call, const RunConfig& config) {
  const auto checked = [&]() -> Expected<std::vector<CheckResult>> {
    link::LinkAddress address{.port_base = static_cast<uint32_t>(config.hosts.port_base)};
    COMRAD_TRY_ASSIGN(address.link_id, fresh_id());
    COMRAD_TRY_ASSIGN(address.host, link::address_of_interface(config.hosts.interface));
    COMRAD_TRY_ASSIGN(dds::LinkBus bus,
                      dds::LinkBus::open(link::serving_config(address.link_id, config.hosts)));
    const link::JoinEndpoint endpoint{link::Offer()};
    COMRAD_TRY_ASSIGN(ChildProcess child,
                      ChildProcess::spawn({.program = call.command[0],
                                           .arguments = {call.command.begin() + 1, call.command.end()},
                                           .environment = {},
                                           .takes_input = true}));
    child.write_input(link::text_of(address) + "\n");
    std::string said;
    nlohmann::json report;
    std::optional<ExitStatus> how;
    for (const double end_s = monotonic_s() + kHostTimeoutS; !how && monotonic_s() < end_s;) {
      bus.take_questions(
          [&](const dds::JoinQuestion& question) { (void)bus.write(endpoint.answer(question)); });
      bus.take<dds::TrajectoryFragment>([](const dds::TrajectoryFragment&) {});
      bus.wait(20);
      how = child.poll_exit();
      for (const std::string& one : child.read_lines()) {
        said = one;
        if (one.starts_with("{")) report = nlohmann::json::parse(one, nullptr, /*allow_exceptions=*/false);
      }
    }
    if (!report.is_object() || !report.contains("checks"))
      return Error{ErrorCode::kPeerLost, how ? how->text() + (said.empty() ? "" : ": " + said)
                                             : "no answer within 60 s" + (said.empty() ? "" : ": " + said)};
    std::vector<CheckResult> results;
    for (const auto& check : report["checks"])
      results.push_back({call.name.substr(call.name.find(' ') + 1) + ": " + check.value("name", ""),
                         check.value("level", "") == "OK"     ? CheckLevel::kOk
                         : check.value("level", "") == "WARN" ? CheckLevel::kWarn
                                                              : CheckLevel::kFail,
                         check.value("found", ""), check.value("action", "")});
    return results;
  };
  const Expected<std::vector<CheckResult>> results = checked();
  return results ? *results : std::vector<CheckResult>{failed(call.name, results.error())};
}

}  // namespace

std::vector<CheckResult> judge_link(const link::LinkReport& link) {
  std::vector<CheckResult> results;
  const auto add = [&](const std::string& what, bool is_good, const std::string& found,
                       const std::string& action) {
    results.push_back({what, is_good ? CheckLevel::kOk : CheckLevel::kWarn, found, is_good ? "" : action});
  };
  add("latency", link.round_trip_ms_median < kFarMs,
      text("round trip %.2f ms (%.2f to %.2f)", link.round_trip_ms_median, link.round_trip_ms_min,
           link.round_trip_ms_max),
      text(
          "of a host 4 trajectories are under way at once, so it delivers at most %.0f a second; longer ones "
          "(--rollout) carry more, a nearer host too",
          4000 / link.round_trip_ms_median));
  add("to the learner", link.up_bytes_per_s >= kNarrowUp, text("%.1f MB/s", link.up_bytes_per_s / 1e6),
      "trajectories need about 22 kB for a decision (deploy/HOSTS.md): use a faster interface (--interface), "
      "or "
      "fewer simulators here");
  add("from the learner", link.down_bytes_per_s >= kNarrowDown,
      text("%.1f MB/s", link.down_bytes_per_s / 1e6),
      "weights arrive late, so what is played is old: use a faster interface (--interface)");
  add("clocks", std::abs(link.clock_ahead_ms) < kClockApartMs,
      text("this host's is %.1f ms %s", std::abs(link.clock_ahead_ms),
           link.clock_ahead_ms >= 0 ? "ahead" : "behind"),
      "only the times in logs depend on it: let both follow one time server (apt install chrony)");
  return results;
}

std::vector<CheckResult> check_hosts(const std::string& where, const RunConfig& given) {
  RunConfig config = given;
  config.hosts.hosts = "";
  if (const Expected<link::LinkAddress> address = link::read_address(where); address || where == "-") {
    if (!address) return {failed("hosts", address.error())};
    const Expected<link::LinkReport> link = measure_link(*address, config);
    return link ? judge_link(*link) : std::vector<CheckResult>{failed("hosts", link.error())};
  }
  config.hosts.hosts = where;
  config.hosts.serve = true;
  if (const Status prepared = prepare_calls(config, environment_variable); !prepared)
    return {failed("hosts", prepared.error())};
  std::vector<CheckResult> results;
  std::vector<std::string> words = {"doctor", "--hosts=-", "--json"};
  if (config.hosts.insecure_network) words.emplace_back("--insecure_network");
  for (const HostStart& call : ssh_calls(config.hosts.hosts, words, sibling_program("comrad")))
    for (CheckResult& result : ask_host(call, config)) results.push_back(std::move(result));
  return results;
}

}  // namespace comrad::deploy
