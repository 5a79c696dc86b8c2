#include "deploy/launch/metrics_page.h"

#include <spdlog/fmt/fmt.h>

#include <cstdio>
#include <utility>
#include <vector>

#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

using Labels = std::vector<std::pair<std::string, std::string>>;

/// A label's value between quotation marks.
std::string escaped(const std::string& value) {
  std::string text;
  for (const char letter : value) {
    if (letter == '\\' || letter == '"') text += '\\';
    text += letter == '\n' ? std::string("\\n") : std::string(1, letter);
  }
  return is_utf8(text) ? text : "?";
}

class Page {
 public:
  explicit Page(std::string run) : run_(std::move(run)) {}

  void family(const std::string& name, const char* type, const char* help) {
    name_ = "comrad_" + name;
    head_ = "# HELP " + name_ + " " + help + "\n# TYPE " + name_ + " " + type + "\n";
  }
  void sample(double value, const Labels& labels = {}) {
    if (!std::isfinite(value)) return;
    text_ += std::exchange(head_, {}) + name_ + "{run=\"" + escaped(run_) + "\"";
    for (const auto& [label, word] : labels) text_ += "," + label + "=\"" + escaped(word) + "\"";
    char number[32];
    std::snprintf(number, sizeof number, "%.17g", value);
    text_ += "} " + std::string(number) + "\n";
  }
  void sample(uint64_t value, const Labels& labels = {}) { sample(static_cast<double>(value), labels); }
  void sample(int value, const Labels& labels = {}) { sample(static_cast<double>(value), labels); }
  /// A family with one sample.
  template <typename Number>
  void one(const std::string& name, const char* type, const char* help, Number value) {
    family(name, type, help);
    sample(value);
  }
  const std::string& text() const { return text_; }

 private:
  const std::string run_;
  std::string name_, head_, text_;
};

constexpr const char* kStates[] = {"starting", "running", "paused", "finished", "failed"};

void append_workers(Page& page, const std::vector<WorkerSnapshot>& workers) {
  const auto family = [&](const char* name, const char* type, const char* help, auto value) {
    page.family(name, type, help);
    for (const WorkerSnapshot& worker : workers)
      page.sample(value(worker), {{"worker", worker.name}, {"role", worker.role}, {"host", worker.host}});
  };
  family("worker_up", "gauge", "1 while the worker's process is there and not stopped from outside.",
         [](const WorkerSnapshot& worker) { return worker.pid != 0 && worker.state != "stopped" ? 1 : 0; });
  family("worker_decisions_per_second", "gauge",
         "Agent decisions that the worker made, answered or trained on.",
         [](const WorkerSnapshot& worker) { return worker.decisions_per_s; });
  family("worker_busy_ratio", "gauge", "Share of the last second that it did not wait for others.",
         [](const WorkerSnapshot& worker) { return worker.busy; });
  family("worker_restarts_total", "counter", "Deaths of the worker since the run began.",
         [](const WorkerSnapshot& worker) { return worker.restarts; });
  family("worker_silent_seconds", "gauge", "Since the worker's counter moved last.",
         [](const WorkerSnapshot& worker) { return worker.silent_s; });
  family("worker_cpu_seconds_total", "counter", "Processor time of the worker's present process.",
         [](const WorkerSnapshot& worker) { return worker.cpu_s; });
  family("worker_resident_bytes", "gauge",
         "Memory of the worker's process, what it shares with others included.",
         [](const WorkerSnapshot& worker) { return worker.resident_bytes; });
}

}  // namespace

std::string metrics_text(const RunSnapshot& run) {
  Page page(run.run);
  const DecisionAccounts& accounts = run.accounts;
  page.family("run_state", "gauge", "1 for the state that the run is in.");
  for (const char* state : kStates) page.sample(run.status.state == state ? 1 : 0, {{"state", state}});
  page.one("elapsed_seconds", "gauge", "Since this process of the run began.", run.status.elapsed_s);
  page.one("env_frames", "gauge",
           "Env frames that the run has learned from; falls when a learner goes back to its checkpoint.",
           run.status.env_frames);
  page.one("env_frames_goal", "gauge", "Env frames at which the run ends.", run.env_frames_goal);
  page.one("decisions", "gauge", "Agent decisions that the run has learned from.", run.status.decisions);
  page.one("env_frames_per_second", "gauge", "Env frames trained on.", run.status.env_frames_per_s);
  page.one("learner_version", "gauge", "Optimizer steps of the policy.",
           static_cast<uint64_t>(run.status.learner_version));
  page.one("score_mean", "gauge", "J, the scenario's objective, over the last stats_avg episodes.",
           run.status.score_mean);
  page.one("episodes_total", "counter", "Episodes that the learner has heard of.", run.episodes);
  page.one("policy_lag_mean", "gauge", "Learner version minus the version that acted, in optimizer steps.",
           run.lag_mean);
  page.one("policy_lag_max", "gauge", "The largest policy lag of the last batch.",
           static_cast<uint64_t>(run.lag_max));
  page.one("replay_filled_ratio", "gauge", "Share of the decisions that learning waits for.",
           run.replay_filled);
  page.one("decisions_made_total", "counter",
           "Agent decisions that simulators made since this process of the run began.", accounts.made);
  page.one("decisions_trained_total", "counter", "Of them, counted by learners.", accounts.trained);
  page.one("decisions_forgotten_total", "counter",
           "Of those, forgotten by learners that went back to a checkpoint.", accounts.forgotten);
  page.family("decisions_lost_total", "counter",
              "Agent decisions that were made and never trained on, by where they were.");
  page.sample(accounts.lost_with_simulators, {{"where", "simulator"}});
  page.sample(accounts.lost_with_learners, {{"where", "learner"}});
  page.sample(accounts.lost_in_restarts, {{"where", "restart"}});
  page.sample(accounts.lost_on_the_way, {{"where", "way"}});
  page.sample(accounts.left, {{"where", "end"}});
  page.one("decisions_waiting", "gauge", "Agent decisions made that are on their way to the learner.",
           accounts.waiting);
  page.family("slabs", "gauge", "Trajectory slabs of the arena by state.");
  page.sample(run.slabs.free, {{"state", "free"}});
  page.sample(run.slabs.filling, {{"state", "filling"}});
  page.sample(run.slabs.sealed, {{"state", "sealed"}});
  page.sample(run.slabs.learning, {{"state", "learning"}});
  page.one("checkpoint_env_frames", "gauge", "Env frames of the newest checkpoint.", run.saved_env_frames);
  page.one("checkpoints_failed_total", "counter", "Checkpoints that could not be written.",
           static_cast<uint64_t>(run.checkpoints_failed));
  page.family("host_decisions_per_second", "gauge", "Agent decisions that the host's simulators make.");
  for (const HostSnapshot& host : run.hosts) page.sample(host.decisions_per_s, {{"host", host.name}});
  page.family("host_credits", "gauge", "Trajectories that the host may still begin or send.");
  for (const HostSnapshot& host : run.hosts)
    page.sample(static_cast<double>(host.credits), {{"host", host.name}});
  append_workers(page, run.workers);
  return page.text();
}

HttpRules metrics_rules(std::function<std::string()> page) {
  return {.answer = [page = std::move(page)](const HttpRequest& request) -> HttpReply {
    if (request.method != "GET" && request.method != "HEAD")
      return {.status = 405, .body = "request GET /metrics\n"};
    if (request.path != "/metrics") return {.status = 404, .body = "request /metrics\n"};
    return {.type = "text/plain; version=0.0.4; charset=utf-8", .body = page()};
  }};
}

Status check_metrics_port(int64_t port) {
  if (port == 0) return {};
  const Expected<MetricsPage> page = MetricsPage::open(static_cast<int>(port), [] { return std::string(); });
  return page ? Status() : page.error();
}

Expected<MetricsPage> MetricsPage::open(int port, std::function<std::string()> page) {
  Expected<HttpServer> server = HttpServer::open("127.0.0.1", port, metrics_rules(std::move(page)));
  if (server) return MetricsPage(std::move(server).value());
  return Error{server.error().code, fmt::format("--metrics_port {}: {}; choose another, or 0 for none", port,
                                                server.error().message)};
}

}  // namespace comrad::deploy
