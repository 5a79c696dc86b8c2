#include "deploy/launch/supervisor.h"

#include <poll.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <utility>

#include "deploy/launch/control_door.h"
#include "deploy/launch/evaluator.h"
#include "deploy/launch/host_team.h"
#include "deploy/launch/metrics_page.h"
#include "deploy/launch/progress.h"
#include "deploy/launch/run_directory.h"
#include "deploy/launch/run_hub.h"
#include "deploy/launch/run_report.h"
#include "deploy/launch/run_snapshot.h"
#include "deploy/launch/signal_desk.h"
#include "deploy/launch/worker_table.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/control_group.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/link/feeder.h"
#include "rollout_buffer/link/link_files.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::deploy {
namespace {

constexpr int kTickMs = 50;          // longest sleep of the loop; signals, deaths and joins wake it at once
constexpr double kTermAfterS = 8.0;  // of a stop: SIGTERM to who is still there
constexpr double kKillAfterS = 9.5;  // of a stop: SIGKILL, so that 10 s hold
constexpr double kStatusIntervalS = 2.0;
constexpr double kWorkerStatusIntervalS = 1.0;
constexpr double kShortestLineIntervalS = 0.1;
constexpr double kLookIntervalS = 1.0;      // at the workers' counters, for their rates
constexpr double kSnapshotLifetimeS = 0.2;  // who asks more often gets the same again
constexpr int kExitInterruptedTwice = 130;  // as a shell reports SIGINT

enum class Phase { kStarting, kRunning, kStopping };

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
  explicit Supervisor(const LaunchPlan& plan)
      : plan_(plan),
        printer_(STDERR_FILENO, plan.show_progress),
        meter_(plan),
        hub_(plan, meter_, printer_),
        table_(plan),
        evaluator_(plan),
        host_team_(plan),
        report_(plan, meter_, table_, evaluator_),
        snapshots_(plan, meter_, table_) {}

  Expected<RunOutcome> run() {
    if (Status started = start(); !started) fail(started.error());
    while (phase_ != Phase::kStopping || table_.any_alive() || evaluator_.is_busy() || host_team_.any_alive())
      tick();
    return finish();
  }

 private:
  Status start();
  Status open_doors();

  // One turn of the loop.
  void tick();
  void wait_for_news();
  void hear_signals();
  void serve_joins();
  void restart_due();
  void begin_running_when_all_joined();
  void take_stats();
  void count_work();
  void measure();
  void listen_to_workers();
  void enforce_stop();
  void report();
  void answer_visitors();

  // What comrad ctl asks for.
  const RunSnapshot& snapshot();
  Status pause();
  Status resume();
  Expected<uint32_t> ask_for_checkpoint(const std::string& who);
  Status check_is_running() const;
  Status drain(const std::string& host);

  // Events.
  void exited(Worker& worker, const ExitStatus& how);
  uint64_t reclaim(Worker& worker);
  void restart_everything();
  void stop(const std::string& why);
  void complete(const std::string& why);
  void fail(Error error);

  Expected<RunOutcome> finish();
  const char* phase_word() const;
  void note(const std::string& text);

  const LaunchPlan& plan_;
  SignalDesk signals_;  // before everything that starts threads
  ProgressPrinter printer_;
  RunMeter meter_;
  RunHub hub_;
  WorkerTable table_;
  Evaluator evaluator_;
  HostTeam host_team_;
  RunReport report_;
  SnapshotTaker snapshots_;
  std::optional<ControlDoor> door_;
  std::optional<MetricsPage> page_;
  RunSnapshot snapshot_;
  double snapshot_s_ = 0;
  bool is_paused_ = false;
  RunOutcome outcome_;
  std::optional<Error> error_;
  Phase phase_ = Phase::kStarting;
  bool has_input_ended_ = false;
  bool killed_at_once_ = false;
  bool is_complete_ = false;  // the goal was reached before anybody interrupted
  bool learner_was_killed_ = false;
  bool told_of_last_evaluations_ = false;
  int interrupts_ = 0;
  uint64_t memory_kills_ = memory_kills();  // of the kernel in this control group, so far
  const double started_s_ = monotonic_s();
  double stopping_since_s_ = 0;
  Timer line_timer_, status_timer_, worker_status_timer_, look_timer_;
};

Status Supervisor::start() {
  if (signals_.descriptor() < 0) return system_error("signalfd");
  link::remove_accounts(plan_.run_dir);
  COMRAD_TRY(init_log("supervisor", plan_.run_dir + "/logs/supervisor.log"));
  for (const std::string& text : plan_.notes) note("note: " + text);
  COMRAD_TRY(open_doors());
  hub_.warn_once(write_status(plan_.run_dir, report_.status("starting", "")));
  COMRAD_TRY(hub_.open());
  for (Worker& worker : table_.workers()) COMRAD_TRY(table_.start(worker, hub_.arena(), hub_.socket_name()));
  printer_.line(report_.starting_line());  // at once: a network library takes seconds to load
  line_timer_.wait_until(monotonic_s() +
                         std::max(plan_.config.run.progress_interval, kShortestLineIntervalS));
  return {};
}

/// A run without a door trains as well; a page that was asked for must be there.
Status Supervisor::open_doors() {
  if (!plan_.trains() || plan_.lock_descriptor < 0) return {};
  const DoorSign sign = make_door_sign();
  Expected<ControlDoor> door = ControlDoor::open(
      sign.door, {.status = [this] { return to_json(snapshot()); },
                  .pause = [this] { return pause(); },
                  .resume = [this] { return resume(); },
                  .stop =
                      [this] {
                        outcome_.interrupted |= !is_complete_;
                        stop("stopped by comrad ctl");
                        note("comrad ctl: stopping after this optimizer step and a checkpoint");
                        return Status();
                      },
                  .checkpoint = [this] { return ask_for_checkpoint("comrad ctl"); },
                  .drain = [this](const std::string& host) { return drain(host); }});
  if (door) door_.emplace(std::move(door).value());
  hub_.warn_once(door ? write_door_sign(plan_.lock_descriptor, sign) : door.error());
  if (plan_.config.run.metrics_port == 0) return {};
  COMRAD_TRY_ASSIGN(page_, MetricsPage::open(static_cast<int>(plan_.config.run.metrics_port),
                                             [this] { return metrics_text(snapshot()); }));
  return {};
}

void Supervisor::tick() {
  wait_for_news();
  hear_signals();
  serve_joins();
  table_.read_output(printer_);
  for (const auto& [worker, how] : table_.reap_exited(phase_ == Phase::kStopping)) exited(*worker, how);
  restart_due();
  if (hub_.is_open()) {
    begin_running_when_all_joined();
    hub_.drain_episodes();
    take_stats();
    count_work();
    measure();
    listen_to_workers();
    if (phase_ == Phase::kRunning && plan_.feeds() &&
        hub_.arena().control().goal_reached.load() == link::kAskedToLeave)
      complete("this host was asked to leave (comrad ctl drain)");
    if (phase_ == Phase::kRunning && plan_.episodes > 0 && meter_.episodes().size() >= plan_.episodes)
      complete("finished");
  }
  for (const std::string& words : evaluator_.tick(monotonic_s())) note(words);
  for (const std::string& words : host_team_.tick(monotonic_s(), phase_ == Phase::kRunning)) note(words);
  if (phase_ == Phase::kRunning && !host_team_.failure().empty())
    fail({ErrorCode::kPeerLost, host_team_.failure()});
  if (phase_ == Phase::kStopping && !table_.any_alive() && evaluator_.is_busy() &&
      !std::exchange(told_of_last_evaluations_, true))
    note("trained; the last evaluations are played now (Ctrl-C leaves them out)");
  enforce_stop();
  if (hub_.is_open()) report();
  answer_visitors();
}

/// Who asks does not wake the loop: it is heard at the next turn, so that no number of questions delays the run.
void Supervisor::answer_visitors() {
  const double now_s = monotonic_s();
  if (hub_.is_open() && look_timer_.is_due(now_s, kLookIntervalS)) snapshots_.look(hub_.arena(), now_s);
  if (door_) door_->tick(now_s);
  if (page_) page_->tick(now_s);
}

const RunSnapshot& Supervisor::snapshot() {
  const double now_s = monotonic_s();
  if (!hub_.is_open() || (snapshot_s_ > 0 && now_s - snapshot_s_ < kSnapshotLifetimeS)) return snapshot_;
  snapshot_s_ = now_s;
  const bool is_stopping = phase_ == Phase::kStopping;
  const std::string words = is_stopping                  ? "stopping: " + outcome_.message
                            : phase_ == Phase::kStarting ? report_.starting_line()
                                                         : report_.progress_line();
  snapshot_ = snapshots_.take(hub_.arena(), report_.status(phase_word(), words), now_s);
  return snapshot_;
}

Status Supervisor::check_is_running() const {
  if (phase_ == Phase::kStopping) return Error{ErrorCode::kBadInput, "the run is stopping"};
  if (phase_ == Phase::kRunning) return {};
  return Error{ErrorCode::kBadInput,
               "the run is starting (" + report_.starting_line() + "); ask again when it runs"};
}

Status Supervisor::pause() {
  COMRAD_TRY(check_is_running());
  if (std::exchange(is_paused_, true)) return Error{ErrorCode::kBadInput, "the run is paused already"};
  hub_.set_paused(true);
  note("comrad ctl: paused; comrad ctl " + std::filesystem::path(plan_.run_dir).filename().string() +
       " resume goes on");
  status_timer_.hurry();
  snapshot_s_ = 0;
  return {};
}

Status Supervisor::resume() {
  COMRAD_TRY(check_is_running());
  if (!std::exchange(is_paused_, false)) return Error{ErrorCode::kBadInput, "the run is not paused"};
  hub_.set_paused(false);
  note("comrad ctl: the run goes on");
  status_timer_.hurry();
  snapshot_s_ = 0;
  return {};
}

Expected<uint32_t> Supervisor::ask_for_checkpoint(const std::string& who) {
  COMRAD_TRY(check_is_running());
  const uint32_t wish = hub_.arena().control().checkpoint_seq.fetch_add(1) + 1;
  note(who + ": a checkpoint is saved after this optimizer step");
  snapshot_s_ = 0;
  return wish;
}

Status Supervisor::drain(const std::string& host) {
  const RunSnapshot& run = snapshot();
  const auto guest = std::ranges::find(run.hosts, host, &HostSnapshot::name);
  if (host != run.host && guest != run.hosts.end()) {
    COMRAD_TRY(link::ask_to_leave(plan_.run_dir, host));
    note("comrad ctl: " + host + " is asked to leave; what it has played is delivered first");
    return {};
  }
  if (host == run.host)
    return Error{ErrorCode::kBadInput,
                 "the learner is on " + host + ", so the run cannot go on without it; comrad ctl " +
                     std::filesystem::path(plan_.run_dir).filename().string() + " stop ends the run"};
  std::vector<std::string> hosts;
  for (const HostSnapshot& one : run.hosts) hosts.push_back(one.name);
  return Error{ErrorCode::kBadInput, unknown_word("host", host, hosts)};
}

void Supervisor::wait_for_news() {
  std::vector<pollfd> sources{{.fd = signals_.descriptor(), .events = POLLIN, .revents = 0}};
  if (hub_.socket() >= 0) sources.push_back({.fd = hub_.socket(), .events = POLLIN, .revents = 0});
  table_.append_outputs(sources);
  if (plan_.leaves_with_input && !has_input_ended_)
    sources.push_back({.fd = STDIN_FILENO, .events = POLLIN, .revents = 0});
  poll(sources.data(), sources.size(), kTickMs);
  if (!plan_.leaves_with_input || has_input_ended_ || sources.back().revents == 0) return;
  char ignored[256];
  if (read(STDIN_FILENO, ignored, sizeof ignored) > 0) return;
  has_input_ended_ = true;
  outcome_.interrupted = true;
  stop("the run that called this host has let it go");
}

void Supervisor::hear_signals() {
  for (int number; (number = signals_.next()) != 0;) {
    if (number == SIGCHLD) continue;  // reap_exited() looks anyway
    if (number == SIGUSR1) {
      if (plan_.trains() && hub_.is_open()) (void)ask_for_checkpoint("SIGUSR1");
      continue;
    }
    if (!is_complete_) outcome_.interrupted = true;
    if (number == SIGINT && ++interrupts_ >= 2) {
      killed_at_once_ = true;
      table_.signal_all(SIGKILL);
      evaluator_.stop(SIGKILL);
      host_team_.kill();
    }
    const std::string name = number == SIGINT ? "SIGINT" : number == SIGTERM ? "SIGTERM" : "SIGHUP";
    if (phase_ == Phase::kStopping) {
      evaluator_.stop(SIGTERM);  // the last ones are not waited for
      continue;
    }
    stop("interrupted by " + name);
    note(name + ": stopping" + (plan_.trains() ? " after this optimizer step and a checkpoint" : "") +
         "; press Ctrl-C again to stop at once");
  }
}

void Supervisor::serve_joins() {
  while (const std::optional<shm::JoinRequest> request = hub_.next_join()) table_.note_joined(*request);
}

void Supervisor::exited(Worker& worker, const ExitStatus& how) {
  const bool is_training_learner = worker.role == Role::kLearner && plan_.trains();
  const bool is_feeder = worker.role == Role::kFeeder;
  const bool is_clean = how.signal == 0 && how.code == kExitDone;
  if (phase_ == Phase::kStopping) {
    // Leaving is what they were asked for; only a learner that could not save matters.
    learner_was_killed_ |= is_training_learner && !is_clean;
    return;
  }
  if (is_training_learner && is_clean) {
    if (hub_.arena().control().goal_reached.load() != 0) {
      complete("finished" + report_.limit_reached());
    } else {
      outcome_.interrupted = true;
      stop("the learner was told to stop (SIGTERM) before the run's goal");
    }
    return;
  }
  if (is_feeder && is_clean && hub_.arena().control().goal_reached.load() != 0) {
    complete("the run that this host fed has ended");
    return;
  }
  const std::string words = table_.last_words(worker);
  const std::string said = words.empty() ? "it said nothing" : "its last line: " + words;
  if (how.signal == 0 && how.code == kExitNotSaved) {
    // Starting it again would train the same frames once more, for the same end.
    fail({ErrorCode::kNoSpace, "the last checkpoint could not be written, " + meter_.unsaved_text() +
                                   "; make room and start the same command again (" + said + ")"});
    return;
  }
  if (how.signal == 0 && how.code == kExitBadInput) {
    fail({ErrorCode::kBadInput, worker.name + " cannot run: " + said});
    return;
  }
  const uint64_t lost = reclaim(worker);
  ++outcome_.restarts;
  ++worker.restarts;
  const bool did_work = counters_of(worker, hub_.arena()).decisions.load() != worker.decisions_at_start;
  const double now_s = monotonic_s();
  const std::optional<double> delay_s = worker.history.next_delay_s(now_s, did_work);
  if (!delay_s) {
    fail({ErrorCode::kPeerLost, worker.name + " died " + std::to_string(plan_.restarts.deaths) +
                                    " times and is given up (" + how.text() + "); " + said + " (see " +
                                    table_.log_path(worker) + ")"});
    return;
  }
  worker.restart_at_s = now_s + *delay_s;
  char delay[32];
  std::snprintf(delay, sizeof delay, "%.1f s", *delay_s);
  const uint64_t memory_kills_now = how.signal == SIGKILL ? memory_kills() : memory_kills_;
  const bool is_out_of_memory = std::exchange(memory_kills_, memory_kills_now) < memory_kills_now;
  note(worker.name + " died (" + how.text() + "), starts again in " + delay +
       (is_out_of_memory
            ? "; the memory limit of the control group was reached: raise it, or lower --num_workers, "
              "--num_envs_per_worker, --trajectory_slabs or --replay_gb"
            : "") +
       (lost > 0 ? "; " + std::to_string(lost) + " decisions lost" : "") +
       (is_training_learner ? "; training goes on from the last checkpoint" : ""));
  // Lock step must not depend on who died when: everybody goes back to the last checkpoint together.
  if (plan_.is_lock_step()) restart_everything();
}

/// Gives back what a dead worker held. Agent decisions that are lost with it.
uint64_t Supervisor::reclaim(Worker& worker) {
  switch (worker.role) {
    case Role::kSim:
      // A policy worker that stands still half way through a batch still writes into the slabs; restart_due() looks again.
      worker.is_unreclaimed = !hub_.arena().withdraw_requests(worker.index);
      return worker.is_unreclaimed ? 0 : hub_.arena().reclaim_sim_worker(worker.index);
    case Role::kPolicy:
      hub_.arena().reclaim_policy_worker(worker.index);
      return 0;  // its questions are asked again
    case Role::kReceiver:
    case Role::kFrameReceiver: {
      // What it had in the making is sent again, or counted as lost by the host that played it.
      const shm::ArenaShape& shape = hub_.arena().shape();
      const bool is_of_frames = worker.role == Role::kFrameReceiver;
      const int first = is_of_frames ? shape.own_worker_count() : shape.served_worker_count();
      const int end = is_of_frames ? shape.served_worker_count() : shape.sim_worker_count;
      for (int sim = first; sim < end; ++sim) hub_.arena().reclaim_sim_worker(sim);
      return 0;
    }
    case Role::kFeeder:
      meter_.count();  // what it had delivered; its successor adopts what it had drained, and asks again
      return 0;
    case Role::kLearner:
      hub_.arena().reclaim_learner();
      return meter_.learner_ended();
  }
  return 0;
}

void Supervisor::restart_everything() {
  meter_.count();  // what the dead ones said last
  double restart_at_s = monotonic_s();
  for (const Worker& worker : table_.workers()) restart_at_s = std::max(restart_at_s, worker.restart_at_s);
  table_.restart_all(restart_at_s);
  phase_ = Phase::kStarting;
  if (Status opened = hub_.open(); !opened) fail(opened.error());
}

void Supervisor::restart_due() {
  if (phase_ == Phase::kStopping) return;
  for (Worker& worker : table_.workers()) {
    if (worker.restart_at_s == 0 || monotonic_s() < worker.restart_at_s) continue;
    if (worker.is_unreclaimed) {
      if (const uint64_t lost = reclaim(worker); lost > 0)
        note(worker.name + ": " + std::to_string(lost) + " decisions lost");
      if (worker.is_unreclaimed) continue;
    }
    if (Status started = table_.start(worker, hub_.arena(), hub_.socket_name()); !started)
      fail(started.error());
  }
}

void Supervisor::begin_running_when_all_joined() {
  if (phase_ != Phase::kStarting || !table_.all_joined()) return;
  phase_ = Phase::kRunning;
  meter_.begin(monotonic_s());
  hub_.begin();
  if (is_paused_) hub_.set_paused(true);
  status_timer_.hurry();
  line_timer_.hurry();
}

void Supervisor::take_stats() {
  if (const std::optional<dds::TrainStats> stats = meter_.take_report()) hub_.tell(*stats);
}

void Supervisor::count_work() {
  if (meter_.count()) note(meter_.going_back_text());
}

void Supervisor::measure() {
  if (phase_ == Phase::kRunning && meter_.measure(monotonic_s())) complete("measured");
}

void Supervisor::listen_to_workers() {
  table_.listen(hub_.arena(), phase_ == Phase::kRunning &&
                                  hub_.arena().control().run_state.load() == shm::RunState::kRunning);
}

void Supervisor::stop(const std::string& why) {
  if (phase_ == Phase::kStopping) return;
  phase_ = Phase::kStopping;
  stopping_since_s_ = monotonic_s();
  outcome_.message = why;
  spdlog::info("stopping: {}", why);
  for (Worker& worker : table_.workers()) {
    // A dead learner that waits for its next start saves nothing any more; a bench needs nothing of it.
    learner_was_killed_ |=
        worker.role == Role::kLearner && plan_.trains() && worker.restart_at_s > 0 && plan_.seconds <= 0;
    worker.restart_at_s = 0;
  }
  if (hub_.is_open()) hub_.stop();
  host_team_.stop(stopping_since_s_);
  if (!is_complete_) evaluator_.stop(SIGTERM);
  status_timer_.hurry();
}

void Supervisor::complete(const std::string& why) {
  is_complete_ = phase_ != Phase::kStopping;
  stop(why);
  evaluator_.hurry();  // its last checkpoint is there
}

void Supervisor::fail(Error error) {
  if (!error_) error_ = std::move(error);
  spdlog::info("failed: {}", error_->message);
  stop("failed");
}

void Supervisor::enforce_stop() {
  if (phase_ != Phase::kStopping) return;
  const double waited_s = monotonic_s() - stopping_since_s_;
  const int next = waited_s >= kKillAfterS ? SIGKILL : waited_s >= kTermAfterS ? SIGTERM : 0;
  for (Worker& worker : table_.workers()) {
    if (!worker.process || next == 0 || worker.stop_signal == next) continue;
    worker.stop_signal = next;
    worker.process->send_signal(next);
    if (next == SIGKILL) note(worker.name + " did not stop in time and is killed");
  }
}

const char* Supervisor::phase_word() const {
  if (phase_ == Phase::kRunning && is_paused_) return "paused";
  return phase_ == Phase::kStarting ? "starting" : phase_ == Phase::kRunning ? "running" : "stopping";
}

void Supervisor::report() {
  const double now_s = monotonic_s();
  const auto line = [this] {
    if (phase_ == Phase::kStarting) return report_.starting_line();
    return (is_paused_ ? "paused | " : "") + report_.progress_line();
  };
  if (worker_status_timer_.is_due(now_s, kWorkerStatusIntervalS))
    hub_.tell_of_workers(table_.workers(), phase_word());
  if (status_timer_.is_due(now_s, kStatusIntervalS)) {
    const bool is_stopping = phase_ == Phase::kStopping;
    hub_.warn_once(
        write_status(plan_.run_dir, report_.status(is_stopping ? "running" : phase_word(),
                                                   is_stopping ? "stopping: " + outcome_.message : line())));
  }
  if (phase_ != Phase::kStopping &&
      line_timer_.is_due(now_s, std::max(plan_.config.run.progress_interval, kShortestLineIntervalS)))
    printer_.line(line());
}

void Supervisor::note(const std::string& text) {
  spdlog::info("{}", text);
  printer_.note(text);
}

Expected<RunOutcome> Supervisor::finish() {
  // What the workers said last.
  if (hub_.is_open()) {
    hub_.drain_episodes();
    take_stats();
    count_work();
    meter_.close();
  }
  if (!meter_.account_fault().empty()) note("warning: " + meter_.account_fault());
  printer_.end();
  std::string state = "finished";
  if (killed_at_once_) {
    outcome_.exit_code = kExitInterruptedTwice;
    outcome_.message += ", stopped at once";
    state = "paused";
  } else if (learner_was_killed_) {
    outcome_.exit_code = kExitFailed;
    outcome_.message += "; the learner did not save a last checkpoint: " + meter_.unsaved_text();
    state = "paused";
  } else if (outcome_.interrupted && !is_complete_) {
    if (plan_.trains())
      outcome_.message +=
          "; go on with --experiment " + std::filesystem::path(plan_.run_dir).filename().string();
    state = "paused";
  }
  if (error_) {
    state = "failed";
    outcome_.message = error_->message;
  }
  const std::string lost = meter_.going_back_text();
  hub_.warn_once(write_status(plan_.run_dir,
                              report_.status(state, outcome_.message + (lost.empty() ? "" : "; " + lost))));
  if (error_) return *error_;

  const double worked_s = (stopping_since_s_ > 0 ? stopping_since_s_ : monotonic_s()) -
                          (meter_.running_since_s() > 0 ? meter_.running_since_s() : started_s_);
  outcome_.message = report_.summary(outcome_.message, worked_s);
  outcome_.accounts = meter_.accounts();
  if (outcome_.restarts > 0) outcome_.message += "; " + std::to_string(outcome_.restarts) + " restarts";
  if (plan_.drains() && (outcome_.restarts > 0 || plan_.serves() || plan_.feeds()))
    outcome_.message += (outcome_.restarts > 0 ? ": " : "; ") +
                        outcome_.accounts.text(plan_.feeds() ? "were delivered" : "were trained on");
  spdlog::info("{}", outcome_.message);
  outcome_.last_stats = meter_.last_stats();
  outcome_.lag_mean = meter_.lag_mean();
  outcome_.measured = meter_.window();
  outcome_.env_frames_lost = meter_.env_frames_lost();
  for (const auto& [id, episode] : meter_.episodes()) outcome_.episodes.push_back(episode);
  return std::move(outcome_);
}

}  // namespace

Expected<RunOutcome> run(const LaunchPlan& plan) { return Supervisor(plan).run(); }

}  // namespace comrad::deploy
