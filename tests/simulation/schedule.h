// What happens to a run in a simulation, step by step: what each worker, host and user does, and how much time passes. A
// schedule is drawn from a seed or written as text, one step a line.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::simulation {

enum class RunKind { kTrain, kLockStep, kEvaluate };

/// What is started. As text: "run train sims=2 policies=1 hosts=1 needed=0 evaluations=1 tick=0.1 leave=0.5".
struct Setting {
  RunKind kind = RunKind::kTrain;
  int sims = 2;
  int policies = 1;
  int hosts = 0;            ///< that the run calls
  bool are_needed = false;  ///< without them the run fails
  bool evaluates = false;   ///< checkpoints beside the training
  double tick_s = 0.1;      ///< between two turns of the supervisor
  double leave_s = 0.5;     ///< from the stop until a worker leaves by itself

  bool trains() const { return kind != RunKind::kEvaluate; }
  int worker_count() const { return sims + policies + (trains() ? 1 : 0); }
  // Places of processes: simulators, policy workers, learner, hosts, the evaluation that is played.
  int policy(int index) const { return sims + index; }
  int policy_of(int sim) const { return sims + sim % policies; }
  int learner() const { return trains() ? sims + policies : -1; }
  int host(int index) const { return worker_count() + index; }
  int evaluation() const { return worker_count() + hosts; }
  int place_count() const { return worker_count() + hosts + 1; }
  bool is_sim(int place) const { return place >= 0 && place < sims; }
  bool is_policy(int place) const { return place >= sims && place < sims + policies; }
  bool is_learner(int place) const { return place >= 0 && place == learner(); }
  bool is_worker(int place) const { return place >= 0 && place < worker_count(); }
  bool is_host(int place) const { return place >= worker_count() && place < evaluation(); }
  /// "sim-0", "policy-0", "learner", "host-0", "evaluation".
  std::string name(int place) const;
};

enum class Verb {
  kWait,         ///< seconds pass
  kJoin,         ///< a started worker joins the run
  kJoinAgain,    ///< its request comes a second time, perhaps after its end
  kPlay,         ///< a simulator takes so many steps
  kAsk,          ///< a simulator waits for its policy worker, which has begun to answer
  kAnswer,       ///< a policy worker answers all that it has begun
  kTake,         ///< the learner takes a sealed slab
  kTrain,        ///< the learner trains on all that it has taken
  kReport,       ///< the learner reports
  kSave,         ///< the learner saves a checkpoint
  kSnapshot,     ///< the learner saves a checkpoint to be evaluated
  kFinish,       ///< the learner has reached the goal, saves and leaves
  kLeave,        ///< the learner saves and leaves before the goal
  kEpisode,      ///< a simulator of an evaluation ends the episode of this number
  kExit,         ///< a process ends with this code
  kDie,          ///< a process is killed by this signal
  kHang,         ///< a process does nothing from now on, whatever is requested
  kSlow,         ///< a process takes so many seconds to leave after the stop, whatever is requested
  kUnstartable,  ///< a worker's program cannot be started from now on
  kPause,        ///< comrad ctl pause, which the run grants
  kResume,
  kCheckpoint,
  kRefusedPause,  ///< comrad ctl pause, which the run must refuse
  kRefusedResume,
  kRefusedCheckpoint,
  kStop,       ///< comrad ctl stop
  kInterrupt,  ///< SIGINT
  kTerminate,  ///< SIGTERM
  kHangUp,     ///< SIGHUP
  kLetGo,      ///< the end of the standard input
};
constexpr int kVerbs = 30;

struct Step {
  Verb verb = Verb::kWait;
  int place = -1;
  double number = 0;
};

struct Schedule {
  Setting setting;
  std::vector<Step> steps;
};

/// "play sim-0 5".
std::string text_of(const Step& step, const Setting& setting);
std::string text_of(const Schedule& schedule);
/// Reads text_of(); empty lines and what follows a # are left out. Errors: kBadFormat, naming line and word.
Expected<Schedule> parse_schedule(std::string_view text);

/// What a step needs behind its verb.
bool has_place(Verb verb);
bool has_number(Verb verb);

}  // namespace comrad::simulation
