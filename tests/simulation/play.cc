#include "tests/simulation/play.h"

#include <algorithm>
#include <utility>

#include "rollout_buffer/core/rng.h"

namespace comrad::simulation {
namespace {

struct Chance {
  Verb verb;
  uint32_t weight;
};
// Deaths are as frequent as work, so that limits are reached; ends are rare, so that schedules grow long.
constexpr Chance kChances[] = {
    {Verb::kWait, 80},        {Verb::kJoin, 60},         {Verb::kPlay, 50},
    {Verb::kTake, 25},        {Verb::kTrain, 25},        {Verb::kSave, 8},
    {Verb::kReport, 4},       {Verb::kSnapshot, 6},      {Verb::kAsk, 12},
    {Verb::kAnswer, 10},      {Verb::kEpisode, 20},      {Verb::kJoinAgain, 6},
    {Verb::kDie, 30},         {Verb::kExit, 10},         {Verb::kHang, 4},
    {Verb::kPause, 10},       {Verb::kResume, 12},       {Verb::kCheckpoint, 4},
    {Verb::kRefusedPause, 4}, {Verb::kRefusedResume, 4}, {Verb::kRefusedCheckpoint, 2},
    {Verb::kFinish, 6},       {Verb::kLeave, 1},         {Verb::kUnstartable, 1},
    {Verb::kStop, 2},         {Verb::kInterrupt, 4},     {Verb::kTerminate, 2},
    {Verb::kHangUp, 1},       {Verb::kLetGo, 1},         {Verb::kSlow, 6}};
constexpr uint32_t kWeights = [] {
  uint32_t sum = 0;
  for (const Chance& chance : kChances) sum += chance.weight;
  return sum;
}();
constexpr double kWaits[] = {0.05, 0.05, 0.3, 0.3, 1, 1, 2.5, 7, 12, 40, 130};
constexpr double kSlowS[] = {3, 9, 12, 25};
constexpr int kCodes[] = {0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 2, 3};

template <typename Values>
auto one_of(const Values& values, Rng& rng) {
  return values[rng.below(static_cast<uint32_t>(std::size(values)))];
}

Setting draw_setting(Rng& rng) {
  Setting setting;
  setting.kind =
      one_of(std::to_array({RunKind::kTrain, RunKind::kTrain, RunKind::kLockStep, RunKind::kEvaluate}), rng);
  setting.sims = 1 + static_cast<int>(rng.below(3));
  setting.policies = 1 + static_cast<int>(rng.below(2));
  setting.hosts = rng.below(3) == 0 ? 1 + static_cast<int>(rng.below(2)) : 0;
  setting.are_needed = setting.hosts > 0 && rng.below(3) == 0;
  setting.evaluates = setting.trains() && rng.below(3) == 0;
  setting.tick_s = one_of(std::to_array({0.05, 0.1, 0.25}), rng);
  setting.leave_s = one_of(std::to_array({0.1, 0.5, 2.0, 6.0, 20.0}), rng);
  return setting;
}

/// What is frequent in one schedule.
struct Bent {
  int weak_place = -1;    ///< most of what befalls a process befalls this one; -1: all alike
  bool endures = false;   ///< what would end the run is rare
  double shortest_s = 0;  ///< of its waits
};

Bent draw_bent(const Setting& setting, Rng& rng) {
  return {.weak_place = rng.below(2) == 0
                            ? static_cast<int>(rng.below(static_cast<uint32_t>(setting.place_count())))
                            : -1,
          .endures = rng.below(4) != 0,
          .shortest_s = rng.below(4) == 0 ? 7.0 : 0.0};
}

Verb draw_verb(const Bent& bent, Rng& rng) {
  uint32_t drawn = rng.below(kWeights);
  const Chance* chance = kChances;
  for (; drawn >= chance->weight; ++chance) drawn -= chance->weight;
  const bool is_end = chance->verb >= Verb::kStop || chance->verb == Verb::kFinish ||
                      chance->verb == Verb::kLeave || chance->verb == Verb::kUnstartable;
  return is_end && bent.endures && rng.below(8) != 0 ? Verb::kWait : chance->verb;
}

Step draw_step(const Setting& setting, const Bent& bent, Rng& rng) {
  Step step;
  step.verb = draw_verb(bent, rng);
  if (has_place(step.verb)) {
    switch (step.verb) {
      case Verb::kPlay:
      case Verb::kAsk:
      case Verb::kEpisode:
        step.place = static_cast<int>(rng.below(static_cast<uint32_t>(setting.sims)));
        break;
      case Verb::kAnswer:
        step.place = setting.policy(static_cast<int>(rng.below(static_cast<uint32_t>(setting.policies))));
        break;
      case Verb::kTake:
      case Verb::kTrain:
      case Verb::kReport:
      case Verb::kSave:
      case Verb::kSnapshot:
      case Verb::kFinish:
      case Verb::kLeave:
        step.place = std::max(0, setting.learner());
        break;
      default:
        step.place = bent.weak_place >= 0 && rng.below(3) != 0
                         ? bent.weak_place
                         : static_cast<int>(rng.below(static_cast<uint32_t>(setting.place_count())));
    }
  }
  if (step.verb == Verb::kWait) step.number = std::max(bent.shortest_s, one_of(kWaits, rng));
  if (step.verb == Verb::kPlay) step.number = 1 + rng.below(12);
  if (step.verb == Verb::kSlow) step.number = one_of(kSlowS, rng);
  if (step.verb == Verb::kExit) step.number = one_of(kCodes, rng);
  if (step.verb == Verb::kDie) step.number = rng.below(2) == 0 ? 9 : 11;
  if (step.verb == Verb::kEpisode) step.number = rng.below(kEpisodes + 2);
  return step;
}

/// Plays what may come of the steps, and leaves out the rest.
Played play_possible(const Setting& setting, const std::vector<Step>& steps, Fault fault) {
  SimulatedRun run(setting, fault);
  Played played{.schedule = {.setting = setting, .steps = {}}, .failure = {}, .ending = {}};
  for (const Step& step : steps) {
    if (run.has_ended() || run.failure()) break;
    if (run.apply(step)) played.schedule.steps.push_back(step);
  }
  run.settle();
  played.failure = run.failure();
  return played;
}

}  // namespace

Played play_seed(uint64_t seed, Fault fault) {
  Rng rng(seed);
  const Setting setting = draw_setting(rng);
  SimulatedRun run(setting, fault);
  Played played{.schedule = {.setting = setting, .steps = {}}, .failure = {}, .ending = {}};
  const auto take = [&](const Step& step) {
    if (run.why_not(step) != nullptr || !run.apply(step)) return false;
    played.schedule.steps.push_back(step);
    return true;
  };
  const bool begins_well = rng.below(8) != 0;
  for (int place = 0; begins_well && place < setting.worker_count(); ++place)
    take({.verb = Verb::kJoin, .place = place});
  if (begins_well) take({.verb = Verb::kWait, .number = 0.1});
  const Bent bent = draw_bent(setting, rng);
  const uint32_t length = 5 + rng.below(100);
  for (uint32_t step = 0; step < length && !run.has_ended() && !run.failure(); ++step)
    for (int tries = 0; tries < 8 && !take(draw_step(setting, bent, rng)); ++tries) {
    }
  run.settle();
  played.failure = run.failure();
  played.ending = run.ending();
  return played;
}

Expected<Played> play(const Schedule& schedule, Fault fault) {
  SimulatedRun run(schedule.setting, fault);
  Played played{.schedule = schedule, .failure = {}, .ending = {}};
  for (std::size_t step = 0; step < schedule.steps.size() && !run.failure(); ++step)
    if (const Status taken = run.apply(schedule.steps[step]); !taken)
      return Error{taken.error().code, "step " + std::to_string(step + 1) + ", " + taken.error().message};
  run.settle();
  played.failure = run.failure();
  played.ending = run.ending();
  return played;
}

Played shrink(const Played& broken, Fault fault) {
  Played best = broken;
  for (std::size_t chunk = std::max<std::size_t>(1, best.schedule.steps.size() / 2); chunk > 0;) {
    bool is_shorter = false;
    for (std::size_t begin = 0; begin < best.schedule.steps.size();) {
      std::vector<Step> steps = best.schedule.steps;
      const auto first = steps.begin() + static_cast<std::ptrdiff_t>(begin);
      steps.erase(first, first + static_cast<std::ptrdiff_t>(std::min(chunk, steps.size() - begin)));
      Played tried = play_possible(best.schedule.setting, steps, fault);
      if (tried.failure && tried.failure->rule == broken.failure->rule) {
        best = std::move(tried);
        is_shorter = true;
      } else {
        begin += chunk;
      }
    }
    if (!is_shorter || chunk > best.schedule.steps.size()) chunk /= 2;
  }
  return best;
}

std::string report_of(const Played& played) {
  return (played.failure ? played.failure->rule + ": " + played.failure->what + "\n"
                         : "no rule is broken\n") +
         text_of(played.schedule);
}

}  // namespace comrad::simulation
