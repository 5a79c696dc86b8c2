#include "deploy/launch/run_snapshot.h"

#include <spdlog/fmt/fmt.h>

#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "rollout_buffer/core/host_name.h"
#include "rollout_buffer/link/join/link_files.h"
#include "rollout_buffer/shm/accounts.h"

namespace comrad::deploy {
namespace {

using nlohmann::ordered_json;

uint64_t resident_bytes_of(pid_t pid) {
  std::ifstream file(fmt::format("/proc/{}/statm", pid));
  uint64_t pages = 0, resident_pages = 0;
  return file >> pages >> resident_pages ? resident_pages * static_cast<uint64_t>(getpagesize()) : 0;
}

double grown_per_s(uint64_t before, uint64_t now, double seconds) {
  return now > before && seconds > 0 ? static_cast<double>(now - before) / seconds : 0;
}

/// JSON has no NaN.
ordered_json number(double value) {
  return std::isfinite(value) ? ordered_json(value) : ordered_json(nullptr);
}

ordered_json json_of(const WorkerSnapshot& worker) {
  return {{"worker", worker.name},
          {"role", worker.role},
          {"host", worker.host},
          {"pid", worker.pid},
          {"state", worker.state},
          {"decisions", worker.decisions},
          {"decisions_per_s", worker.decisions_per_s},
          {"busy", worker.busy},
          {"restarts", worker.restarts},
          {"silent_s", worker.silent_s},
          {"cpu_s", worker.cpu_s},
          {"resident_bytes", worker.resident_bytes}};
}

ordered_json json_of(const HostSnapshot& host) {
  return {{"host", host.name},
          {"workers", host.workers},
          {"decisions_per_s", host.decisions_per_s},
          {"credits", host.credits},
          {"restarts", host.restarts}};
}

}  // namespace

void SnapshotTaker::look(const shm::Arena& arena, double now_s) {
  const double seconds = looked_s_ > 0 ? now_s - looked_s_ : 0;
  looked_s_ = now_s;
  for (const Worker& worker : table_.workers()) {
    const shm::WorkerCounters& counters = counters_of(worker, arena);
    Look& last = looks_[worker.name];
    const Look now{.decisions = counters.decisions.load(std::memory_order_relaxed),
                   .busy_ns = counters.busy_ns.load(std::memory_order_relaxed),
                   .wait_ns = counters.wait_ns.load(std::memory_order_relaxed)};
    const double busy = grown_per_s(last.busy_ns, now.busy_ns, 1),
                 wait = grown_per_s(last.wait_ns, now.wait_ns, 1);
    const double rate = grown_per_s(last.decisions, now.decisions, seconds);
    last = now;
    last.decisions_per_s = worker.process ? rate : 0;
    last.busy = busy + wait > 0 ? busy / (busy + wait) : 0;
  }
  if (!plan_.serves()) return;
  std::map<std::string, PeerLook> peers;  // by name: several runs of one host are one line
  for (const link::PeerRecord& record : link::all_peers(plan_.run_dir)) {
    PeerLook& peer = peers[record.host];
    peer.decisions += record.decisions;
    if (!record.is_here) continue;
    peer.workers += record.workers;
    peer.credits += static_cast<int64_t>(record.credits);
  }
  for (auto& [name, peer] : peers)
    if (const auto before = peers_.find(name); before != peers_.end())
      peer.decisions_per_s = grown_per_s(before->second.decisions, peer.decisions, seconds);
  peers_ = std::move(peers);
}

RunSnapshot SnapshotTaker::take(const shm::Arena& arena, const RunStatus& status, double now_s) const {
  static const std::string host = host_name();
  const shm::ControlBlock& control = arena.control();
  const TrainStats& stats = meter_.last_stats();
  RunSnapshot run;
  run.run = std::filesystem::path(plan_.run_dir).filename().string();
  run.run_dir = plan_.run_dir;
  run.host = host;
  run.pid = getpid();
  run.status = status;
  run.frame_skip = plan_.config.environment.env_frameskip;
  run.env_frames_goal = plan_.config.run.train_for_env_frames;
  run.decisions_per_s = status.env_frames_per_s / static_cast<double>(run.frame_skip);
  run.lag_mean = stats.policy_lag_mean;
  run.lag_max = stats.policy_lag_max;
  run.episodes = stats.episodes;
  run.replay_filled = meter_.replay_filled();
  run.slabs = arena.slabs().counts();
  run.accounts = meter_.accounts();
  const shm::DecisionCounts counts = arena.accounts().counts();
  const uint64_t filling =
      counts.made - counts.sealed > counts.lost ? counts.made - counts.sealed - counts.lost : 0;
  run.decisions_waiting = run.accounts.waiting > filling ? run.accounts.waiting - filling : 0;
  run.env_frames_lost = meter_.env_frames_lost();
  run.checkpoint_asked = control.checkpoint_seq.load();
  run.checkpoint_done = control.checkpoint_done.load();
  run.checkpoints_failed = control.checkpoints_failed.load();
  run.saved_env_frames = control.saved_env_frames.load();
  run.last_checkpoint = stats.last_checkpoint;
  run.silence = table_.silence_text();
  HostSnapshot here{.name = host, .credits = run.slabs.free};
  for (const Worker& worker : table_.workers()) {
    WorkerSnapshot one;
    one.name = worker.name;
    one.role = word_of(worker.role);
    one.host = host;
    one.restarts = worker.restarts;
    one.decisions = counters_of(worker, arena).decisions.load(std::memory_order_relaxed);
    if (const auto found = looks_.find(worker.name); found != looks_.end()) {
      one.decisions_per_s = found->second.decisions_per_s;
      one.busy = found->second.busy;
    }
    one.state = !worker.process                ? "restarting"
                : worker.process->is_stopped() ? "stopped"
                : !worker.has_joined           ? "starting"
                                               : "running";
    if (worker.process) {
      one.pid = worker.process->pid();
      one.cpu_s = worker.process->cpu_seconds();
      one.resident_bytes = resident_bytes_of(worker.process->pid());
      one.silent_s = std::max(0.0, now_s - worker.heard_s);
      ++here.workers;
    }
    run.restarts += worker.restarts;
    here.restarts += worker.restarts;
    if (worker.role == Role::kSim) here.decisions_per_s += one.decisions_per_s;
    run.workers.push_back(std::move(one));
  }
  run.hosts.push_back(std::move(here));
  for (const auto& [name, peer] : peers_)
    if (peer.workers > 0)
      run.hosts.push_back({.name = name,
                           .workers = peer.workers,
                           .decisions_per_s = peer.decisions_per_s,
                           .credits = peer.credits});
  return run;
}

std::string to_json(const RunSnapshot& run) {
  ordered_json json = {{"run", run.run},
                       {"run_dir", run.run_dir},
                       {"host", run.host},
                       {"pid", run.pid},
                       {"state", run.status.state},
                       {"message", run.status.message},
                       {"elapsed_s", run.status.elapsed_s},
                       {"env_frames", run.status.env_frames},
                       {"env_frames_goal", run.env_frames_goal},
                       {"decisions", run.status.decisions},
                       {"learner_version", run.status.learner_version},
                       {"env_frames_per_s", run.status.env_frames_per_s},
                       {"decisions_per_s", run.decisions_per_s},
                       {"env_frameskip", run.frame_skip},
                       {"J_mean", number(run.status.score_mean)},
                       {"episodes", run.episodes},
                       {"policy_lag_mean", number(run.lag_mean)},
                       {"policy_lag_max", run.lag_max},
                       {"replay_filled", run.replay_filled},
                       {"restarts", run.restarts},
                       {"silence", run.silence}};
  json["slabs"] = {{"free", run.slabs.free},
                   {"filling", run.slabs.filling},
                   {"sealed", run.slabs.sealed},
                   {"learning", run.slabs.learning}};
  json["decisions_waiting"] = run.decisions_waiting;
  json["decisions_account"] = account_json(run.accounts);
  json["env_frames_lost"] = run.env_frames_lost;
  json["checkpoint"] = {{"asked", run.checkpoint_asked},
                        {"done", run.checkpoint_done},
                        {"failed", run.checkpoints_failed},
                        {"env_frames", run.saved_env_frames},
                        {"path", run.last_checkpoint}};
  for (const HostSnapshot& host : run.hosts) json["hosts"].push_back(json_of(host));
  json["workers"] = ordered_json::array();
  for (const WorkerSnapshot& worker : run.workers) json["workers"].push_back(json_of(worker));
  return json.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
}

}  // namespace comrad::deploy
