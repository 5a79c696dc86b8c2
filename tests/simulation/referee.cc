#include "tests/simulation/referee.h"

#include <algorithm>
#include <numeric>

#include "rollout_buffer/shm/slab_pool.h"

namespace comrad::simulation {
namespace {

using deploy::RunPhase;

constexpr double kSlightS = 1e-6;
// The promise of a stop: a signal to leave after 8 s, an end by force after 9.5 s, all over within 10 s. A learner that
// still works on its last checkpoint has these times from its last moment of work on.
constexpr double kAskedS = 8, kForcedS = 9.5, kOverS = 10;
constexpr double kEvaluationForcedS = 4;
constexpr double kSameSigintS = 0.25;
// Of a host's calls.
constexpr deploy::RestartLimits kCalls{.first_delay_s = 2, .max_delay_s = 60, .window_s = 600, .deaths = 10};
constexpr double kHostWorkedS = 60;

uint64_t sum_of(const std::vector<uint64_t>& counts) {
  return std::accumulate(counts.begin(), counts.end(), uint64_t{0});
}

int rank_of(const Setting& setting, int place) {
  return setting.is_sim(place) ? 0 : setting.is_policy(place) ? 1 : 2;
}

bool is_clean(const ExitStatus& how) { return how.signal == 0 && how.code == 0; }

}  // namespace

uint64_t Ledger::waiting_least() const { return sum_of(in_hand) + sealed + taken; }
uint64_t Ledger::waiting_most() const { return waiting_least() + sum_of(orphaned); }
void Ledger::drop_all() {
  std::ranges::fill(in_hand, 0);
  std::ranges::fill(orphaned, 0);
  is_asking.assign(is_asking.size(), false);
  sealed = taken = 0;
}

Referee::Referee(const Setting& setting, const deploy::RestartLimits& limits, const ManualClock& clock,
                 SimulatedHost& host)
    : ledger(static_cast<std::size_t>(setting.sims)),
      setting_(setting),
      limits_(limits),
      clock_(clock),
      host_(host),
      records_(static_cast<std::size_t>(setting.place_count())),
      episodes_(kEpisodes) {
  for (int place = 0; place < setting.worker_count(); ++place) record(place).restart_at_s = clock.now_s();
}

void Referee::expect(bool holds, const char* rule, const std::string& what) {
  if (!holds && !failure_) failure_ = Failure{rule, what};
}

void Referee::stop(StopReason reason) {
  if (is_over()) return;
  base_ = reason;
  stopped_s_ = clock_.now_s();
  if (reason != StopReason::kFinished) left_out_s_ = stopped_s_;
  if (setting_.trains() && record(setting_.learner()).restart_at_s > 0) is_not_saved_ = true;
  for (Record& one : records_) one.restart_at_s = 0;
}

void Referee::interrupt(bool is_sigint) {
  const double now_s = clock_.now_s();
  if (is_sigint && sigints_ > 0 && now_s - sigint_s_ < kSameSigintS) return;
  if (is_sigint) sigint_s_ = now_s;
  sigints_ += is_sigint;
  if (!is_over()) return stop(StopReason::kInterrupted);
  if (left_out_s_ == 0) left_out_s_ = clock_.now_s();
  if (!is_sigint || sigints_ < 2 || is_killed_) return;
  is_killed_ = true;
  killed_s_ = clock_.now_s();
}

void Referee::ask_to_stop() {
  if (is_over() && left_out_s_ == 0) left_out_s_ = clock_.now_s();
  stop(StopReason::kInterrupted);
}

void Referee::input_ended() { stop(StopReason::kInterrupted); }

void Referee::ended_episode(int id) {
  if (id < kEpisodes) episodes_[static_cast<std::size_t>(id)] = true;
}

const char* Referee::no_pause() const {
  if (!is_at_work()) return no_work();
  return is_paused_ ? "the run is paused already" : nullptr;
}

const char* Referee::no_resume() const {
  if (!is_at_work()) return no_work();
  return is_paused_ ? nullptr : "the run is not paused";
}

double Referee::limit_delay_s(const deploy::RestartLimits& limits, std::size_t deaths) const {
  double delay_s = limits.first_delay_s;
  while (--deaths > 0 && delay_s < limits.max_delay_s) delay_s *= 2;
  return std::min(delay_s, limits.max_delay_s);
}

void Referee::judge(const deploy::Supervision& run, const shm::Arena* arena, double late_s) {
  judge_exits();
  judge_starts(late_s);
  bool are_all_here = true;
  for (int place = 0; place < setting_.worker_count(); ++place) {
    const Body* body = host_.living(place);
    are_all_here &= body != nullptr && body->has_joined;
  }
  if (!is_over() && are_all_here) has_begun_ = true;
  if (is_at_work() && setting_.kind == RunKind::kEvaluate &&
      std::ranges::all_of(episodes_, [](bool is_played) { return is_played; }))
    stop(StopReason::kFinished);
  judge_hosts(late_s);
  judge_signals(late_s);
  judge_phase(run, arena);
  if (setting_.trains() && arena != nullptr) judge_accounts(run, arena);
}

/// In the order of their roles, the learner's first.
void Referee::judge_exits() {
  std::vector<Exit> exits = host_.exits();
  std::erase_if(exits, [this](const Exit& exit) { return !setting_.is_worker(exit.place); });
  std::ranges::stable_sort(exits, [this](const Exit& a, const Exit& b) {
    const int first = rank_of(setting_, a.place), second = rank_of(setting_, b.place);
    return first != second ? first > second : a.place < b.place;
  });
  bool has_died = false;
  for (const Exit& exit : exits) {
    const bool is_learner = setting_.is_learner(exit.place);
    if (is_over())
      is_not_saved_ |= is_learner && !is_clean(exit.how);
    else if (is_learner && is_clean(exit.how))
      stop(has_goal_ ? StopReason::kFinished : StopReason::kInterrupted);
    else if (exit.how.signal == 0 && (exit.how.code == 2 || exit.how.code == 3))
      stop(StopReason::kFailed);
    else
      died(exit), has_died = true;
  }
  if (!has_died || is_over() || setting_.kind != RunKind::kLockStep) return;
  // Lock step: all start again together.
  has_begun_ = has_goal_ = false;
  double latest_s = clock_.now_s();
  for (int place = 0; place < setting_.worker_count(); ++place)
    latest_s = std::max(latest_s, record(place).restart_at_s);
  for (int place = 0; place < setting_.worker_count(); ++place) record(place).restart_at_s = latest_s;
}

void Referee::died(const Exit& exit) {
  const double now_s = clock_.now_s();
  Record& one = record(exit.place);
  while (!one.deaths_s.empty() && now_s - one.deaths_s.front() >= limits_.window_s) one.deaths_s.pop_front();
  one.deaths_s.push_back(now_s);
  one.idle_deaths = exit.body->has_worked ? 0 : one.idle_deaths + 1;
  // What it held is lost.
  if (setting_.is_learner(exit.place)) ledger.taken = 0;
  for (int sim = 0; setting_.is_policy(exit.place) && sim < setting_.sims; ++sim)
    if (setting_.policy_of(sim) == exit.place) ledger.is_asking[static_cast<std::size_t>(sim)] = false;
  if (setting_.is_sim(exit.place)) {
    const auto sim = static_cast<std::size_t>(exit.place);
    one.is_held = ledger.is_asking[sim];
    ledger.orphaned[sim] = one.is_held ? ledger.in_hand[sim] : 0;
    ledger.in_hand[sim] = 0;
  }
  if (static_cast<int>(one.deaths_s.size()) >= limits_.deaths || one.idle_deaths >= limits_.deaths)
    return stop(StopReason::kFailed);
  one.restart_at_s = now_s + limit_delay_s(limits_, one.deaths_s.size());
}

void Referee::judge_starts(double late_s) {
  const double now_s = clock_.now_s();
  for (const int place : host_.doubles())
    expect(false, "one process a place", setting_.name(place) + " was started beside a living one");
  for (const int place : host_.starts()) {
    if (!setting_.is_worker(place)) continue;
    Record& one = record(place);
    expect(!is_over(), "nothing starts after a stop", setting_.name(place) + " was started");
    expect(one.restart_at_s > 0 && now_s >= one.restart_at_s - kSlightS, "restarts",
           setting_.name(place) + " was started too early");
    one.restart_at_s = 0;
    one.is_held = false;
    if (setting_.is_sim(place)) ledger.orphaned[static_cast<std::size_t>(place)] = 0;
  }
  for (const int place : host_.failures())
    if (setting_.is_worker(place)) stop(StopReason::kFailed);
  for (int place = 0; place < setting_.worker_count(); ++place) {
    const Record& one = record(place);
    expect(one.restart_at_s == 0 || one.is_held || now_s < one.restart_at_s + kSlightS + late_s, "restarts",
           setting_.name(place) + " was not started again in time");
  }
}

void Referee::judge_hosts(double late_s) {
  const double now_s = clock_.now_s();
  for (const Exit& exit : host_.exits()) {
    if (!setting_.is_host(exit.place) || is_over()) continue;
    Record& one = record(exit.place);
    if (exit.how.signal == 0 && (exit.how.code == 0 || exit.how.code == 2)) {
      one.is_given_up = true;
    } else {
      while (!one.deaths_s.empty() && now_s - one.deaths_s.front() >= kCalls.window_s)
        one.deaths_s.pop_front();
      one.deaths_s.push_back(now_s);
      one.idle_deaths = now_s - exit.body->started_s > kHostWorkedS ? 0 : one.idle_deaths + 1;
      one.is_given_up =
          static_cast<int>(one.deaths_s.size()) >= kCalls.deaths || one.idle_deaths >= kCalls.deaths;
      one.restart_at_s = now_s + limit_delay_s(kCalls, one.deaths_s.size());
    }
    has_host_failed_ |= one.is_given_up && setting_.are_needed;
  }
  for (const int place : host_.starts()) {
    if (setting_.is_host(place)) {
      Record& one = record(place);
      expect(is_at_work(), "hosts", setting_.name(place) + " was called while the run is not at work");
      expect(!one.is_given_up && now_s >= one.restart_at_s - kSlightS, "hosts",
             setting_.name(place) + " was called too early");
      one.restart_at_s = 0;
    } else if (place == setting_.evaluation()) {
      expect(left_out_s_ == 0, "evaluations", "an evaluation began although they are left out");
    }
  }
  for (int place = setting_.host(0); is_at_work() && place < setting_.evaluation(); ++place) {
    const Record& one = record(place);
    expect(host_.living(place) != nullptr || one.is_given_up || now_s < one.restart_at_s + kSlightS + late_s,
           "hosts", setting_.name(place) + " was not called in time");
  }
  if (is_at_work() && has_host_failed_) stop(StopReason::kFailed);
}

void Referee::judge_signals(double late_s) {
  const double now_s = clock_.now_s(), waited_s = now_s - stopped_s_;
  const Body* const learner = setting_.trains() ? host_.living(setting_.learner()) : nullptr;
  if (is_over() && learner != nullptr && !learner->is_hung) saved_s_ = now_s;
  for (int place = 0; place < setting_.evaluation(); ++place) {
    const Body* body = host_.body(place);
    if (body == nullptr) continue;
    const std::string name = setting_.name(place);
    const bool is_stuck =
        setting_.is_worker(place) && !body->has_joined && body->started_s + kJoinWithinS < now_s + kSlightS;
    const double idle_since_s = setting_.is_learner(place) ? std::max(stopped_s_, saved_s_) : stopped_s_;
    if (is_over() && body->is_alive()) {
      expect(waited_s < kAskedS || body->term_s > 0, "deadlines", name + " got no SIGTERM after 8 s");
      expect(now_s - idle_since_s < kForcedS, "deadlines", name + " is alive 9.5 s after the stop");
      expect(!is_killed_, "deadlines", name + " is alive after a second SIGINT");
    }
    if (!is_over() && setting_.is_worker(place) && body->is_alive())
      expect(!is_stuck || now_s - body->started_s < kJoinWithinS + late_s, "deadlines",
             name + " never joins");
    if (body->term_s > 0)
      expect(is_over() && body->term_s >= stopped_s_ + kAskedS - kSlightS, "deadlines",
             name + " got SIGTERM too early");
    if (body->kill_s > 0)
      expect((is_over() && body->kill_s >= idle_since_s + kForcedS - kSlightS) ||
                 (is_killed_ && body->kill_s >= killed_s_) || is_stuck,
             "deadlines", name + " was killed too early");
  }
  const Body* evaluation = host_.living(setting_.evaluation());
  if (evaluation != nullptr && left_out_s_ > 0) {
    expect(evaluation->term_s > 0, "deadlines", "an evaluation that is left out got no SIGTERM");
    expect(now_s < left_out_s_ + kEvaluationForcedS + kSlightS, "deadlines",
           "an evaluation that is left out lives on");
  }
}

void Referee::judge_phase(const deploy::Supervision& run, const shm::Arena* arena) {
  const RunPhase phase = run.phase();
  const double now_s = clock_.now_s();
  const RunPhase expected = !has_begun_  ? RunPhase::kStarting
                            : is_paused_ ? RunPhase::kPaused
                                         : RunPhase::kRunning;
  expect(is_over() ? deploy::is_over(phase) : phase == expected, "phase",
         std::string("the run is ") + word_of(phase) + " and should be " +
             (is_over() ? "stopping" : word_of(expected)));
  expect(run.reason() == expected_reason(), "reason",
         std::string("the run ") + word_of(run.reason()) + " and should be: " + word_of(expected_reason()));
  expect(phase != RunPhase::kEnded || !host_.any_alive(), "left alive", "a process outlives the run");
  if (is_over() && !plays_on())
    expect(phase == RunPhase::kEnded || now_s < std::max(std::max(stopped_s_, saved_s_) + kOverS,
                                                         left_out_s_ + kEvaluationForcedS + 1),
           "deadlines", "the run is not over 10 s after its stop");
  if (arena == nullptr) return;
  const shm::RunState state = arena->control().run_state.load();
  const shm::RunState wanted = is_over()                         ? shm::RunState::kStopping
                               : expected == RunPhase::kStarting ? shm::RunState::kStarting
                               : expected == RunPhase::kPaused   ? shm::RunState::kPaused
                                                                 : shm::RunState::kRunning;
  expect(state == wanted, "run state",
         "workers see state " + std::to_string(static_cast<int>(state)) + " and not " +
             std::to_string(static_cast<int>(wanted)));
}

StopReason Referee::expected_reason() const {
  if (base_ == StopReason::kNone || base_ == StopReason::kFailed) return base_;
  if (is_killed_) return StopReason::kKilled;
  return is_not_saved_ ? StopReason::kNotSaved : base_;
}

void Referee::judge_accounts(const deploy::Supervision& run, const shm::Arena* arena) {
  const deploy::DecisionAccounts accounts = run.meter().accounts();
  const auto is = [this](uint64_t found, uint64_t least, uint64_t most, const char* word) {
    expect(least <= found && found <= most, "accounts",
           std::to_string(found) + " decisions " + word + ", not " + std::to_string(least) +
               (least == most ? "" : " to " + std::to_string(most)));
  };
  is(accounts.made, ledger.made, ledger.made, "made");
  is(accounts.trained, ledger.trained, ledger.trained, "trained");
  is(accounts.forgotten, ledger.forgotten, ledger.forgotten, "forgotten");
  is(accounts.waiting, ledger.waiting_least(), ledger.waiting_most(), "wait");
  is(accounts.trained + accounts.lost() + accounts.waiting, accounts.made, accounts.made, "accounted for");
  expect(run.meter().account_fault().empty(), "accounts", run.meter().account_fault());
  const auto has_slab = [](uint64_t decisions) { return decisions > 0; };
  const auto least = std::ranges::count_if(ledger.in_hand, has_slab),
             most = least + std::ranges::count_if(ledger.orphaned, has_slab);
  const int filling = arena->slabs().counts().filling;
  expect(least <= filling && filling <= most, "slabs",
         std::to_string(filling) + " slabs are being filled, not " + std::to_string(least));
}

void Referee::judge_end(const deploy::Supervision& run, const deploy::RunEnding& ending) {
  struct Row {
    StopReason reason;
    int exit_code;
    std::string state;
  };
  static const Row kRows[] = {{StopReason::kFinished, 0, "finished"},
                              {StopReason::kInterrupted, 0, "paused"},
                              {StopReason::kNotSaved, 1, "paused"},
                              {StopReason::kKilled, 130, "paused"},
                              {StopReason::kFailed, 1, "failed"}};
  expect(ending.reason == expected_reason(), "reason", "the run ended for another reason");
  const auto row = std::ranges::find(kRows, ending.reason, &Row::reason);
  expect(row != std::end(kRows) && deploy::exit_code_of(ending.reason) == row->exit_code &&
             deploy::final_state_of(ending.reason) == row->state,
         "exit code", "exit code and status do not fit the reason");
  expect(ending.error.has_value() == (ending.reason == StopReason::kFailed), "exit code",
         "the error does not fit the reason");
  expect(!ending.message.empty(), "exit code", "the run ends without a word");
  expect(!host_.any_alive(), "left alive", "a process outlives the run");
  if (!setting_.trains()) return;
  const deploy::DecisionAccounts accounts = run.meter().accounts();
  expect(accounts.made == ledger.made && accounts.trained == ledger.trained && accounts.waiting == 0 &&
             accounts.made == accounts.trained + accounts.lost(),
         "accounts",
         "at the end: " + accounts.text() + "; in truth " + std::to_string(ledger.made) + " made, " +
             std::to_string(ledger.trained) + " trained on");
}

}  // namespace comrad::simulation
