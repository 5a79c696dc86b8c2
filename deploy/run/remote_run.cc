#include "deploy/run/remote_run.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <string_view>
#include <utility>

#include "deploy/launch/progress.h"
#include "deploy/run/run_table.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/link/join/link_address.h"

namespace comrad::deploy {
namespace {

using nlohmann::json;

constexpr std::size_t kMostWorkers = 10'000;  // more are not of one run
constexpr std::size_t kKeptEpisodes = 20;
constexpr std::size_t kMostLetters = 512;
constexpr double kSilentS = 5;  // a run reports every second

json number(double value) { return std::abs(value) <= 1e15 ? json(value) : json(nullptr); }
json number(uint64_t value) { return number(static_cast<double>(value)); }
std::string words(const std::string& text) { return fitted(text, kMostLetters); }
template <std::size_t kBytes>
std::string words(const dds::BoundedText<kBytes>& text) {
  return words(text.str());
}

json json_of(const dds::WorkerStatus& worker) {
  return {{"worker", words(worker.worker_id)},
          {"role", words(worker.role)},
          {"host", words(worker.host)},
          {"pid", worker.pid},
          {"state", words(worker.state)},
          {"decisions_per_s", number(worker.decisions_per_s)},
          {"busy", number(worker.busy)},
          {"restarts", worker.restarts},
          {"silent_s", number(worker.silent_s)},
          {"cpu_s", number(worker.cpu_s)},
          {"resident_bytes", number(worker.resident_bytes)}};
}

json json_of(const EpisodeRecord& episode) {
  json returns = json::array();
  for (const float value : episode.returns()) returns.push_back(number(value));
  return {{"episode_id", episode.episode_id},   {"layout_id", episode.layout_id},
          {"J", number(episode.score)},         {"returns", returns},
          {"length_tics", episode.length_tics}, {"terminated", episode.terminated != 0}};
}

}  // namespace

Error RemoteRun::why_nothing(const RemoteRequest& request, const std::string& address,
                             uint32_t first_port) const {
  const dds::SeenRun seen = bus_.seen();
  for (const uint32_t version : seen.published_versions)
    if (version != dds::kLinkVersion)
      return {ErrorCode::kBadInput, "the run at " + address + " publishes in version " +
                                        std::to_string(version) + " of the link, this comrad reads version " +
                                        std::to_string(dds::kLinkVersion) +
                                        "; use the same build of comrad on both hosts"};
  if (seen.serves && seen.published_versions.empty())
    return {ErrorCode::kBadInput,
            "the run at " + address + " serves other hosts and does not publish; start it with --publish"};
  return {
      ErrorCode::kTimeout,
      "no report from " + address + " within " + duration_text(request.wait_s) +
          "; check that the run is alive and was started with --publish on the interface that leads here, " +
          (request.key_folder.empty() ? "that it uses no keys (else name this host's with --keys), "
                                      : "that its keys are of the same authority, ") +
          "and that UDP ports from " + std::to_string(first_port) + " on are open in both directions"};
}

Expected<RemoteRun> RemoteRun::open(const RemoteRequest& request) {
  if (!(request.wait_s > 0 && request.wait_s <= 3600))
    return Error{ErrorCode::kBadInput, "--wait_s must be above 0 and at most 3600 s"};
  COMRAD_TRY_ASSIGN(const link::LinkAddress address, link::read_address(request.address));
  COMRAD_TRY_ASSIGN(const std::string interface, link::interface_towards(address.host));
  const dds::BusConfig config = link::joining_config(address, request.hosts, interface, request.key_folder);
  COMRAD_TRY_ASSIGN(dds::LinkBus bus, dds::LinkBus::open(config));
  RemoteRun run(address.host, std::move(bus));
  const double until_s = monotonic_s() + request.wait_s;
  while (!run.has_report() && monotonic_s() < until_s) {
    run.listen();
    if (!run.has_report()) run.bus_.wait(100);
  }
  if (!run.has_report()) return run.why_nothing(request, address.host, dds::ports_of(config).first);
  // The rest of the workers comes at once, if not before.
  for (int rounds = 0; rounds < 3 && run.bus_.wait(100); ++rounds) run.listen();
  return run;
}

void RemoteRun::listen() {
  bus_.take<dds::WorkerStatus>([&](const dds::WorkerStatus& status) {
    const std::string id = status.worker_id.str();
    if (workers_.size() < kMostWorkers || workers_.contains(id)) workers_[id] = status;
    if (id == kSupervisor) heard_s_ = monotonic_s();
  });
  bus_.take<dds::RunStats>([&](const dds::RunStats& stats) {
    stats_ = stats;
    stats_->stats.last_checkpoint[kCheckpointPathBytes - 1] = '\0';
  });
  bus_.take<dds::EpisodeResult>([&](const dds::EpisodeResult& result) {
    ++episodes_heard_;
    episodes_.push_back(result.record);
    if (episodes_.size() > kKeptEpisodes) episodes_.pop_front();
  });
}

bool RemoteRun::has_ended() const {
  const auto supervisor = workers_.find(kSupervisor);
  static const std::set<std::string_view> kEnds = {"finished", "interrupted", "not saved", "killed",
                                                   "failed"};
  return supervisor != workers_.end() && kEnds.contains(supervisor->second.state.str());
}

json RemoteRun::look() {
  listen();
  const dds::WorkerStatus& supervisor = workers_[kSupervisor];
  const TrainStats& stats = stats_->stats;
  json run = {{"run", words(stats_->run)},
              {"address", address_},
              {"host", words(supervisor.host)},
              {"pid", supervisor.pid},
              {"state", words(supervisor.state)},
              {"message", words(supervisor.message)},
              {"elapsed_s", number(stats_->elapsed_s)},
              {"env_frames", number(stats.env_frames)},
              {"env_frames_goal", number(stats_->env_frames_goal)},
              {"decisions", number(stats.decisions)},
              {"learner_version", stats.learner_version},
              {"env_frames_per_s", number(stats.env_frames_per_s)},
              {"decisions_per_s", number(stats.decisions_per_s)},
              {"env_frameskip", stats_->frame_skip},
              {"J_mean", stats.episodes > 0 ? number(stats.score_mean) : json(nullptr)},
              {"episodes", number(stats.episodes)},
              {"policy_lag_mean", number(stats.policy_lag_mean)},
              {"policy_lag_max", stats.policy_lag_max},
              {"replay_filled", number(stats.replay_filled)}};
  const double silent_s = monotonic_s() - heard_s_;
  run["silence"] = silent_s < kSilentS || has_ended()
                       ? ""
                       : "no report from " + address_ + " for " + duration_text(silent_s);
  run["checkpoint"] = {{"path", words(stats.last_checkpoint)}};
  run["workers"] = json::array();
  struct Host {
    int workers = 0;
    double restarts = 0, decisions_per_s = 0;
  };
  std::map<std::string, Host> hosts;
  double restarts = 0;
  for (const auto& [id, worker] : workers_) {
    const std::string role = worker.role.str();
    if (id == kSupervisor || worker.state.str() == "left") continue;
    run["workers"].push_back(json_of(worker));
    Host& host = hosts[words(worker.host)];
    host.workers += worker.pid != 0 || role == "host";
    host.restarts += worker.restarts;
    if (role == "sim" || role == "host") host.decisions_per_s += worker.decisions_per_s;
    restarts += worker.restarts;
  }
  run["restarts"] = restarts;
  run["hosts"] = json::array();
  for (const auto& [name, host] : hosts)
    run["hosts"].push_back({{"host", name},
                            {"workers", host.workers},
                            {"decisions_per_s", number(host.decisions_per_s)},
                            {"restarts", host.restarts}});
  run["episodes_heard"] = episodes_heard_;
  run["last_episodes"] = json::array();
  for (const EpisodeRecord& episode : episodes_) run["last_episodes"].push_back(json_of(episode));
  return run;
}

}  // namespace comrad::deploy
