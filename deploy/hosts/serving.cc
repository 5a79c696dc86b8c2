#include "deploy/hosts/serving.h"

#include <spdlog/fmt/fmt.h>

#include "deploy/hosts/host_calls.h"
#include "deploy/hosts/run_offer.h"
#include "rollout_buffer/dds/bus_config.h"
#include "rollout_buffer/link/join/link_address.h"

namespace comrad::deploy {

Status prepare_serving(RunConfig& config, const std::string& key_folder) {
  if (!config.hosts.hosts.empty() && config.hosts.hosts != "none") config.hosts.serve = true;
  if (config.hosts.link == LinkKind::kDds) {
    if ((config.hosts.interface != "auto" && !dds::is_loopback(config.hosts.interface)) ||
        !key_folder.empty())
      return Error{
          ErrorCode::kBadInput,
          "link is dds, which plays with simulators of this host over loopback, so the run's link cannot "
          "be on a network; leave --link away, or --interface and --keys"};
    config.hosts.serve = true;
    config.hosts.interface = link::kLoopback;
  }
  COMRAD_TRY(prepare_calls(config, environment_variable));
  if (!config.hosts.serve && !config.hosts.publish) return {};
  if (config.hosts.interface == "auto") config.hosts.interface = link::kLoopback;
  if (config.hosts.serve) COMRAD_TRY(check_can_be_offered(config));
  // The id is drawn later; all that a user may have set is in these already.
  return dds::validate(link::serving_config(1, config.hosts, key_folder));
}

Expected<std::string> open_join_endpoint(const std::string& run_dir, const RunConfig& config,
                                         const std::string& iwad) {
  link::LinkAddress address;
  COMRAD_TRY_ASSIGN(address.link_id, link::keep_link_id(run_dir));
  COMRAD_TRY_ASSIGN(address.host, link::address_of_interface(config.hosts.interface));
  address.port_base = static_cast<uint32_t>(config.hosts.port_base);
  COMRAD_TRY(link::keep_address(run_dir, address));
  if (config.hosts.serve) COMRAD_TRY(make_offer(run_dir, config, iwad));
  return link::text_of(address);
}

HostStart own_simulators(const RunConfig& config, const std::string& run_dir, const std::string& program) {
  return {.name = "this host's simulators",
          .command = {program, "join", "-", "--leave_with_input", "--link=dds",
                      fmt::format("--num_workers={}", config.collection.num_workers),
                      "--set_workers_cpu_affinity=" +
                          std::string(config.collection.set_workers_cpu_affinity ? "True" : "False"),
                      fmt::format("--link_buffer_mb={}", config.hosts.link_buffer_mb),
                      "--train_dir=" + run_dir, "--experiment=simulators", "--progress_interval=600"},
          .is_needed = true};
}

std::string join_note(const std::string& address, const RunConfig& config) {
  const std::string rest =
      address + (config.hosts.insecure_network ? " --insecure_network" : "") +
      (dds::is_loopback(config.hosts.interface) ? " (from this host: the link is on loopback)" : "");
  std::string note;
  if (config.hosts.serve) note = "other hosts join with: comrad join " + rest;
  if (config.hosts.publish)
    note += (note.empty() ? "" : "\n") + ("monitors look with: comrad top --remote " + rest);
  return note;
}

}  // namespace comrad::deploy
