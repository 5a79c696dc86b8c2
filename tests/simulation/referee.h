// Judges a simulated run: keeps its own account of what happened, by rules that are written here a second time, and compares the
// supervisor's phase, reason, restarts, signals and accounts with it after every turn.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "deploy/launch/restart_policy.h"
#include "deploy/launch/supervision.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/shm/arena.h"
#include "tests/simulation/schedule.h"
#include "tests/simulation/simulated_host.h"

namespace comrad::simulation {

using deploy::StopReason;

/// Where every agent decision is, by the hands that moved it.
struct Ledger {
  explicit Ledger(std::size_t sims) : in_hand(sims), orphaned(sims), is_asking(sims) {}
  uint64_t made = 0, trained = 0, forgotten = 0;
  std::vector<uint64_t> in_hand;  ///< of living simulators
  std::vector<uint64_t>
      orphaned;  ///< of dead ones, where a policy worker may still be writing: taken back or not
  std::vector<bool> is_asking;  ///< a policy worker is writing its answer
  uint64_t sealed = 0, taken = 0;
  uint64_t counter = 0;  ///< the learner's, of the run
  uint64_t saved = 0;    ///< in the last checkpoint

  uint64_t waiting_least() const;
  uint64_t waiting_most() const;
  /// All workers start again in a new arena.
  void drop_all();
};

/// A rule that was broken.
struct Failure {
  std::string rule;  ///< "accounts", "deadlines", ...
  std::string what;
};

class Referee {
 public:
  /// What the arguments name outlives it. `limits` are those that the run should keep to.
  Referee(const Setting& setting, const deploy::RestartLimits& limits, const ManualClock& clock,
          SimulatedHost& host);

  // What the user does; before the run is notified.
  void interrupt(bool is_sigint);
  void ask_to_stop();
  void input_ended();
  /// Why the run must refuse; null: it must not.
  const char* no_pause() const;
  const char* no_resume() const;
  const char* no_checkpoint() const { return is_at_work() ? nullptr : no_work(); }
  void paused() { is_paused_ = true; }
  void resumed() { is_paused_ = false; }
  void expect(bool holds, const char* rule, const std::string& what);

  // What workers do.
  void reached_goal() { has_goal_ = true; }
  void ended_episode(int id);

  /// After a turn that came `late_s` after the one before.
  void judge(const deploy::Supervision& run, const shm::Arena* arena, double late_s);
  /// After finish().
  void judge_end(const deploy::Supervision& run, const deploy::RunEnding& ending);

  bool is_over() const { return base_ != StopReason::kNone; }
  bool is_at_work() const { return has_begun_ && !is_over(); }
  /// It has finished, and its last evaluations are still waited for.
  bool plays_on() const { return base_ == StopReason::kFinished && left_out_s_ == 0; }
  const std::optional<Failure>& failure() const { return failure_; }

  Ledger ledger;

 private:
  /// One worker's or host's restarts.
  struct Record {
    std::deque<double> deaths_s;
    int idle_deaths = 0;
    double restart_at_s = 0;  ///< 0: none is due
    bool is_given_up = false;
    bool is_held = false;  ///< a policy worker still writes for it
  };
  Record& record(int place) { return records_[static_cast<std::size_t>(place)]; }
  void stop(StopReason reason);
  void judge_exits();
  void died(const Exit& exit);
  void judge_starts(double late_s);
  void judge_hosts(double late_s);
  void judge_signals(double late_s);
  void judge_phase(const deploy::Supervision& run, const shm::Arena* arena);
  void judge_accounts(const deploy::Supervision& run, const shm::Arena* arena);
  StopReason expected_reason() const;
  const char* no_work() const { return is_over() ? "the run is stopping" : "the run is starting"; }
  double limit_delay_s(const deploy::RestartLimits& limits, std::size_t deaths) const;

  const Setting& setting_;
  const deploy::RestartLimits limits_;
  const ManualClock& clock_;
  SimulatedHost& host_;
  std::vector<Record> records_;
  std::vector<bool> episodes_;
  std::optional<Failure> failure_;
  bool has_begun_ = false, is_paused_ = false, has_goal_ = false;
  bool is_not_saved_ = false, is_killed_ = false, has_host_failed_ = false;
  int sigints_ = 0;
  StopReason base_ = StopReason::kNone;
  double stopped_s_ = 0, left_out_s_ = 0, killed_s_ = 0;
  double sigint_s_ = 0;
  double saved_s_ = 0;  // of a stop: when the learner was last at work
};

/// Episodes that a simulated evaluation plays.
constexpr int kEpisodes = 4;
/// A worker that has not joined by then is stuck.
constexpr double kJoinWithinS = 120;
/// A slab's steps, and agents in a step.
constexpr int kSlabSteps = 8, kAgents = 2;

}  // namespace comrad::simulation
