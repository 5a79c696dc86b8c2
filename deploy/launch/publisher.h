// Reports a run with --publish to monitors on other hosts (`comrad top --remote`): its workers, the learner's report, its
// episodes. Stage: beside the flow.
#pragma once

#include <set>
#include <string>
#include <utility>

#include "deploy/launch/launch_plan.h"
#include "deploy/launch/run_snapshot.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/link_bus.h"
#include "rollout_buffer/schema/episode_record.h"
#include "rollout_buffer/schema/train_stats.h"

namespace comrad::deploy {

/// Threads: the supervisor's. No write waits longer than 100 ms for a monitor.
class Publisher {
 public:
  /// The run's folder has the link's id and keys. Errors: those of LinkBus::open() and of a
  /// first write.
  static Expected<Publisher> open(const LaunchPlan& plan);

  /// Errors: those of LinkBus::write().
  Status publish(const RunSnapshot& run, const TrainStats& stats);
  Status publish(const EpisodeRecord& record);
  /// The run itself; after the end of the run for the last time.
  Status publish_state(const std::string& state, const std::string& message);

 private:
  Publisher(std::string scenario, dds::LinkBus bus) : scenario_(std::move(scenario)), bus_(std::move(bus)) {}

  std::string scenario_;
  dds::LinkBus bus_;
  std::set<std::string> hosts_;  ///< that were reported to play for the run
};

}  // namespace comrad::deploy
