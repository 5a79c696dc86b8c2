// How other hosts are made to join a run: through ssh where --hosts names them, through srun inside a Slurm allocation of
// several tasks. Stage: before a run.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "deploy/launch/launch_plan.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::deploy {

/// A variable of the environment; empty where it is not set. std::getenv outside of tests.
using Variable = std::function<std::string(const char* name)>;
std::string environment_variable(const char* name);

/// Whether this program was started by hand or by a job's script in an allocation of more tasks than one. A program that
/// srun started is one of those tasks and contacts no host.
bool is_alone_in_an_allocation(const Variable& variable);

/// Completes the settings where other hosts are to be called: the run serves, on the interface that leads to them.
/// Errors: kBadInput, kNotFound for a host whose name is not known.
Status prepare_calls(RunConfig& config, const Variable& variable);

/// `comrad <words>` on each of the hosts "a,b,c": the program of this one's path, as on a common file system, else the one
/// that is installed there.
std::vector<HostStart> ssh_calls(const std::string& hosts, const std::vector<std::string>& words,
                                 const std::string& own_program);

/// The programs that make other hosts join; none without hosts to contact. `own_program` is this program's path.
std::vector<HostStart> host_calls(const RunConfig& config, const Variable& variable,
                                  const std::string& own_program);

}  // namespace comrad::deploy
