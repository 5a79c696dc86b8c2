// Processes that do not exist: a ProcessHost whose programs do nothing but what the simulation makes them do.
#pragma once

#include <signal.h>

#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "deploy/process/process_host.h"
#include "rollout_buffer/core/clock.h"
#include "tests/simulation/schedule.h"

namespace comrad::simulation {

using deploy::ExitStatus;

/// One life of a process.
struct Body {
  int place = 0;
  double started_s = 0;
  bool has_joined = false;
  bool is_hung = false;
  double slow_s = 0;               ///< how long it works on after the stop; 0: as the others do
  bool is_stopped = false;         ///< by SIGSTOP
  std::vector<std::string> lines;  ///< printed and not read yet
  bool has_worked = false;
  std::optional<ExitStatus> exit;  ///< it has ended
  double ended_s = 0;
  double term_s = 0, kill_s = 0;  ///< when it got the signal first; 0: never
  double input_ended_s = 0;       ///< 0: not yet
  bool ignores_kill = false;      ///< a fault that the checks must see

  bool is_alive() const { return !exit; }
  void end(ExitStatus how, double now_s) {
    if (exit) return;
    exit = how;
    ended_s = now_s;
  }
};

/// An end that the supervisor has taken notice of.
struct Exit {
  int place = 0;
  ExitStatus how;
  std::shared_ptr<const Body> body;
};

class SimulatedHost final : public deploy::ProcessHost {
 public:
  SimulatedHost(const Setting& setting, const ManualClock& clock)
      : setting_(setting), clock_(clock), bodies_(static_cast<std::size_t>(setting.place_count())) {}

  Expected<std::unique_ptr<deploy::Process>> spawn(const deploy::ChildOptions& options) override;

  /// The last life at a place; null before the first.
  Body* body(int place) { return bodies_[static_cast<std::size_t>(place)].get(); }
  Body* living(int place) {
    Body* one = body(place);
    return one != nullptr && one->is_alive() ? one : nullptr;
  }
  bool any_alive() const;
  /// From now on its program cannot be started.
  void make_unstartable(int place) { unstartable_.insert(place); }
  bool is_unstartable(int place) const { return unstartable_.contains(place); }
  void ignore_kills() { ignores_kill_ = true; }
  void show_nobody_at_work() { shows_work_ = false; }

  /// What the supervisor did since forget_news(), in its order.
  const std::vector<Exit>& exits() const { return exits_; }
  const std::vector<int>& starts() const { return starts_; }      ///< places
  const std::vector<int>& doubles() const { return doubles_; }    ///< places that were taken
  const std::vector<int>& failures() const { return failures_; }  ///< places whose program did not start
  void forget_news();

 private:
  friend class Puppet;
  int place_of(const deploy::ChildOptions& options) const;

  const Setting& setting_;
  const ManualClock& clock_;
  std::vector<std::shared_ptr<Body>> bodies_;
  std::set<int> unstartable_;
  std::vector<Exit> exits_;
  std::vector<int> starts_, doubles_, failures_;
  bool ignores_kill_ = false, shows_work_ = true;
  pid_t next_pid_ = 1000;
};

}  // namespace comrad::simulation
