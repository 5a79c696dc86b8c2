// A run without processes, sockets and disk: the supervisor's own decisions (deploy/launch/supervision.h) on a clock that is
// moved by hand, over an arena in memory, with workers that follow a schedule.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "deploy/launch/evaluation_folder.h"
#include "deploy/launch/run_effects.h"
#include "deploy/launch/supervision.h"
#include "rollout_buffer/core/clock.h"
#include "tests/simulation/referee.h"
#include "tests/simulation/schedule.h"
#include "tests/simulation/simulated_host.h"

namespace comrad::simulation {

/// Something that is done wrong on purpose, so that tests see the rules catch it.
enum class Fault {
  kNone,
  kForgetsTheDead,        ///< what a dead worker held is not taken back
  kRestartsWithoutBound,  ///< a worker that keeps dying is never given up
  kHurries,               ///< a dead worker starts again at once
  kSparesTheStubborn,     ///< SIGKILL does nothing
  kTellsNobodyOfTheStop,  ///< workers do not hear that the run stops
  kSeesNobodyAtWork,      ///< a learner that still saves looks like one that hangs
};

/// The arena and what workers are sent.
class SimulatedEffects final : public deploy::RunEffects {
 public:
  SimulatedEffects(const deploy::LaunchPlan& plan, Ledger& ledger, Fault fault)
      : plan_(plan), ledger_(ledger), fault_(fault) {}
  Status open() override;
  bool is_open() const override { return arena_.has_value(); }
  const shm::Arena& arena() const override { return *arena_; }
  const std::string& socket_name() const override { return name_; }
  void set_run_state(shm::RunState state) override;
  std::optional<uint64_t> reclaim(const deploy::Worker& worker) override;
  void note(const std::string&) override {}
  uint64_t memory_kills() override { return 0; }

  int openings() const { return openings_; }

 private:
  const deploy::LaunchPlan& plan_;
  Ledger& ledger_;
  const Fault fault_;
  std::optional<shm::Arena> arena_;
  int openings_ = 0;
  const std::string name_ = "simulated";
};

/// Checkpoints that wait to be evaluated, in memory.
class SimulatedFolder final : public deploy::EvaluationFolder {
 public:
  std::vector<deploy::Snapshot> snapshots() override { return waiting_; }
  void remove(const deploy::Snapshot& snapshot) override;
  std::vector<uint64_t> recorded() override { return {}; }
  Status record(const deploy::Snapshot& snapshot, uint64_t decisions, const MetricValues& values) override;
  std::vector<uint64_t> recorded_videos() override { return {}; }
  Expected<std::string> keep_video(const deploy::Snapshot&) override { return std::string("video"); }
  Expected<Descriptor> open_scratch() override { return Descriptor(); }
  std::string scratch() const override { return "scratch"; }
  std::string result() override;
  void clear_scratch() override {}

  void save(uint64_t env_frames);
  int waiting() const { return static_cast<int>(waiting_.size()); }
  bool has_repeated() const { return has_repeated_; }

 private:
  std::vector<deploy::Snapshot> waiting_;
  std::vector<uint64_t> recorded_;
  bool has_repeated_ = false;
};

class SimulatedRun {
 public:
  explicit SimulatedRun(const Setting& setting, Fault fault = Fault::kNone);

  /// Errors: kBadInput where the step cannot come now: "'join sim-0': it has joined already".
  Status apply(const Step& step);
  /// Why apply() would refuse; null: it would not.
  const char* why_not(const Step& step) const;
  /// Stops the run, if nothing else did, and waits for its end.
  void settle();
  bool has_ended() const { return has_finished_; }
  const std::optional<Failure>& failure() const { return referee_.failure(); }
  const deploy::RunEnding& ending() const { return ending_; }
  const Referee& referee() const { return referee_; }

 private:
  const char* why_no_work(const Step& step) const;
  void wait(double seconds);
  void turn(double seconds);
  void let_bodies_act();
  void leave(Body& body);
  void join(int place);
  void play(int sim, int steps);
  void take();
  void train();
  shm::WorkerCounters& counters(int place) const;
  bool is_run_state(shm::RunState state) const;
  Body* body(int place) const { return host_.living(place); }

  const Setting setting_;
  ManualClock clock_;
  mutable SimulatedHost host_;
  deploy::LaunchPlan plan_;
  Referee referee_;
  SimulatedEffects effects_;
  SimulatedFolder folder_;
  std::vector<std::optional<uint32_t>> slabs_;  // in the simulators' hands
  std::vector<uint32_t> taken_;                 // in the learner's
  int openings_ = 0;
  uint64_t snapshots_ = 0;
  double over_s_ = 0;  // when workers heard of the stop; 0: they did not
  deploy::RunEnding ending_;
  bool has_finished_ = false;
  deploy::Supervision supervision_;
};

}  // namespace comrad::simulation
