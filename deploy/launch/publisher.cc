#include "deploy/launch/publisher.h"

#include <unistd.h>

#include <span>

#include "rollout_buffer/core/host_name.h"
#include "rollout_buffer/link/join/link_address.h"

namespace comrad::deploy {

Expected<Publisher> Publisher::open(const LaunchPlan& plan) {
  COMRAD_TRY_ASSIGN(const uint64_t link_id, link::keep_link_id(plan.run_dir));
  COMRAD_TRY_ASSIGN(dds::LinkBus bus, dds::LinkBus::open(link::serving_config(
                                          link_id, plan.config.hosts, link::kept_keys(plan.run_dir))));
  Publisher publisher(plan.config.run.scenario, std::move(bus));
  COMRAD_TRY(publisher.publish_state("starting", ""));
  return publisher;
}

Status Publisher::publish_state(const std::string& state, const std::string& message) {
  return bus_.write(dds::WorkerStatus{.worker_id = "supervisor",
                                      .host = host_name(),
                                      .role = "supervisor",
                                      .state = state,
                                      .pid = getpid(),
                                      .message = message});
}

Status Publisher::publish(const RunSnapshot& run, const TrainStats& stats) {
  TrainStats now = stats;  // the learner's last report, counted on
  now.env_frames = run.status.env_frames;
  now.decisions = run.status.decisions;
  COMRAD_TRY(bus_.write(dds::RunStats{.run = run.run,
                                      .elapsed_s = run.status.elapsed_s,
                                      .env_frames_goal = run.env_frames_goal,
                                      .frame_skip = static_cast<uint32_t>(run.frame_skip),
                                      .stats = now}));
  for (const WorkerSnapshot& worker : run.workers)
    COMRAD_TRY(bus_.write(dds::WorkerStatus{.worker_id = worker.name,
                                            .host = worker.host,
                                            .role = worker.role,
                                            .state = worker.state,
                                            .decisions_per_s = worker.decisions_per_s,
                                            .busy = worker.busy,
                                            .silent_s = worker.silent_s,
                                            .cpu_s = worker.cpu_s,
                                            .resident_bytes = worker.resident_bytes,
                                            .pid = static_cast<int32_t>(worker.pid),
                                            .restarts = static_cast<uint32_t>(worker.restarts)}));
  std::set<std::string> gone = hosts_;
  for (const HostSnapshot& host : run.hosts) {
    if (host.name == run.host) continue;
    hosts_.insert(host.name);
    gone.erase(host.name);
    COMRAD_TRY(bus_.write(dds::WorkerStatus{.worker_id = "host " + host.name,
                                            .host = host.name,
                                            .role = "host",
                                            .state = "running",
                                            .decisions_per_s = host.decisions_per_s}));
  }
  for (const std::string& name : gone)
    COMRAD_TRY(bus_.write(
        dds::WorkerStatus{.worker_id = "host " + name, .host = name, .role = "host", .state = "left"}));
  return publish_state(run.status.state, run.status.message);
}

Status Publisher::publish(const EpisodeRecord& record) {
  return bus_.write(dds::EpisodeResult{.record = record, .payload = std::as_bytes(std::span(scenario_))});
}

}  // namespace comrad::deploy
