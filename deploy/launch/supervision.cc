#include "deploy/launch/supervision.h"

#include <spdlog/fmt/fmt.h>

#include <signal.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <utility>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/process.h"

namespace comrad::deploy {

Supervision::Supervision(const LaunchPlan& plan, const Clock& clock, ProcessHost& processes,
                         EvaluationFolder& evaluations, RunEffects& effects)
    : plan_(plan),
      clock_(clock),
      effects_(effects),
      meter_(plan),
      workers_(plan, clock, processes),
      evaluator_(plan, clock, processes, evaluations),
      hosts_(plan, clock, processes),
      memory_kills_(effects.memory_kills()) {}

void Supervision::start() {
  Status started = open();
  for (Worker& worker : workers_.workers())
    if (started) started = workers_.start(worker, effects_.arena(), effects_.socket_name());
  if (!started) fail(started.error());
}

/// The old arena goes before the new one comes: both may not fit.
Status Supervision::open() {
  meter_.use(nullptr);
  COMRAD_TRY(effects_.open());
  meter_.use(&effects_.arena());
  return {};
}

void Supervision::tick() {
  for (const auto& [worker, how] : workers_.reap_exited(is_over(phase_))) exited(*worker, how);
  if (std::exchange(starts_again_, false) && !is_over(phase_)) restart_everything();
  restart_due();
  if (effects_.is_open()) {
    begin_when_all_joined();
    count_work();
    workers_.listen(effects_.arena(), phase_ == RunPhase::kRunning);
    complete_when_done();
  }
  tend_evaluations_and_hosts();
  enforce_stop();
  end_when_all_left();
}

void Supervision::exited(Worker& worker, const ExitStatus& how) {
  const bool is_training_learner = worker.role == Role::kLearner && plan_.trains();
  const bool is_clean = how.signal == 0 && how.code == kExitDone;
  if (is_over(phase_)) {
    // They were requested to leave; only a learner that could not save matters.
    if (is_training_learner && !is_clean) reason_ = later_reason(reason_, StopReason::kNotSaved);
    return;
  }
  if (is_training_learner && is_clean) return learner_left();
  if (worker.role == Role::kTrajectorySender && is_clean &&
      effects_.arena().control().goal_reached.load() != 0)
    return stop(StopReason::kFinished, "the run that this host fed has ended");
  const std::string words = workers_.last_words(worker);
  const std::string said = words.empty() ? "it said nothing" : "its last line: " + words;
  // Starting it again would train the same frames once more, for the same end.
  if (how.signal == 0 && how.code == kExitNotSaved)
    return fail({ErrorCode::kNoSpace, "the last checkpoint could not be written, " + meter_.unsaved_text() +
                                          "; make room and start the same command again (" + said + ")"});
  if (how.signal == 0 && how.code == kExitBadInput)
    return fail({ErrorCode::kBadInput, worker.name + " cannot run: " + said});
  died(worker, how, said);
}

void Supervision::learner_left() {
  if (effects_.arena().control().goal_reached.load() != 0)
    stop(StopReason::kFinished, "finished" + meter_.limit_reached());
  else
    stop(StopReason::kInterrupted, "the learner received SIGTERM before the run's goal");
}

void Supervision::died(Worker& worker, const ExitStatus& how, const std::string& said) {
  const uint64_t lost = reclaim(worker);
  ++worker.restarts;
  const double now_s = clock_.now_s();
  const std::optional<double> delay_s =
      worker.history.next_delay_s(now_s, has_worked(worker, effects_.arena()));
  if (!delay_s)
    return fail({ErrorCode::kPeerLost,
                 fmt::format("{} died {} times and is given up ({}); {} (see {})", worker.name,
                             plan_.restarts.deaths, how.text(), said, workers_.log_path(worker))});
  worker.restart_at_s = now_s + *delay_s;
  char delay[32];
  std::snprintf(delay, sizeof delay, "%.1f s", *delay_s);
  const uint64_t memory_kills = how.signal == SIGKILL ? effects_.memory_kills() : memory_kills_;
  const bool is_out_of_memory = std::exchange(memory_kills_, memory_kills) < memory_kills;
  effects_.note(
      worker.name + " died (" + how.text() + "), starts again in " + delay +
      (is_out_of_memory
           ? "; the memory limit of the control group was reached: raise it, or lower --num_workers, "
             "--num_envs_per_worker, --trajectory_slabs or --replay_gb"
           : "") +
      (lost > 0 ? fmt::format("; {} decisions lost", lost) : "") +
      (worker.role == Role::kLearner && plan_.trains() ? "; training continues from the last checkpoint"
                                                       : ""));
  // Lock step must not depend on which worker died when: all go back to the last checkpoint together.
  starts_again_ |= plan_.is_lock_step();
}

/// Takes back what a dead worker held. Agent decisions that are lost with it.
uint64_t Supervision::reclaim(Worker& worker) {
  const std::optional<uint64_t> lost = effects_.reclaim(worker);
  worker.is_unreclaimed = !lost;
  if (worker.role == Role::kLearner) return meter_.learner_ended();
  // What a trajectory sender had delivered; its successor adopts what it had drained, and requests again.
  if (worker.role == Role::kTrajectorySender) meter_.count();
  return lost.value_or(0);
}

void Supervision::restart_everything() {
  meter_.count();  // what the dead ones counted last
  double restart_at_s = clock_.now_s();
  for (const Worker& worker : workers_.workers()) restart_at_s = std::max(restart_at_s, worker.restart_at_s);
  workers_.restart_all(restart_at_s);
  pauses_when_it_runs_ |= phase_ == RunPhase::kPaused;
  move(RunEvent::kStartAgain);
  if (Status opened = open(); !opened) fail(opened.error());
}

void Supervision::restart_due() {
  if (is_over(phase_)) return;
  for (Worker& worker : workers_.workers()) {
    if (worker.restart_at_s == 0 || clock_.now_s() < worker.restart_at_s) continue;
    if (worker.is_unreclaimed) {
      if (const uint64_t lost = reclaim(worker); lost > 0)
        effects_.note(fmt::format("{}: {} decisions lost", worker.name, lost));
      if (worker.is_unreclaimed) continue;
    }
    if (Status started = workers_.start(worker, effects_.arena(), effects_.socket_name()); !started)
      fail(started.error());
  }
}

void Supervision::begin_when_all_joined() {
  if (phase_ != RunPhase::kStarting || !workers_.all_joined()) return;
  move(RunEvent::kAllJoined);
  meter_.begin(clock_.now_s());
  effects_.set_run_state(shm::RunState::kRunning);
  if (!std::exchange(pauses_when_it_runs_, false)) return;
  move(RunEvent::kPause);
  effects_.set_run_state(shm::RunState::kPaused);
}

void Supervision::count_work() {
  if (meter_.count()) effects_.note(meter_.going_back_text());
}

void Supervision::complete_when_done() {
  if (!is_at_work()) return;
  if (meter_.measure(clock_.now_s())) return stop(StopReason::kFinished, "measured");
  if (plan_.feeds() && effects_.arena().control().leave_requested.load() != 0)
    return stop(StopReason::kFinished, "this host was asked to leave (comrad ctl drain)");
  if (plan_.episodes > 0 && meter_.episodes().size() >= plan_.episodes)
    stop(StopReason::kFinished, "finished");
}

void Supervision::tend_evaluations_and_hosts() {
  for (const std::string& words : evaluator_.tick()) effects_.note(words);
  for (const std::string& words : hosts_.tick(is_at_work())) effects_.note(words);
  if (is_at_work() && !hosts_.failure().empty()) fail({ErrorCode::kPeerLost, hosts_.failure()});
}

/// A last checkpoint or a video takes as long as the machine lets it: only one that makes no progress is killed.
bool Supervision::saves_something(const Worker& worker) const {
  return (worker.role == Role::kLearner && plan_.trains()) ||
         (worker.role == Role::kSim && plan_.recording.is_wanted());
}

void Supervision::enforce_stop() {
  if (!is_over(phase_)) return;
  const double now_s = clock_.now_s(), waited_s = now_s - stopping_since_s_;
  for (Worker& worker : workers_.workers()) {
    if (!worker.process) continue;
    if (saves_something(worker) && worker.process->is_at_work()) worker.at_work_s = now_s;
    const double idle_s = now_s - std::max(stopping_since_s_, worker.at_work_s);
    const int next = idle_s >= kKillAfterS ? SIGKILL : waited_s >= kTermAfterS ? SIGTERM : 0;
    if (waited_s >= kKillAfterS && next != SIGKILL && !std::exchange(worker.is_slow, true))
      effects_.note(worker.name + " is still at work and is waited for; " +
                    (interrupts_ > 0 ? "Ctrl-C kills it" : "two Ctrl-C kill it") +
                    (worker.role == Role::kLearner ? ", " + meter_.unsaved_text() : ""));
    if (next == 0 || worker.stop_signal == next) continue;
    worker.stop_signal = next;
    worker.process->send_signal(next);
    if (next == SIGKILL) effects_.note(worker.name + " did not stop in time and is killed");
  }
}

void Supervision::end_when_all_left() {
  if (!is_over(phase_) || workers_.any_alive()) return;
  if (phase_ == RunPhase::kStopping && evaluator_.plays_on()) {
    move(RunEvent::kWorkersLeft);
    effects_.note("trained; the last evaluations are played now (Ctrl-C leaves them out)");
  }
  if (!evaluator_.is_busy() && !hosts_.any_alive()) move(RunEvent::kAllLeft);
}

void Supervision::stop(StopReason reason, const std::string& words) {
  if (is_over(phase_)) return;
  move(RunEvent::kStop);
  reason_ = reason;
  stop_words_ = words;
  stopping_since_s_ = clock_.now_s();
  spdlog::info("stopping: {}", words);
  for (Worker& worker : workers_.workers()) {
    // A dead learner that waits for its next start saves nothing any more; a bench needs nothing of it.
    if (worker.role == Role::kLearner && plan_.trains() && worker.restart_at_s > 0 && plan_.seconds <= 0)
      reason_ = later_reason(reason_, StopReason::kNotSaved);
    worker.restart_at_s = 0;
  }
  if (effects_.is_open()) effects_.set_run_state(shm::RunState::kStopping);
  hosts_.stop();
  if (reason == StopReason::kFinished)
    evaluator_.hurry();  // the last checkpoint is there
  else
    leave_out_evaluations();
}

void Supervision::leave_out_evaluations() { evaluator_.stop(SIGTERM); }

void Supervision::fail(Error error) {
  if (!error_) error_ = std::move(error);
  spdlog::info("failed: {}", error_->message);
  stop(StopReason::kFailed, "failed");
  reason_ = StopReason::kFailed;
}

Status Supervision::check_at_work(RunEvent event) const {
  const Expected<RunPhase> next = next_phase(phase_, event);
  if (next) return {};
  if (phase_ != RunPhase::kStarting) return next.error();
  return Error{next.error().code,
               next.error().message + " (starting: " + workers_.joined_text() + "); ask again when it runs"};
}

void Supervision::move(RunEvent event) {
  const Expected<RunPhase> next = next_phase(phase_, event);
  COMRAD_CHECK(next, next.error().message);
  phase_ = *next;
}

Status Supervision::pause() {
  COMRAD_TRY(check_at_work(RunEvent::kPause));
  move(RunEvent::kPause);
  effects_.set_run_state(shm::RunState::kPaused);
  effects_.note("comrad ctl: paused; comrad ctl " + std::filesystem::path(plan_.run_dir).filename().string() +
                " resume continues");
  return {};
}

Status Supervision::resume() {
  COMRAD_TRY(check_at_work(RunEvent::kResume));
  move(RunEvent::kResume);
  effects_.set_run_state(shm::RunState::kRunning);
  effects_.note("comrad ctl: the run continues");
  return {};
}

Expected<uint32_t> Supervision::ask_for_checkpoint(const std::string& who) {
  if (!is_at_work()) COMRAD_TRY(check_at_work(RunEvent::kPause));
  const uint32_t request = effects_.arena().control().checkpoint_seq.fetch_add(1) + 1;
  effects_.note(who + ": a checkpoint is saved after this optimizer step");
  return request;
}

void Supervision::interrupt(int signal) {
  const double now_s = clock_.now_s();
  if (signal == SIGINT && interrupts_ > 0 && now_s - interrupted_s_ < kSameInterruptS) return;
  if (signal == SIGINT) interrupted_s_ = now_s;
  const bool is_second = signal == SIGINT && ++interrupts_ >= 2;
  const std::string name = signal == SIGINT ? "SIGINT" : signal == SIGTERM ? "SIGTERM" : "SIGHUP";
  if (!is_over(phase_)) {
    stop(StopReason::kInterrupted, "interrupted by " + name);
    effects_.note(name + ": stopping" +
                  (plan_.trains() ? " after this optimizer step and a checkpoint" : "") +
                  "; press Ctrl-C again to stop at once");
    return;
  }
  leave_out_evaluations();
  if (!is_second) return;
  reason_ = later_reason(reason_, StopReason::kKilled);
  workers_.signal_all(SIGKILL);
  evaluator_.stop(SIGKILL);
  hosts_.kill();
}

void Supervision::ask_to_stop() {
  if (is_over(phase_)) return leave_out_evaluations();
  stop(StopReason::kInterrupted, "stopped by comrad ctl");
  effects_.note("comrad ctl: stopping after this optimizer step and a checkpoint");
}

void Supervision::input_ended() {
  stop(StopReason::kInterrupted, "the run that called this host has let it go");
}

int Supervision::restarts() const {
  int sum = 0;
  for (const Worker& worker : workers_.workers()) sum += worker.restarts;
  return sum;
}

RunEnding Supervision::finish() {
  if (effects_.is_open()) {
    count_work();
    meter_.close();
  }
  if (!meter_.account_fault().empty()) effects_.note("warning: " + meter_.account_fault());
  RunEnding ending{.reason = reason_, .error = error_, .message = stop_words_, .restarts = restarts()};
  if (error_)
    ending.message = error_->message;
  else if (reason_ == StopReason::kKilled)
    ending.message += ", stopped at once";
  else if (reason_ == StopReason::kNotSaved)
    ending.message += "; the learner did not save a last checkpoint: " + meter_.unsaved_text();
  else if (reason_ == StopReason::kInterrupted && plan_.trains())
    ending.message +=
        "; continue with --experiment " + std::filesystem::path(plan_.run_dir).filename().string();
  return ending;
}

}  // namespace comrad::deploy
