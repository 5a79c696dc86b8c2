#include "deploy/launch/host_team.h"

#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/process.h"

namespace comrad::deploy {
namespace {

constexpr double kWorkedS = 60;        // a call that lasted so long did some work
constexpr double kAskAfterS = 4;       // of a stop; hosts hear of the run's end on the link
constexpr double kHostTermAfterS = 8;  // of a stop
constexpr double kHostKillAfterS = 9.5;
constexpr RestartLimits kCalls{.first_delay_s = 2, .max_delay_s = 60, .window_s = 600, .deaths = 10};

}  // namespace

HostTeam::HostTeam(const LaunchPlan& plan) : plan_(plan) {
  for (const HostStart& start : plan.hosts) {
    Host& host = hosts_.emplace_back();
    host.start = &start;
    host.history = RestartHistory(kCalls);
  }
}

bool HostTeam::any_alive() const {
  return std::ranges::any_of(hosts_, [](const Host& host) { return host.process.has_value(); });
}

std::vector<std::string> HostTeam::tick(double now_s, bool is_running) {
  std::vector<std::string> words;
  for (Host& host : hosts_) {
    if (host.process) look_at(host, now_s, words);
    if (!host.process && is_running && stopping_since_s_ == 0 && !host.is_given_up &&
        now_s >= host.start_at_s)
      call(host, now_s, words);
    if (host.is_given_up && host.start->is_needed && stopping_since_s_ == 0 && failure_.empty())
      failure_ = words.empty() ? host.start->name + " cannot take part" : words.back();
  }
  return words;
}

void HostTeam::call(Host& host, double now_s, std::vector<std::string>& words) {
  Expected<Pipe> input = Pipe::open();
  if (!input) return words.push_back(input.error().message), void(host.is_given_up = true);
  host.started_s = now_s;
  host.last_line.clear();
  Expected<ChildProcess> process =
      ChildProcess::spawn({.program = host.start->command[0],
                           .arguments = {host.start->command.begin() + 1, host.start->command.end()},
                           .environment = {},
                           .input = input->read_end.get()});
  if (!process) {
    host.is_given_up = true;
    words.push_back(host.start->name + " is not called: " + process.error().message);
    return;
  }
  host.process.emplace(std::move(*process));
  host.input = std::move(input->write_end);
  const std::string line = plan_.door_address + "\n";
  [[maybe_unused]] const ssize_t told = write(host.input.get(), line.data(), line.size());
  spdlog::info("called {} (pid {})", host.start->name, host.process->pid());
}

void HostTeam::look_at(Host& host, double now_s, std::vector<std::string>& words) {
  for (const std::string& line : host.process->read_lines()) {
    spdlog::info("{} says: {}", host.start->name, line);
    host.last_line = line;
  }
  if (const std::optional<ExitStatus> how = host.process->poll_exit()) return ended(host, *how, now_s, words);
  if (stopping_since_s_ == 0) return;
  const double waited_s = now_s - stopping_since_s_;
  if (waited_s >= kAskAfterS) host.input.close();
  if (waited_s >= kHostTermAfterS) host.process->send_signal(waited_s >= kHostKillAfterS ? SIGKILL : SIGTERM);
}

void HostTeam::ended(Host& host, const ExitStatus& how, double now_s, std::vector<std::string>& words) {
  for (const std::string& line : host.process->read_lines()) host.last_line = line;
  host.process.reset();
  host.input.close();
  if (stopping_since_s_ > 0) return;
  const std::string name = host.start->name,
                    said = host.last_line.empty() ? "" : "; its last line: " + host.last_line;
  if (how.signal == 0 && (how.code == kExitDone || how.code == kExitBadInput)) {
    host.is_given_up = true;
    words.push_back(name +
                    (how.code == kExitDone ? " has left and is not called again"
                                           : " cannot take part and is not called again") +
                    said);
    return;
  }
  const std::optional<double> delay_s = host.history.next_delay_s(now_s, now_s - host.started_s > kWorkedS);
  host.is_given_up = !delay_s;
  if (delay_s) host.start_at_s = now_s + *delay_s;
  char again[48] = "is not called again";
  if (delay_s) std::snprintf(again, sizeof again, "is called again in %.0f s", *delay_s);
  words.push_back(name + " went away (" + how.text() + ") and " + again + said);
}

void HostTeam::kill() {
  for (Host& host : hosts_)
    if (host.process) host.process->send_signal(SIGKILL);
}

void HostTeam::stop(double now_s) {
  if (stopping_since_s_ == 0) stopping_since_s_ = now_s;
}

}  // namespace comrad::deploy
