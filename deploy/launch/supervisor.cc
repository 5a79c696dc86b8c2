#include "deploy/launch/supervisor.h"

#include <spdlog/fmt/fmt.h>

#include <poll.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <optional>
#include <utility>

#include "deploy/launch/control_socket.h"
#include "deploy/launch/metrics_page.h"
#include "deploy/launch/progress.h"
#include "deploy/launch/publisher.h"
#include "deploy/launch/run_directory.h"
#include "deploy/launch/run_report.h"
#include "deploy/launch/run_resources.h"
#include "deploy/launch/run_snapshot.h"
#include "deploy/launch/signal_queue.h"
#include "deploy/launch/supervision.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/link/join/link_files.h"

namespace comrad::deploy {
namespace {

constexpr int kTickMs = 50;  // longest sleep of the loop; signals, deaths and joins wake it at once
constexpr double kStatusIntervalS = 2.0;
constexpr double kShortestLineIntervalS = 0.1;
constexpr double kVideoLineIntervalS = 1.0;
constexpr double kLookIntervalS = 1.0;  // at the workers' counters, for their rates
constexpr double kPublishIntervalS = 1.0;
constexpr double kSnapshotLifetimeS = 0.2;  // repeated requests get the same answer

/// Something that is done every so often.
class Timer {
 public:
  /// Whether it is due; then it is due again `interval_s` later.
  bool is_due(double now_s, double interval_s) {
    if (now_s < next_s_) return false;
    next_s_ = now_s + interval_s;
    return true;
  }
  void wait_until(double time_s) { next_s_ = time_s; }
  void hurry() { next_s_ = 0; }

 private:
  double next_s_ = 0;
};

class Supervisor {
 public:
  Supervisor(const LaunchPlan& plan, const Clock& clock, ProcessHost& processes)
      : plan_(plan),
        clock_(clock),
        printer_(STDERR_FILENO, plan.show_progress),
        evaluations_(plan.run_dir),
        resources_(plan, printer_),
        supervision_(plan, clock, processes, evaluations_, resources_),
        report_(plan, clock, supervision_.meter(), supervision_.workers(), supervision_.evaluator()),
        snapshots_(plan, supervision_.meter(), supervision_.workers()) {}

  Expected<RunOutcome> run() {
    if (Status prepared = prepare(); prepared)
      start();
    else
      supervision_.fail(prepared.error());
    while (!supervision_.has_ended()) tick();
    return finish();
  }

 private:
  Status prepare();
  Status open_sockets();
  void start();

  // One turn of the loop.
  void tick();
  void wait_for_news();
  void hear_signals();
  void take_news();
  void report();
  void answer_visitors();
  void publish();

  // What comrad ctl requests.
  ControlCommands orders();
  const RunSnapshot& snapshot();
  Status drain(const std::string& host);

  Expected<RunOutcome> finish();
  const char* phase_word() const { return word_of(supervision_.phase()); }
  std::string stop_line() const { return "stopping: " + supervision_.stop_words(); }
  std::string starting_line() const { return report_.starting_line(); }
  double line_interval_s() const {
    const double wanted_s = plan_.config.run.progress_interval;
    return std::max(plan_.recording.is_wanted() ? std::min(wanted_s, kVideoLineIntervalS) : wanted_s,
                    kShortestLineIntervalS);
  }

  const LaunchPlan& plan_;
  const Clock& clock_;
  SignalQueue signals_;  // before everything that starts threads
  ProgressPrinter printer_;
  RunEvaluationFolder evaluations_;
  RunResources resources_;
  Supervision supervision_;
  RunReport report_;
  SnapshotTaker snapshots_;
  std::optional<ControlSocket> control_;
  std::optional<MetricsPage> page_;
  std::optional<Publisher> publisher_;
  RunSnapshot snapshot_;
  double snapshot_s_ = 0;
  bool has_input_ended_ = false;
  RunPhase reported_phase_ = RunPhase::kStarting;
  const double started_s_ = clock_.now_s();
  Timer line_timer_, status_timer_, look_timer_, publish_timer_;
};

Status Supervisor::prepare() {
  if (signals_.descriptor() < 0) return system_error("signalfd");
  link::remove_accounts(plan_.run_dir);
  COMRAD_TRY(init_log("supervisor", plan_.run_dir + "/logs/supervisor.log"));
  for (const std::string& text : plan_.notes) resources_.note("note: " + text);
  COMRAD_TRY(open_sockets());
  if (plan_.publishes()) {
    COMRAD_TRY_ASSIGN(publisher_, Publisher::open(plan_));
  }
  resources_.warn_once(write_status(plan_.run_dir, report_.status("starting", "")));
  return {};
}

void Supervisor::start() {
  supervision_.start();
  if (is_over(supervision_.phase())) return;
  printer_.line(starting_line());  // at once: libtorch takes seconds to load
  line_timer_.wait_until(clock_.now_s() + line_interval_s());
}

/// A run trains without a control socket as well; a metrics page that was requested must open.
Status Supervisor::open_sockets() {
  if (!plan_.trains() || plan_.lock_descriptor < 0) return {};
  const ControlAddress address = make_control_address();
  Expected<ControlSocket> socket = ControlSocket::open(address.socket, orders());
  if (socket) control_.emplace(std::move(socket).value());
  resources_.warn_once(socket ? write_control_address(plan_.lock_descriptor, address) : socket.error());
  if (plan_.config.run.metrics_port == 0) return {};
  COMRAD_TRY_ASSIGN(page_, MetricsPage::open(static_cast<int>(plan_.config.run.metrics_port),
                                             [this] { return metrics_text(snapshot()); }));
  return {};
}

void Supervisor::tick() {
  wait_for_news();
  hear_signals();
  take_news();
  supervision_.tick();
  if (resources_.is_open()) report();
  answer_visitors();
}

void Supervisor::wait_for_news() {
  std::vector<pollfd> sources{{.fd = signals_.descriptor(), .events = POLLIN, .revents = 0}};
  if (resources_.socket() >= 0)
    sources.push_back({.fd = resources_.socket(), .events = POLLIN, .revents = 0});
  supervision_.workers().append_outputs(sources);
  const bool hears_input = plan_.leaves_with_input && !has_input_ended_;
  if (hears_input) sources.push_back({.fd = STDIN_FILENO, .events = POLLIN, .revents = 0});
  poll(sources.data(), sources.size(), kTickMs);
  if (!hears_input || sources.back().revents == 0) return;
  char ignored[256];
  if (read(STDIN_FILENO, ignored, sizeof ignored) > 0) return;
  has_input_ended_ = true;
  supervision_.input_ended();
}

void Supervisor::hear_signals() {
  for (int number; (number = signals_.next()) != 0;) {
    if (number == SIGCHLD) continue;  // supervision looks anyway
    if (number != SIGUSR1)
      supervision_.interrupt(number);
    else if (plan_.trains() && resources_.is_open())
      (void)supervision_.ask_for_checkpoint("SIGUSR1");
  }
}

/// What the workers have asked, printed and counted since the last turn.
void Supervisor::take_news() {
  while (const std::optional<shm::JoinRequest> request = resources_.next_join())
    supervision_.workers().note_joined(*request);
  supervision_.workers().read_output(printer_);
  if (!resources_.is_open()) return;
  resources_.drain_episodes([&](const EpisodeRecord& record) {
    if (record.episode_id < plan_.episodes) {
      supervision_.meter().add(record);
      if (plan_.on_episode) plan_.on_episode(record);
    }
    if (publisher_) resources_.warn_once(publisher_->publish(record));
  });
  (void)supervision_.meter().take_report();
}

void Supervisor::report() {
  const double now_s = clock_.now_s();
  const RunPhase phase = supervision_.phase();
  if (const RunPhase before = std::exchange(reported_phase_, phase); before != phase) {
    status_timer_.hurry();
    if (before == RunPhase::kStarting) line_timer_.hurry();
  }
  const auto line = [&] {
    if (phase == RunPhase::kStarting) return starting_line();
    return (phase == RunPhase::kPaused ? "paused | " : "") + report_.progress_line();
  };
  if (status_timer_.is_due(now_s, kStatusIntervalS))
    resources_.warn_once(write_status(plan_.run_dir, report_.status(is_over(phase) ? "running" : phase_word(),
                                                                    is_over(phase) ? stop_line() : line())));
  if (!is_over(phase) && line_timer_.is_due(now_s, line_interval_s())) printer_.line(line());
}

/// Queries do not wake the event loop: they are answered at the next turn, so that no number of them delays the run.
void Supervisor::answer_visitors() {
  const double now_s = clock_.now_s();
  if (resources_.is_open() && look_timer_.is_due(now_s, kLookIntervalS))
    snapshots_.look(resources_.arena(), now_s);
  if (control_) control_->tick(now_s);
  if (page_) page_->tick();
  if (publisher_ && resources_.is_open() && publish_timer_.is_due(now_s, kPublishIntervalS)) publish();
}

void Supervisor::publish() {
  resources_.warn_once(publisher_->publish(snapshot(), supervision_.meter().last_stats()));
}

ControlCommands Supervisor::orders() {
  return {.status = [this] { return to_json(snapshot()); },
          .pause = [this] { return snapshot_s_ = 0, supervision_.pause(); },
          .resume = [this] { return snapshot_s_ = 0, supervision_.resume(); },
          .stop = [this] { return supervision_.ask_to_stop(), Status(); },
          .checkpoint = [this] { return snapshot_s_ = 0, supervision_.ask_for_checkpoint("comrad ctl"); },
          .drain = [this](const std::string& host) { return drain(host); }};
}

const RunSnapshot& Supervisor::snapshot() {
  const double now_s = clock_.now_s();
  if (!resources_.is_open() || (snapshot_s_ > 0 && now_s - snapshot_s_ < kSnapshotLifetimeS))
    return snapshot_;
  snapshot_s_ = now_s;
  const RunPhase phase = supervision_.phase();
  const std::string words = is_over(phase)                 ? stop_line()
                            : phase == RunPhase::kStarting ? starting_line()
                                                           : report_.progress_line();
  snapshot_ = snapshots_.take(resources_.arena(), report_.status(phase_word(), words), now_s);
  return snapshot_;
}

Status Supervisor::drain(const std::string& host) {
  const RunSnapshot& run = snapshot();
  const auto peer = std::ranges::find(run.hosts, host, &HostSnapshot::name);
  if (host != run.host && peer != run.hosts.end()) {
    COMRAD_TRY(link::ask_to_leave(plan_.run_dir, host));
    resources_.note("comrad ctl: " + host + " is asked to leave; what it has played is delivered first");
    return {};
  }
  if (host == run.host)
    return Error{ErrorCode::kBadInput,
                 "the learner is on " + host + ", so the run cannot continue without it; comrad ctl " +
                     std::filesystem::path(plan_.run_dir).filename().string() + " stop ends the run"};
  std::vector<std::string> hosts;
  for (const HostSnapshot& one : run.hosts) hosts.push_back(one.name);
  return Error{ErrorCode::kBadInput, unknown_word("host", host, hosts)};
}

Expected<RunOutcome> Supervisor::finish() {
  take_news();  // what the workers said last
  const RunEnding ending = supervision_.finish();
  printer_.end();
  const RateMeter& meter = supervision_.meter();
  const std::string lost = meter.going_back_text();
  resources_.warn_once(write_status(
      plan_.run_dir,
      report_.status(final_state_of(ending.reason), ending.message + (lost.empty() ? "" : "; " + lost))));
  if (publisher_) resources_.warn_once(publisher_->publish_state(word_of(ending.reason), ending.message));
  if (ending.error) return *ending.error;

  RunOutcome outcome;
  outcome.reason = ending.reason;
  outcome.exit_code = exit_code_of(ending.reason);
  const double stopped_s =
      supervision_.stopping_since_s() > 0 ? supervision_.stopping_since_s() : clock_.now_s();
  outcome.message = report_.summary(
      ending.message, stopped_s - (meter.running_since_s() > 0 ? meter.running_since_s() : started_s_));
  outcome.accounts = meter.accounts();
  outcome.restarts = static_cast<uint32_t>(ending.restarts);
  if (outcome.restarts > 0) outcome.message += fmt::format("; {} restarts", outcome.restarts);
  if (plan_.drains() && (outcome.restarts > 0 || plan_.serves() || plan_.feeds()))
    outcome.message += (outcome.restarts > 0 ? ": " : "; ") +
                       outcome.accounts.text(plan_.feeds() ? "were delivered" : "were trained on");
  spdlog::info("{}", outcome.message);
  outcome.last_stats = meter.last_stats();
  outcome.lag_mean = meter.lag_mean();
  outcome.measured = meter.window();
  outcome.env_frames_lost = meter.env_frames_lost();
  for (const auto& [id, episode] : meter.episodes()) outcome.episodes.push_back(episode);
  return outcome;
}

}  // namespace

Expected<RunOutcome> run(const LaunchPlan& plan) {
  MachineProcessHost processes;
  return Supervisor(plan, kMachineClock, processes).run();
}

}  // namespace comrad::deploy
