// `comrad join ADDRESS`: connects to another host's run, fetches its maps and settings, and plays for its
// learner with an arena, simulators and policy workers of this host.

#include <spdlog/fmt/fmt.h>
#include <sys/random.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <string_view>

#include "deploy/hosts/run_offer.h"
#include "deploy/launch/progress.h"
#include "deploy/launch/run_directory.h"
#include "deploy/launch/supervisor.h"
#include "deploy/run/command.h"
#include "deploy/settings/command_line.h"
#include "deploy/settings/game_files.h"
#include "deploy/settings/network_description.h"
#include "deploy/settings/scenario_description.h"
#include "rollout_buffer/core/cores.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/host_name.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/link/join/link_address.h"
#include "rollout_buffer/link/join/link_files.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/resolve.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;

/// Settings that a host which joins chooses for itself; all others are the run's.
constexpr std::array<std::string_view, 19> kOwnSettings = {"train_dir",
                                                           "experiment",
                                                           "num_workers",
                                                           "policy_workers",
                                                           "policy_threads",
                                                           "min_batch",
                                                           "max_batch",
                                                           "max_wait_us",
                                                           "trajectory_slabs",
                                                           "set_workers_cpu_affinity",
                                                           "device",
                                                           "policy_device",
                                                           "interface",
                                                           "peers",
                                                           "link_buffer_mb",
                                                           "link_datagram_bytes",
                                                           "insecure_network",
                                                           "progress_interval",
                                                           "link"};
constexpr int64_t kSlabsUnderWay = 8;  // sealed here or on their way; the learner's host takes 4 at once

struct JoinRequest {
  std::string address;
  double wait_s = 30;
  double patience_s = 300;
  bool leaves_with_input = false;
  std::string key_folder;
};

/// "%h" in a folder of keys is this host's name: so that many hosts can be started with the same words.
std::string key_folder_here(std::string folder) {
  for (std::size_t at; (at = folder.find("%h")) != std::string::npos;)
    folder.replace(at, 2, short_host_name());
  return folder;
}

std::string joined_name(const std::string& scenario) {
  const std::time_t now = std::time(nullptr);
  std::tm local{};
  localtime_r(&now, &local);
  char date[32];
  std::strftime(date, sizeof date, "%Y%m%d_%H%M%S", &local);
  return "joined_" + scenario + "_" + short_host_name() + "_" + date;
}

/// Another host's environments are none of the learner's host's: episodes are drawn from their own seed.
Expected<int64_t> own_seed() {
  uint64_t bits = 0;
  if (getrandom(&bits, sizeof bits, 0) != sizeof bits) return system_error("getrandom");
  return static_cast<int64_t>(bits >> 12);
}

Expected<RunDirectory> folder_for(const RunConfig& own, const link::Offer& offer) {
  std::error_code ignored;
  const std::string train_dir = fs::absolute(own.run.train_dir, ignored).lexically_normal().string();
  if (own.run.experiment.empty()) return RunDirectory::open_new(train_dir, joined_name(offer.scenario));
  COMRAD_TRY_ASSIGN(RunDirectory directory,
                    RunDirectory::open(train_dir, own.run.experiment, RestartBehavior::kResume));
  if (directory.is_resumed() && !fs::exists(directory.path() + "/" + link::kAddressFile, ignored))
    return Error{ErrorCode::kBadInput, directory.path() +
                                           " is a run of this host, not one that joined; choose "
                                           "another --experiment"};
  return directory;
}

/// Requests the run's offer, compares, and fetches everything into a folder of this host.
Expected<RunDirectory> enter(const JoinRequest& request, const RunConfig& own,
                             const link::LinkAddress& address, const std::string& interface,
                             const std::string& iwad) {
  uint64_t visitor = 0;
  if (getrandom(&visitor, sizeof visitor, 0) != sizeof visitor) return system_error("getrandom");
  COMRAD_TRY_ASSIGN(dds::LinkBus bus, dds::LinkBus::open(link::joining_config(address, own.hosts, interface,
                                                                              request.key_folder)));
  link::JoinClient client(bus, visitor, request.wait_s);
  Expected<link::Offer> offer = client.offer();
  if (!offer && offer.error().code == ErrorCode::kTimeout)
    return Error{ErrorCode::kTimeout,
                 fmt::format("{} at {}: is the run serving (`comrad serve RUN` on its host reports so), on "
                             "the interface that leads here, and are UDP ports from {} on open in both "
                             "directions? `comrad doctor --hosts` on that host measures the connection",
                             offer.error().message, address.host,
                             dds::ports_of(link::joining_config(address, own.hosts, interface)).first)};
  if (!offer) return Error{offer.error().code, "the run does not open: " + offer.error().message};
  COMRAD_TRY(compare_with(*offer, iwad));
  COMRAD_TRY_ASSIGN(RunDirectory directory, folder_for(own, *offer));
  for (const link::OfferedFile& file : offer->files) {
    COMRAD_TRY_ASSIGN(const std::string bytes, client.file(file));
    const fs::path path = fs::path(directory.path()) / file.name;
    std::error_code failed;
    fs::create_directories(path.parent_path(), failed);
    COMRAD_TRY(write_file_atomically(path.string(), bytes, /*durable=*/false));
  }
  COMRAD_TRY(link::write_offer(directory.path(), *offer));
  COMRAD_TRY(link::keep_address(directory.path(), address));
  if (!request.key_folder.empty())
    COMRAD_TRY(
        link::keep_keys(directory.path(), fs::absolute(request.key_folder).lexically_normal().string()));
  return directory;
}

/// Whether simulators of this host play with the policy workers of the learner's. `note` states why.
Expected<bool> sends_frames(const RunConfig& own, const link::Offer& offer, std::string& note) {
  const bool has_room = offer.frame_workers > 0;
  switch (own.hosts.link) {
    case LinkKind::kShm:
      return false;
    case LinkKind::kDds:
      if (!has_room)
        return Error{
            ErrorCode::kBadInput,
            "the run has no room for simulators without a policy: start it with --serve_frame_workers, or "
            "join it with --link shm"};
      return true;
    case LinkKind::kAuto:
      break;
  }
  if (!offer.has_cuda || computes_on_cuda(own)) {
    note = std::string("link: shm, because ") +
           (offer.has_cuda ? "this host computes on CUDA too" : "the learner's host computes on its CPU too");
    return false;
  }
  note = has_room ? "link: dds, because the learner's host computes on CUDA and this one does not; --link "
                    "shm plays with "
                    "policy workers of this host"
                  : "link: shm, because the run has no room for simulators without a policy; with "
                    "--serve_frame_workers "
                    "they would play with the learner's host, which computes on CUDA";
  return has_room;
}

Expected<int> join(const CommandLine& line, const JoinRequest& request) {
  for (const auto& [name, text] : line.typed().values)
    if (std::ranges::find(kOwnSettings, name) == kOwnSettings.end())
      return Error{
          ErrorCode::kBadInput,
          "--" + name + " is the run's to choose, where it is trained; here count " + joined(kOwnSettings)};
  RunConfig own;
  COMRAD_TRY(apply_layer(own, line.typed()));
  own.environment.num_agents = 1;  // the run's, which is not known yet
  COMRAD_TRY(check_limits(own));
  COMRAD_TRY_ASSIGN(const link::LinkAddress address, link::read_address(request.address));
  COMRAD_TRY_ASSIGN(const std::string interface, link::interface_towards(address.host));
  COMRAD_TRY_ASSIGN(const std::string iwad, find_iwad());
  COMRAD_TRY_ASSIGN(const RunDirectory directory, enter(request, own, address, interface, iwad));

  COMRAD_TRY_ASSIGN(RunConfig config, joined_settings(directory.path()));
  COMRAD_TRY(apply_layer(config, line.typed()));
  config.run.train_dir = fs::path(directory.path()).parent_path().string();
  config.run.experiment = fs::path(directory.path()).filename().string();
  COMRAD_TRY_ASSIGN(config.run.seed, own_seed());
  const bool has_slabs = config.collection.trajectory_slabs > 0;
  COMRAD_TRY(resolve_settings(config, usable_cores()));
  // What waits here grows old; a batch is made where the learner is.
  if (!has_slabs)
    config.collection.trajectory_slabs =
        config.collection.num_workers * config.collection.num_envs_per_worker + kSlabsUnderWay;
  COMRAD_TRY(check_wad(iwad));
  COMRAD_TRY_ASSIGN(ScenarioDescription scenario, describe_scenario(config));
  if (!sees_global_state(config)) scenario.env.global_state_count = 0;  // as where it is trained
  COMRAD_TRY_ASSIGN(const NetworkSize network, describe_network(config, scenario.env));
  COMRAD_TRY(directory.write_config(config));
  std::fprintf(stderr, "Plays %s for the run at %s, in %s\n", config.run.scenario.c_str(),
               address.host.c_str(), directory.path().c_str());

  LaunchPlan plan;
  plan.config = config;
  plan.env = scenario.env;
  plan.network = network;
  plan.decision_limit = scenario.decision_limit;
  plan.run_dir = directory.path();
  plan.policy = PolicySource::kFeeding;
  plan.patience_s = request.patience_s;
  COMRAD_TRY_ASSIGN(const link::Offer offer, link::read_offer(directory.path()));
  std::string note;
  COMRAD_TRY_ASSIGN(plan.sends_frames, sends_frames(config, offer, note));
  if (!note.empty()) plan.notes.push_back(note);
  plan.leaves_with_input = request.leaves_with_input;
  plan.lock_descriptor = directory.lock_descriptor();
  COMRAD_TRY_ASSIGN(const RunOutcome outcome, deploy::run(plan));
  if (!outcome.message.empty()) ProgressPrinter(STDERR_FILENO, /*show=*/true).note(outcome.message);
  return outcome.exit_code;
}

}  // namespace

int join_command(Arguments arguments) {
  CommandLine line(
      "join ADDRESS [settings]",
      "Lets this host play for a run of another host: simulators and policy workers here, the learner "
      "there.\n"
      "ADDRESS is what the run that serves prints (192.168.1.7/0123456789abcdef), the folder of that run "
      "where\n"
      "both hosts see it, or - to read the address from the standard input. Settings, maps and weights come "
      "from\n"
      "the run. Ctrl-C leaves: what is under way is delivered first. The run's end ends this too.");
  JoinRequest request;
  line.add_positional("ADDRESS", request.address, "address, run folder, or -");
  line.add_option("wait_s", request.wait_s, "SECONDS", "how long to wait for the run's answer; default 30");
  line.add_option("patience_s", request.patience_s, "SECONDS",
                  "how long the learner's host may be silent before this one gives up; default 300");
  line.add_option("keys", request.key_folder, "FOLDER",
                  "this host's keys, which `comrad keys` made, for a network; %h: this host's name");
  line.add_switch("leave_with_input", request.leaves_with_input, "leave when the standard input ends");
  line.add_settings();
  if (const Status parsed = line.parse(arguments); !parsed) return report_error("join", parsed.error());
  if (line.help_requested()) return print_settings_help("join", line);
  request.key_folder = key_folder_here(std::move(request.key_folder));
  const Expected<int> done = join(line, request);
  return done ? *done : report_error("join", done.error());
}

}  // namespace comrad::deploy
