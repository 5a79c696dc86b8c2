#include "tests/simulation/simulated_run.h"

#include <algorithm>
#include <climits>
#include <cstring>

#include "rollout_buffer/shm/accounts.h"
#include "rollout_buffer/shm/learner_report.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "rollout_buffer/shm/step_slots.h"

namespace comrad::simulation {
namespace {

using deploy::RestartLimits;

// Few deaths give a worker up, so that schedules reach it.
constexpr RestartLimits kLimits{.first_delay_s = 0.2, .max_delay_s = 10, .window_s = 60, .deaths = 4};

deploy::LaunchPlan plan_of(const Setting& setting, Fault fault) {
  deploy::LaunchPlan plan;
  plan.run_dir = "/nowhere/simulated";
  plan.bin_dir = "simulated";
  plan.env = {.num_agents = kAgents, .channels = 3, .height = 4, .width = 6, .head_count = 1};
  plan.env.head_sizes = {2};
  plan.config.environment.env_frameskip = 4;
  plan.config.collection.num_workers = setting.sims;
  plan.config.collection.policy_workers = setting.policies;
  plan.config.collection.num_envs_per_worker = plan.config.collection.worker_num_splits = 1;
  plan.config.collection.rollout = kSlabSteps;
  plan.config.collection.trajectory_slabs = 2 * setting.sims + 2;
  plan.config.collection.async_rl = setting.kind != RunKind::kLockStep;
  plan.config.run.eval_every_env_frames = setting.evaluates ? 1000 : 0;
  plan.join_timeout_s = kJoinWithinS;
  plan.restarts = kLimits;
  if (fault == Fault::kRestartsWithoutBound) plan.restarts.deaths = INT_MAX;
  if (fault == Fault::kHurries) plan.restarts.first_delay_s = 0.01;
  if (setting.kind == RunKind::kEvaluate)
    plan.policy = deploy::PolicySource::kRandom, plan.episodes = kEpisodes;
  plan.hosts.resize(static_cast<std::size_t>(setting.hosts));
  for (int host = 0; host < setting.hosts; ++host) {
    const std::string name = setting.name(setting.host(host));
    plan.hosts[static_cast<std::size_t>(host)] = {
        .name = name, .command = {name}, .is_needed = setting.are_needed};
  }
  return plan;
}

shm::JoinRequest request_of(const Setting& setting, int place) {
  shm::JoinRequest request;
  const bool is_policy = setting.is_policy(place), is_sim = setting.is_sim(place);
  std::strncpy(request.role, is_sim ? "sim" : is_policy ? "policy" : "learner", sizeof request.role - 1);
  request.worker_index = static_cast<uint32_t>(is_sim ? place : is_policy ? place - setting.sims : 0);
  return request;
}

}  // namespace

Status SimulatedEffects::open() {
  arena_.reset();
  ledger_.drop_all();
  ++openings_;
  COMRAD_TRY_ASSIGN(const shm::ArenaShape shape, deploy::arena_shape(plan_));
  COMRAD_TRY_ASSIGN(arena_, shm::Arena::create(shape, 1));
  return {};
}

void SimulatedEffects::set_run_state(shm::RunState state) {
  if (fault_ == Fault::kTellsNobodyOfTheStop && state == shm::RunState::kStopping) return;
  arena_->control().run_state.store(state);
}

std::optional<uint64_t> SimulatedEffects::reclaim(const deploy::Worker& worker) {
  return fault_ == Fault::kForgetsTheDead ? 0 : deploy::reclaim_worker(worker, *arena_);
}

void SimulatedFolder::save(uint64_t env_frames) {
  waiting_.push_back(
      {.path = std::to_string(env_frames), .version = 1, .env_frames = env_frames, .train_seconds = 1});
}

void SimulatedFolder::remove(const deploy::Snapshot& snapshot) {
  std::erase_if(waiting_, [&](const deploy::Snapshot& one) { return one.path == snapshot.path; });
}

Status SimulatedFolder::record(const deploy::Snapshot& snapshot, uint64_t, const MetricValues&) {
  has_repeated_ |= std::ranges::find(recorded_, snapshot.env_frames) != recorded_.end();
  recorded_.push_back(snapshot.env_frames);
  return {};
}

std::string SimulatedFolder::result() {
  return R"({"J_mean": 1, "J_ci95": 1, "J_share": null, "return_mean": 1, "length_tics_mean": 1, "episodes": 1})";
}

SimulatedRun::SimulatedRun(const Setting& setting, Fault fault)
    : setting_(setting),
      host_(setting_, clock_),
      plan_(plan_of(setting, fault)),
      referee_(setting_, kLimits, clock_, host_),
      effects_(plan_, referee_.ledger, fault),
      slabs_(static_cast<std::size_t>(setting.sims)),
      supervision_(plan_, clock_, host_, folder_, effects_) {
  if (fault == Fault::kSparesTheStubborn) host_.ignore_kills();
  if (fault == Fault::kSeesNobodyAtWork) host_.show_nobody_at_work();
  supervision_.start();
  openings_ = effects_.openings();
  referee_.judge(supervision_, &effects_.arena(), 0);
}

shm::WorkerCounters& SimulatedRun::counters(int place) const {
  const shm::Arena& arena = effects_.arena();
  if (setting_.is_sim(place)) return arena.sim_counters(place);
  if (setting_.is_policy(place)) return arena.policy_counters(place - setting_.sims);
  return arena.learner_counters();
}

bool SimulatedRun::is_run_state(shm::RunState state) const {
  return effects_.arena().control().run_state.load() == state;
}

const char* SimulatedRun::why_not(const Step& step) const {
  if (has_finished_) return "the run has ended";
  if (step.place >= setting_.place_count()) return "there is no such process";
  const Body* last = has_place(step.verb) ? host_.body(step.place) : nullptr;
  const bool is_worker = setting_.is_worker(step.place);
  switch (step.verb) {
    case Verb::kPause:
      return referee_.no_pause();
    case Verb::kResume:
      return referee_.no_resume();
    case Verb::kCheckpoint:
      return referee_.no_checkpoint();
    case Verb::kRefusedPause:
      return referee_.no_pause() == nullptr ? "the run may be paused" : nullptr;
    case Verb::kRefusedResume:
      return referee_.no_resume() == nullptr ? "the run may be resumed" : nullptr;
    case Verb::kRefusedCheckpoint:
      return referee_.no_checkpoint() == nullptr ? "a checkpoint may be saved" : nullptr;
    case Verb::kUnstartable:
      return !is_worker ? "it is no worker" : host_.is_unstartable(step.place) ? "it is so already" : nullptr;
    case Verb::kJoinAgain:
      if (!is_worker) return "it is no worker";
      if (last == nullptr) return "it was not started";
      return last->is_alive() && !last->has_joined ? "it has not joined yet" : nullptr;
    default:
      break;
  }
  if (!has_place(step.verb)) return nullptr;
  if (last == nullptr) return "it was not started";
  if (!last->is_alive()) return "it has ended";
  if (step.verb == Verb::kDie) return step.number < 1 ? "that is no signal" : nullptr;
  if (last->is_hung) return "it hangs";
  if (step.verb == Verb::kExit || step.verb == Verb::kHang) return nullptr;
  if (!is_worker) return "it is no worker";
  if (step.verb == Verb::kSlow) return step.number <= 0 ? "that is no time" : nullptr;
  if (step.verb == Verb::kJoin) return last->has_joined ? "it has joined already" : nullptr;
  return last->has_joined ? why_no_work(step) : "it has not joined";
}

/// Of a step that a worker takes in the run.
const char* SimulatedRun::why_no_work(const Step& step) const {
  const bool is_at_work = is_run_state(shm::RunState::kRunning);
  const auto sim = static_cast<std::size_t>(step.place);
  switch (step.verb) {
    case Verb::kPlay:
    case Verb::kAsk:
    case Verb::kEpisode:
      if (!setting_.is_sim(step.place)) return "it is no simulator";
      if (!is_at_work) return "the run is not at work";
      if (referee_.ledger.is_asking[sim]) return "it waits for an answer";
      if (step.verb == Verb::kEpisode) return setting_.trains() ? "the run trains" : nullptr;
      if (step.verb == Verb::kAsk)
        return body(setting_.policy_of(step.place)) == nullptr ||
                       !body(setting_.policy_of(step.place))->has_joined
                   ? "its policy worker is away"
                   : nullptr;
      return setting_.trains() && !slabs_[sim] && effects_.arena().slabs().counts().free == 0
                 ? "no slab is free"
                 : nullptr;
    case Verb::kAnswer:
      return setting_.is_policy(step.place) ? nullptr : "it is no policy worker";
    default:
      break;
  }
  if (!setting_.is_learner(step.place)) return "it is not the learner";
  switch (step.verb) {
    case Verb::kTake:
      return !is_at_work                                    ? "the run is not at work"
             : effects_.arena().slabs().sealed_count() == 0 ? "no slab is sealed"
                                                            : nullptr;
    case Verb::kTrain:
      return taken_.empty() ? "it has taken nothing" : nullptr;
    case Verb::kSnapshot:
      return setting_.evaluates ? nullptr : "the run evaluates nothing";
    case Verb::kFinish:
    case Verb::kLeave:
      return is_at_work ? nullptr : "the run is not at work";
    default:
      return nullptr;
  }
}

Status SimulatedRun::apply(const Step& step) {
  if (const char* why = why_not(step); why != nullptr)
    return Error{ErrorCode::kBadInput, "'" + text_of(step, setting_) + "': " + why};
  Body* one = has_place(step.verb) ? body(step.place) : nullptr;
  const double now_s = clock_.now_s();
  const auto must = [&](const Status& granted, bool is_granted) {
    referee_.expect(
        granted.has_value() == is_granted, "requests",
        text_of(step, setting_) + (granted ? " is granted" : " is refused: " + granted.error().message));
  };
  const auto checkpoint = [this]() -> Status {
    const Expected<uint32_t> request = supervision_.ask_for_checkpoint("a user");
    return request ? Status() : Status(request.error());
  };
  switch (step.verb) {
    case Verb::kWait:
      wait(step.number);
      break;
    case Verb::kJoin:
      join(step.place);
      break;
    case Verb::kJoinAgain:
      supervision_.workers().note_joined(request_of(setting_, step.place));
      break;
    case Verb::kPlay:
      play(step.place, static_cast<int>(step.number));
      break;
    case Verb::kAsk:
      effects_.arena().step_slots().slot(step.place).state.store(shm::SlotState::kInBatch);
      referee_.ledger.is_asking[static_cast<std::size_t>(step.place)] = true;
      break;
    case Verb::kAnswer:
      for (int sim = 0; sim < setting_.sims; ++sim) {
        if (setting_.policy_of(sim) != step.place) continue;
        shm::advance(effects_.arena().step_slots().slot(sim), shm::SlotState::kInBatch,
                     shm::SlotState::kActed);
        referee_.ledger.is_asking[static_cast<std::size_t>(sim)] = false;
      }
      counters(step.place).decisions += kAgents;
      one->has_worked = true;
      break;
    case Verb::kTake:
      take();
      break;
    case Verb::kTrain:
      train();
      break;
    case Verb::kReport: {
      TrainStats report;
      report.decisions = referee_.ledger.counter;
      report.env_frames = 4 * report.decisions;
      effects_.arena().learner_reports().publish(report);
      (void)supervision_.meter().take_report();
      break;
    }
    case Verb::kSave:
      referee_.ledger.saved = referee_.ledger.counter;
      break;
    case Verb::kSnapshot:
      folder_.save(1000 * ++snapshots_);
      break;
    case Verb::kFinish:
      effects_.arena().control().goal_reached.store(1);
      referee_.reached_goal();
      leave(*one);
      break;
    case Verb::kLeave:
      leave(*one);
      break;
    case Verb::kEpisode: {
      EpisodeRecord record;
      record.episode_id = static_cast<uint64_t>(step.number);
      if (record.episode_id < kEpisodes) supervision_.meter().add(record);
      referee_.ended_episode(static_cast<int>(step.number));
      break;
    }
    case Verb::kExit:
      one->end({.code = static_cast<int>(step.number), .signal = 0}, now_s);
      break;
    case Verb::kDie:
      one->end({.code = 0, .signal = static_cast<int>(step.number)}, now_s);
      break;
    case Verb::kHang:
      one->is_hung = true;
      break;
    case Verb::kSlow:
      one->slow_s = step.number;
      break;
    case Verb::kUnstartable:
      host_.make_unstartable(step.place);
      break;
    case Verb::kPause:
      must(supervision_.pause(), true);
      referee_.paused();
      break;
    case Verb::kResume:
      must(supervision_.resume(), true);
      referee_.resumed();
      break;
    case Verb::kCheckpoint:
      must(checkpoint(), true);
      break;
    case Verb::kRefusedPause:
      must(supervision_.pause(), false);
      break;
    case Verb::kRefusedResume:
      must(supervision_.resume(), false);
      break;
    case Verb::kRefusedCheckpoint:
      must(checkpoint(), false);
      break;
    case Verb::kStop:
      referee_.ask_to_stop();
      supervision_.ask_to_stop();
      break;
    case Verb::kInterrupt:
    case Verb::kTerminate:
    case Verb::kHangUp:
      referee_.interrupt(step.verb == Verb::kInterrupt);
      supervision_.interrupt(step.verb == Verb::kInterrupt   ? SIGINT
                             : step.verb == Verb::kTerminate ? SIGTERM
                                                             : SIGHUP);
      break;
    case Verb::kLetGo:
      referee_.input_ended();
      supervision_.input_ended();
      break;
  }
  return {};
}

/// At most 16 turns, but as many as a stop needs.
void SimulatedRun::wait(double seconds) {
  double left_s = seconds;
  do {
    const double most_s = referee_.is_over() ? setting_.tick_s : std::max(setting_.tick_s, seconds / 16);
    turn(std::min(left_s, most_s));
    left_s -= most_s;
  } while (left_s > 1e-9 && !has_finished_ && !failure());
}

void SimulatedRun::turn(double seconds) {
  clock_.advance_s(seconds);
  let_bodies_act();
  host_.forget_news();
  supervision_.tick();
  if (std::exchange(openings_, effects_.openings()) != effects_.openings()) {
    std::ranges::fill(slabs_, std::nullopt);
    taken_.clear();
  }
  for (const Exit& exit : host_.exits()) {
    if (setting_.is_sim(exit.place)) slabs_[static_cast<std::size_t>(exit.place)].reset();
    if (setting_.is_learner(exit.place)) taken_.clear();
  }
  referee_.judge(supervision_, effects_.is_open() ? &effects_.arena() : nullptr, seconds);
  if (!supervision_.has_ended() || has_finished_) return;
  has_finished_ = true;
  ending_ = supervision_.finish();
  referee_.judge_end(supervision_, ending_);
  referee_.expect(!folder_.has_repeated(), "evaluations", "a checkpoint was evaluated twice");
  referee_.expect(!referee_.plays_on() || folder_.waiting() == 0, "evaluations",
                  "a checkpoint was not evaluated");
}

/// Workers with a stop request leave, unless they hang.
void SimulatedRun::let_bodies_act() {
  const double now_s = clock_.now_s();
  const bool is_stopping = is_run_state(shm::RunState::kStopping);
  if (is_stopping && over_s_ == 0) over_s_ = now_s;
  for (int place = 0; place < setting_.place_count(); ++place) {
    Body* one = body(place);
    if (one == nullptr || one->is_hung) continue;
    if (setting_.is_worker(place)) {
      const bool is_told = one->term_s > 0 && one->slow_s == 0;
      const double takes_s = one->slow_s > 0 ? one->slow_s : setting_.leave_s * (1 + 0.1 * place);
      if (is_told || (is_stopping && now_s >= over_s_ + takes_s)) leave(*one);
    } else if (setting_.is_host(place)) {
      if (one->term_s > 0 || one->input_ended_s > 0) one->end({}, now_s);
    } else if (one->term_s > 0) {
      one->end({.code = 0, .signal = SIGTERM}, now_s);
    }
  }
}

/// A worker that leaves by itself; a learner saves.
void SimulatedRun::leave(Body& one) {
  if (setting_.is_learner(one.place)) referee_.ledger.saved = referee_.ledger.counter;
  one.end({}, clock_.now_s());
}

void SimulatedRun::join(int place) {
  body(place)->has_joined = true;
  shm::WorkerCounters& counts = counters(place);
  counts.begin_life();
  if (setting_.is_learner(place)) {
    // It continues from its checkpoint.
    Ledger& ledger = referee_.ledger;
    ledger.forgotten += ledger.counter - ledger.saved;
    ledger.counter = ledger.saved;
    counts.decisions = ledger.saved;
    effects_.arena().control().learner_decisions_before = ledger.saved;
    effects_.arena().control().learner_env_frames = 4 * ledger.saved;
  }
  counts.state = shm::WorkerState::kRunning;
  supervision_.workers().note_joined(request_of(setting_, place));
}

void SimulatedRun::play(int sim, int steps) {
  const shm::Arena& arena = effects_.arena();
  Ledger& ledger = referee_.ledger;
  body(sim)->has_worked |= steps > 0;
  counters(sim).decisions += static_cast<uint64_t>(steps * kAgents);
  if (!setting_.trains()) return;
  std::optional<uint32_t>& slab = slabs_[static_cast<std::size_t>(sim)];
  uint64_t& in_hand = ledger.in_hand[static_cast<std::size_t>(sim)];
  for (int step = 0; step < steps; ++step) {
    if (!slab) slab = arena.slabs().acquire(sim);
    if (!slab) return;  // it waits for the learner
    arena.accounts().of(sim).made += 1;
    ledger.made += kAgents;
    in_hand += kAgents;
    if (++arena.slabs().header(static_cast<int>(*slab)).length < kSlabSteps) continue;
    arena.slabs().seal(*slab);
    slab.reset();
    ledger.sealed += std::exchange(in_hand, 0);
  }
}

void SimulatedRun::take() {
  for (const uint32_t slab : effects_.arena().slabs().drain(1)) {
    taken_.push_back(slab);
    referee_.ledger.sealed -= kSlabSteps * kAgents;
    referee_.ledger.taken += kSlabSteps * kAgents;
  }
}

void SimulatedRun::train() {
  Ledger& ledger = referee_.ledger;
  for (const uint32_t slab : std::exchange(taken_, {})) effects_.arena().slabs().release(slab);
  const uint64_t decisions = std::exchange(ledger.taken, 0);
  ledger.trained += decisions;
  ledger.counter += decisions;
  shm::WorkerCounters& counts = counters(setting_.learner());
  counts.decisions += decisions;
  counts.batches += 1;
  effects_.arena().control().learner_env_frames = 4 * ledger.counter;
  body(setting_.learner())->has_worked = true;
}

void SimulatedRun::settle() {
  if (!referee_.is_over() && !failure()) (void)apply({.verb = Verb::kTerminate});
  // Twice the longest way: the stop of a slow learner, and evaluations that are left out half way.
  for (double waited_s = 0; waited_s < 80 && !has_finished_ && !failure(); waited_s += setting_.tick_s) {
    Body* evaluation = body(setting_.evaluation());
    if (evaluation != nullptr && !evaluation->is_hung && referee_.plays_on())
      evaluation->end({}, clock_.now_s());
    if (waited_s > 12 && referee_.plays_on()) (void)apply({.verb = Verb::kTerminate});
    turn(setting_.tick_s);
  }
  referee_.expect(has_finished_, "deadlines", "the run never ends");
}

}  // namespace comrad::simulation
