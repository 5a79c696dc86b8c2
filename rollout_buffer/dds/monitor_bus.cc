#include "rollout_buffer/dds/monitor_bus.h"

#include <comrad.h>

#include <array>
#include <charconv>
#include <utility>

#include "rollout_buffer/dds/participant.h"
#include "rollout_buffer/dds/record_wire.h"

namespace comrad::dds {
namespace {

constexpr int kEpisodeHistory = 1000;
constexpr std::string_view kPartition = "comrad-monitor-";   // then the version and the id
constexpr std::string_view kLinkPartition = "comrad-link-";  // of link_bus.cc

enum TopicIndex { kWorkerStatus, kEpisodeResult, kTrainStats, kTopicCount };

const std::array<TopicTraits, kTopicCount>& topics() {
  static const std::array<TopicTraits, kTopicCount> all = {{
      {.name = "WorkerStatus", .type = &comrad_wire_WorkerStatus_desc, .is_kept_for_late_joiners = true},
      {.name = "EpisodeResult", .type = &comrad_wire_EpisodeResult_desc, .history = kEpisodeHistory},
      {.name = "TrainStats", .type = &comrad_wire_RunStats_desc, .is_kept_for_late_joiners = true},
  }};
  return all;
}

}  // namespace

struct MonitorBus::State {
  std::unique_ptr<Participant> participant;

  template <typename Wire, typename Visitor>
  void take(TopicIndex index, Visitor visit) {
    participant->take<Wire>(index, [&](const Wire& in, const dds_sample_info_t& info) {
      if (info.valid_data) visit(in);
    });
  }
};

const std::vector<LinkTopic>& monitor_topics() {
  static const std::vector<LinkTopic> all = [] {
    std::vector<LinkTopic> names;
    for (const TopicTraits& topic : topics()) names.push_back({topic.name, true, false});
    return names;
  }();
  return all;
}

MonitorBus::MonitorBus(std::unique_ptr<State> state) : state_(std::move(state)) {}
MonitorBus::MonitorBus(MonitorBus&&) noexcept = default;
MonitorBus& MonitorBus::operator=(MonitorBus&&) noexcept = default;
MonitorBus::~MonitorBus() = default;

Expected<MonitorBus> MonitorBus::open(const BusConfig& config, uint32_t version) {
  auto state = std::make_unique<State>();
  COMRAD_TRY_ASSIGN(state->participant, Participant::open(config, topics(),
                                                          std::string(kPartition) + std::to_string(version) +
                                                              "-" + config.run_id));
  return MonitorBus(std::move(state));
}

Status MonitorBus::write(const WorkerStatus& status) {
  comrad_wire_WorkerStatus out{};
  put(out.worker_id, status.worker_id);
  put(out.host, status.host);
  out.pid = status.pid;
  put(out.role, status.role);
  put(out.state, status.state);
  out.decisions_per_s = status.decisions_per_s;
  out.busy = status.busy;
  out.silent_s = status.silent_s;
  out.cpu_s = status.cpu_s;
  out.resident_bytes = status.resident_bytes;
  out.restarts = status.restarts;
  put(out.message, status.message);
  return state_->participant->write(kWorkerStatus, out);
}

Status MonitorBus::write(const EpisodeResult& result) {
  comrad_wire_EpisodeResult out{};
  put(out.scenario, result.scenario);
  out.record = wire_of(result.record);
  return state_->participant->write(kEpisodeResult, out);
}

Status MonitorBus::write(const RunStats& stats) {
  comrad_wire_RunStats out{};
  put(out.run, stats.run);
  out.elapsed_s = stats.elapsed_s;
  out.env_frames_goal = stats.env_frames_goal;
  out.frame_skip = stats.frame_skip;
  out.stats = wire_of(stats.stats);
  return state_->participant->write(kTrainStats, out);
}

void MonitorBus::take_workers(const std::function<void(const WorkerStatus&)>& visit) {
  state_->take<comrad_wire_WorkerStatus>(kWorkerStatus, [&](const auto& in) {
    visit({.worker_id = get(in.worker_id),
           .host = get(in.host),
           .pid = in.pid,
           .role = get(in.role),
           .state = get(in.state),
           .decisions_per_s = in.decisions_per_s,
           .busy = in.busy,
           .silent_s = in.silent_s,
           .cpu_s = in.cpu_s,
           .resident_bytes = in.resident_bytes,
           .restarts = in.restarts,
           .message = get(in.message)});
  });
}

void MonitorBus::take_episodes(const std::function<void(const EpisodeResult&)>& visit) {
  state_->take<comrad_wire_EpisodeResult>(kEpisodeResult, [&](const auto& in) {
    visit({.scenario = get(in.scenario), .record = record_of(in.record)});
  });
}

void MonitorBus::take_stats(const std::function<void(const RunStats&)>& visit) {
  state_->take<comrad_wire_RunStats>(kTrainStats, [&](const auto& in) {
    visit({.run = get(in.run),
           .elapsed_s = in.elapsed_s,
           .env_frames_goal = in.env_frames_goal,
           .frame_skip = in.frame_skip,
           .stats = stats_of(in.stats)});
  });
}

bool MonitorBus::wait(int timeout_ms) { return state_->participant->wait(timeout_ms); }

MonitorBus::Seen MonitorBus::seen() const {
  Seen seen;
  for (const std::string& partition : state_->participant->partitions_of_readers())
    seen.has_link |= partition.starts_with(kLinkPartition);
  for (const std::string& partition : state_->participant->partitions_of_writers()) {
    uint32_t version = 0;
    const char* end = partition.data() + partition.size();
    if (partition.starts_with(kPartition) &&
        std::from_chars(partition.data() + kPartition.size(), end, version).ec == std::errc())
      seen.versions.push_back(version);
  }
  return seen;
}

}  // namespace comrad::dds
