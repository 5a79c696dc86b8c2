// `comrad ctl RUN ORDER`: sends an order to the supervisor of a live run, and waits until it is done.

#include <spdlog/fmt/fmt.h>

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <functional>

#include "deploy/run/command.h"
#include "deploy/run/run_client.h"
#include "deploy/run/run_table.h"
#include "deploy/settings/command_line.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::deploy {
namespace {

using nlohmann::json;

constexpr int64_t kLookUs = 100'000;
constexpr std::size_t kWidth = 200;  // of lines that may go to a file

struct CtlRequest {
  std::string run, order, name;
  std::string train_dir = RunSettings().train_dir;
  double timeout_s = 60;
  bool as_json = false;
};

const std::vector<std::string> kOrders = {"status", "pause",   "resume", "checkpoint",
                                          "stop",   "workers", "drain"};

void print(const std::vector<std::string>& lines) {
  for (const std::string& line : lines) std::printf("%s\n", line.c_str());
}

/// Looks at the run's status until `is_done`. Errors: kTimeout in the `words` of what was waited for; those of ask().
Expected<json> await(const LiveRun& run, double timeout_s, const std::string& words,
                     const std::function<bool(const json&)>& is_done) {
  for (const double deadline_s = monotonic_s() + timeout_s;;) {
    COMRAD_TRY_ASSIGN(const json status, ask(run, {{"do", "status"}}));
    if (is_done(status)) return status;
    if (monotonic_s() > deadline_s)
      return Error{
          ErrorCode::kTimeout,
          fmt::format(
              "run '{}': {} took more than {} s (--timeout waits longer); comrad ctl {} status shows more",
              run.name, words, static_cast<int>(timeout_s), run.name)};
    usleep(kLookUs);
  }
}

Expected<json> checkpoint(const LiveRun& run, const CtlRequest& request) {
  COMRAD_TRY_ASSIGN(const json before, ask(run, {{"do", "status"}}));
  COMRAD_TRY_ASSIGN(const json answer, ask(run, {{"do", "checkpoint"}}));
  const auto asked = answer.value("asked", uint32_t{0});
  COMRAD_TRY_ASSIGN(const json after,
                    await(run, request.timeout_s, "the checkpoint", [&](const json& status) {
                      return status["checkpoint"].value("done", uint32_t{0}) >= asked;
                    }));
  if (after["checkpoint"].value("failed", 0) > before["checkpoint"].value("failed", 0))
    return Error{ErrorCode::kNoSpace,
                 "run '" + run.name +
                     "': the checkpoint could not be written, training continues; logs/learner-0.log states "
                     "why"};
  return after;
}

/// Waits until the control socket no longer answers.
Expected<json> stop(const LiveRun& run, const CtlRequest& request) {
  COMRAD_TRY_ASSIGN(const json answer, ask(run, {{"do", "stop"}}));
  const Expected<json> ended = await(run, request.timeout_s, "stopping", [](const json&) { return false; });
  if (!ended && (ended.error().code == ErrorCode::kTimeout)) return ended.error();
  return answer;
}

Expected<json> workers(const LiveRun& run, const std::string& name) {
  COMRAD_TRY_ASSIGN(json status, ask(run, {{"do", "status"}}));
  if (name.empty()) return status;
  std::vector<std::string> known;
  json chosen = json::array();
  for (const json& worker : status["workers"]) {
    known.push_back(worker.value("worker", ""));
    if (known.back() == name) chosen.push_back(worker);
  }
  if (chosen.empty())
    return Error{ErrorCode::kBadInput, "run '" + run.name + "': " + unknown_word("worker", name, known)};
  status["workers"] = chosen;
  return status;
}

Status check(const CtlRequest& request) {
  if (std::ranges::find(kOrders, request.order) == kOrders.end())
    return Error{ErrorCode::kBadInput, unknown_word("order", request.order, kOrders)};
  if (request.order == "drain" && request.name.empty())
    return Error{ErrorCode::kBadInput, "name the host: comrad ctl " + request.run +
                                           " drain HOST (comrad ctl " + request.run +
                                           " status lists the hosts)"};
  if (!request.name.empty() && request.order != "drain" && request.order != "workers")
    return Error{ErrorCode::kBadInput,
                 "'" + request.name + "' is an unexpected argument after " + request.order};
  if (!(request.timeout_s > 0)) return Error{ErrorCode::kBadInput, "--timeout must be above 0 s"};
  return {};
}

Expected<int> obey(const CtlRequest& request) {
  COMRAD_TRY(check(request));
  COMRAD_TRY_ASSIGN(const LiveRun run, find_live_run(request.run, request.train_dir));
  json answer;
  if (request.order == "status" || request.order == "workers") {
    COMRAD_TRY_ASSIGN(answer, workers(run, request.name));
  } else if (request.order == "checkpoint") {
    COMRAD_TRY_ASSIGN(answer, checkpoint(run, request));
  } else if (request.order == "stop") {
    COMRAD_TRY_ASSIGN(answer, stop(run, request));
  } else if (request.order == "drain") {
    COMRAD_TRY(ask(run, {{"do", "drain"}, {"host", request.name}}));
    COMRAD_TRY_ASSIGN(
        answer, await(run, request.timeout_s, request.name + "'s leaving", [&](const json& now) {
          return std::ranges::none_of(
              now["hosts"], [&](const json& host) { return host.value("host", "") == request.name; });
        }));
  } else {
    COMRAD_TRY_ASSIGN(answer, ask(run, {{"do", request.order}}));
  }
  if (request.as_json) {
    const json& shown = request.order == "workers" ? answer["workers"] : answer;
    std::printf("%s\n", (request.order == "workers" ? json{{"workers", shown}} : shown).dump(2).c_str());
  } else if (request.order == "status") {
    print(run_lines(answer, kWidth));
    print(host_table(answer, kWidth));
  } else if (request.order == "workers") {
    print(worker_table(answer, kWidth));
  } else if (request.order == "checkpoint") {
    std::printf("%s\n", fitted(answer["checkpoint"].value("path", ""), 4096).c_str());
  } else {
    const std::string done = request.order == "pause"    ? "paused"
                             : request.order == "resume" ? "continues"
                             : request.order == "stop"   ? "stopped"
                                                         : request.name + " has left";
    std::printf("%s: %s\n", run.name.c_str(), done.c_str());
  }
  return kExitDone;
}

}  // namespace

int ctl_command(Arguments arguments) {
  CtlRequest request;
  CommandLine line(
      "ctl RUN status|pause|resume|checkpoint|stop|workers [WORKER]|drain HOST",
      "Talks to a run that is alive on this host and is your own. pause: simulators and learner "
      "stand still until\n"
      "resume. checkpoint: saves one after this optimizer step and prints its name. stop: as "
      "Ctrl-C, and waits for the\n"
      "end. workers: a table of all, or of one. drain: a host that feeds the run delivers what it "
      "has played, and leaves; waits for it.\n"
      "RUN is a run directory or an experiment below --train_dir.");
  line.add_positional("RUN", request.run, "the run");
  line.add_positional("ORDER", request.order, "what it is to do");
  std::vector<std::string> names;
  line.add_words("NAME", names, "of a worker or a host");
  line.add_option("train_dir", request.train_dir, "DIR", "folder that holds the runs (default train_dir)");
  line.add_option("timeout", request.timeout_s, "SECONDS",
                  "how long checkpoint, drain and stop wait (default 60)");
  line.add_switch("json", request.as_json, "print one JSON object");
  return run_command("ctl", line, arguments, [&]() -> Expected<int> {
    if (names.size() > 1) return Error{ErrorCode::kBadInput, "'" + names[1] + "' is an unexpected argument"};
    if (!names.empty()) request.name = names[0];
    return obey(request);
  });
}

}  // namespace comrad::deploy
