#include "deploy/launch/host_team.h"

#include <signal.h>

#include <algorithm>
#include <cstdio>

#include "deploy/launch/run_phase.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/process.h"

namespace comrad::deploy {
namespace {

constexpr double kWorkedS = 60;   // a call that lasted so long did some work
constexpr double kAskAfterS = 4;  // of a stop; hosts hear of the run's end on the link
constexpr RestartLimits kCalls{.first_delay_s = 2, .max_delay_s = 60, .window_s = 600, .deaths = 10};

}  // namespace

HostTeam::HostTeam(const LaunchPlan& plan, const Clock& clock, ProcessHost& processes)
    : plan_(plan), clock_(clock), processes_(processes) {
  for (const HostStart& start : plan.hosts) {
    Host& host = hosts_.emplace_back();
    host.start = &start;
    host.history = RestartHistory(kCalls);
  }
}

bool HostTeam::any_alive() const {
  return std::ranges::any_of(hosts_, [](const Host& host) { return host.process != nullptr; });
}

std::vector<std::string> HostTeam::tick(bool is_running) {
  const double now_s = clock_.now_s();
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
  host.started_s = now_s;
  host.last_line.clear();
  Expected<std::unique_ptr<Process>> process =
      processes_.spawn({.program = host.start->command[0],
                        .arguments = {host.start->command.begin() + 1, host.start->command.end()},
                        .environment = {},
                        .takes_input = true});
  if (!process) {
    host.is_given_up = true;
    words.push_back(host.start->name + " is not called: " + process.error().message);
    return;
  }
  host.process = std::move(*process);
  host.process->write_input(plan_.join_address + "\n");
  spdlog::info("called {} (pid {})", host.start->name, host.process->pid());
}

void HostTeam::look_at(Host& host, double now_s, std::vector<std::string>& words) {
  for (const std::string& line : host.process->read_lines()) {
    spdlog::info("{}: {}", host.start->name, line);
    host.last_line = line;
  }
  if (const std::optional<ExitStatus> how = host.process->poll_exit()) return ended(host, *how, now_s, words);
  if (stopping_since_s_ == 0) return;
  const double waited_s = now_s - stopping_since_s_;
  if (waited_s >= kAskAfterS) host.process->end_input();
  if (waited_s >= kTermAfterS) host.process->send_signal(waited_s >= kKillAfterS ? SIGKILL : SIGTERM);
}

void HostTeam::ended(Host& host, const ExitStatus& how, double now_s, std::vector<std::string>& words) {
  for (const std::string& line : host.process->read_lines()) host.last_line = line;
  host.process.reset();
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

void HostTeam::stop() {
  if (stopping_since_s_ == 0) stopping_since_s_ = clock_.now_s();
}

}  // namespace comrad::deploy
