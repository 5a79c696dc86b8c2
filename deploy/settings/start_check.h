// What `comrad train` refuses before it writes anything; `comrad config` and `comrad sweep` refuse the same.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "deploy/settings/network_description.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/replay/replay_plan.h"
#include "rollout_buffer/schema/network_size.h"
#include "rollout_buffer/schema/spec.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::deploy {

/// Queries a network's size; describe_network outside of tests.
using DescribeNetwork = std::function<Expected<NetworkSize>(const RunConfig&, const EnvShape&)>;

/// What a start with some settings would work with on this machine.
struct StartCheck {
  NetworkSize network;
  std::optional<replay::ReplayPlan> replay;  ///< nothing for algorithms without one
};

/// Looks at the files that resolved settings name, makes their network once, and chooses the replay. `run_dir` need not
/// exist. Errors: kNotFound and kBadFormat of files, kBadInput of a pool or a network that cannot be made (an unknown
/// encoder), kNoSpace of a replay; those of `describe_network`.
Expected<StartCheck> check_start(const RunConfig& config, const EnvShape& env, const std::string& run_dir,
                                 const DescribeNetwork& describe_network = deploy::describe_network);

/// The replay that a run with these resolved settings would get on this machine now; nothing for algorithms without one.
/// `run_dir` need not exist. Errors: kNoSpace.
Expected<std::optional<replay::ReplayPlan>> chosen_replay(const RunConfig& config, const EnvShape& env,
                                                          const NetworkSize& network,
                                                          const std::string& run_dir);

/// Errors: kBadInput where a new run would end before learning begins, with both numbers.
Status check_learning_begins(const RunConfig& config, const std::optional<replay::ReplayPlan>& replay);

}  // namespace comrad::deploy
