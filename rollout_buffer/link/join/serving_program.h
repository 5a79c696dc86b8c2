// What the two programs at the ends of the links on the learner's host have in common. Stage: beside the flow.
#pragma once

#include <utility>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/link/join/endpoint.h"
#include "rollout_buffer/link/join/link_address.h"
#include "rollout_buffer/link/join/link_files.h"
#include "rollout_buffer/link/session/serving_end.h"
#include "rollout_buffer/shm/worker_shell.h"

namespace comrad::link {

/// Runs one end of the link as the run's settings and folder have it, until the program is to stop. Once a second it
/// writes each host's state, and requests hosts to leave that are to.
///   options_of(arena, offer, address)   the options of the End, which logs what it serves
/// Errors: those of LinkBus::open(), of what lies in the run's folder and of joining the arena.
template <typename End, typename OptionsOf>
Status serve(const shm::WorkerShell& shell, const RunConfig& config, const ServingFiles& files,
             OptionsOf options_of) {
  COMRAD_TRY_ASSIGN(const LinkAddress address, kept_address(shell.run_dir()));
  COMRAD_TRY_ASSIGN(const Offer offer, read_offer(shell.run_dir()));
  COMRAD_TRY_ASSIGN(const shm::Arena arena, shell.join());
  COMRAD_TRY_ASSIGN(dds::LinkBus bus, dds::LinkBus::open(serving_config(address.link_id, config.hosts,
                                                                        kept_keys(shell.run_dir()))));
  End end(arena, std::move(bus), options_of(arena, offer, address));
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
