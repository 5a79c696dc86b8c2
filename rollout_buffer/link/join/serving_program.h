// What the two programs at the ends of the links on the learner's host have in common. Stage: beside the flow.
#pragma once

#include <utility>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/link/join/link_address.h"
#include "rollout_buffer/link/join/link_files.h"
#include "rollout_buffer/link/session/serving_end.h"
#include "rollout_buffer/shm/worker_shell.h"

namespace comrad::link {

/// The link as the run's settings and folder have it. Errors: those of LinkBus::open().
inline Expected<dds::LinkBus> open_serving_bus(const shm::WorkerShell& shell, const RunConfig& config,
                                               const LinkAddress& address) {
  return dds::LinkBus::open(
      serving_config(address.link_id, link_options(config.hosts, kLoopback, kept_keys(shell.run_dir()))));
}

/// Runs one end until the program is to stop. Once a second it writes each host's state, and requests
/// hosts to leave that are to.
inline Status serve(const shm::WorkerShell& shell, ServingEnd& end, const ServingFiles& files) {
  end.remember(read_peers(shell.run_dir(), files));
  bool has_warned = false;
  end.every_second([&] {
    for (const std::string& host : take_hosts_to_leave(shell.run_dir(), files)) end.ask_to_leave(host);
    const Status written = write_peers(shell.run_dir(), files, end.records());
    if (!written && !std::exchange(has_warned, true)) spdlog::warn("{}", written.error().message);
  });
  return end.run(shell.stop());
}

}  // namespace comrad::link
