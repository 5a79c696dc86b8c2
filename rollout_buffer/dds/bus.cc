#include "rollout_buffer/dds/bus.h"

#include <spdlog/fmt/fmt.h>

#include <comrad.h>

#include <array>
#include <set>
#include <utility>

#include "rollout_buffer/dds/episode_wire.h"
#include "rollout_buffer/dds/participant.h"

namespace comrad::dds {
namespace {

constexpr int kBusVersion = 5;  // part of the partition: builds that disagree on comrad.idl do not meet
constexpr int kEpisodeHistory = 1000;
constexpr std::size_t kMaxPending =
    4096;  // statuses kept for a caller that reads only losses, or only statuses

template <typename T>
void forget_oldest(std::vector<T>& pending) {
  if (pending.size() > kMaxPending) pending.erase(pending.begin(), pending.end() - kMaxPending);
}

enum TopicIndex { kWorkerStatus, kRunControl, kWeightsUpdate, kEpisodeResult, kTrainStats, kTopicCount };

const std::array<TopicTraits, kTopicCount>& topics() {
  static const std::array<TopicTraits, kTopicCount> all = {{
      {"WorkerStatus", &comrad_wire_WorkerStatus_desc, true, 1, true},
      {"RunControl", &comrad_wire_RunControl_desc, true},
      {"WeightsUpdate", &comrad_wire_WeightsUpdate_desc, true},
      {"EpisodeResult", &comrad_wire_EpisodeResult_desc, false, kEpisodeHistory},
      {"TrainStats", &comrad_wire_TrainStats_desc, true},
  }};
  return all;
}

}  // namespace

struct Bus::State {
  std::unique_ptr<Participant> participant;
  // Guarded by the participant's mutex.
  std::set<std::string> own_workers;  // ids this bus spoke for: they get a goodbye
  std::vector<WorkerStatus> pending_status;
  std::vector<std::string> pending_lost;

  ~State() {
    for (const std::string& worker_id : own_workers) {
      comrad_wire_WorkerStatus key{};
      put(key.worker_id, worker_id);
      participant->dispose(kWorkerStatus, &key);
    }
  }

  template <typename Wire>
  Status write(TopicIndex index, const Wire& sample) {
    return participant->write(index, sample);
  }
  template <typename Wire, typename Visitor>
  void take(TopicIndex index, Visitor visit) {
    participant->take<Wire>(index, visit);
  }

  // WorkerStatus feeds two calls, so what one of them takes is kept for the other. The caller holds the mutex.
  void take_workers() {
    std::set<std::string> lost_now;
    take<comrad_wire_WorkerStatus>(kWorkerStatus,
                                   [&](const comrad_wire_WorkerStatus& in, const dds_sample_info_t& info) {
                                     if (info.valid_data) {
                                       pending_status.push_back({.worker_id = get(in.worker_id),
                                                                 .host = get(in.host),
                                                                 .pid = in.pid,
                                                                 .role = get(in.role),
                                                                 .state = get(in.state),
                                                                 .decisions_per_s = in.decisions_per_s,
                                                                 .message = get(in.message)});
                                     }
                                     if (info.instance_state == DDS_IST_NOT_ALIVE_NO_WRITERS)
                                       lost_now.insert(get(in.worker_id));
                                   });
    pending_lost.insert(pending_lost.end(), lost_now.begin(), lost_now.end());
    forget_oldest(pending_status);
    forget_oldest(pending_lost);
  }
};

Bus::Bus(std::unique_ptr<State> state) : state_(std::move(state)) {}
Bus::Bus(Bus&&) noexcept = default;
Bus& Bus::operator=(Bus&&) noexcept = default;
Bus::~Bus() = default;

Expected<Bus> Bus::open(const BusConfig& config) {
  auto state = std::make_unique<State>();
  COMRAD_TRY_ASSIGN(
      state->participant,
      Participant::open(config, topics(), fmt::format("comrad-{}-{}", kBusVersion, config.run_id)));
  return Bus(std::move(state));
}

Status Bus::write(const WorkerStatus& status) {
  comrad_wire_WorkerStatus out{};
  if (status.worker_id.empty() || status.worker_id.size() >= sizeof out.worker_id) {
    return Error{ErrorCode::kBadInput, fmt::format("WorkerStatus.worker_id '{}': 1 to {} bytes",
                                                   status.worker_id.substr(0, 80), sizeof out.worker_id - 1)};
  }
  put(out.worker_id, status.worker_id);
  put(out.host, status.host);
  out.pid = status.pid;
  put(out.role, status.role);
  put(out.state, status.state);
  out.decisions_per_s = status.decisions_per_s;
  put(out.message, status.message);
  COMRAD_TRY(state_->write(kWorkerStatus, out));
  const std::lock_guard lock(state_->participant->mutex());
  state_->own_workers.insert(status.worker_id);
  return {};
}

Status Bus::write(const RunControl& control) {
  comrad_wire_RunControl out{};
  put(out.run_state, control.run_state);
  out.checkpoint_seq = control.checkpoint_seq;
  out.settings_epoch = control.settings_epoch;
  return state_->write(kRunControl, out);
}

Status Bus::write(const WeightsUpdate& update) {
  comrad_wire_WeightsUpdate out{};  // chunk 0 of 0: a notice, the bytes lie in the arena
  out.version = update.version;
  out.bytes = update.bytes;
  out.checksum = update.checksum;
  return state_->write(kWeightsUpdate, out);
}

Status Bus::write(const EpisodeResult& result) {
  comrad_wire_EpisodeResult out{};
  put(out.scenario, result.scenario);
  out.record = wire_of(result.record);
  return state_->write(kEpisodeResult, out);
}

Status Bus::write(const TrainStats& stats) {
  comrad_wire_TrainStats out{};
  out.time_s = stats.time_s;
  out.env_frames = stats.env_frames;
  out.decisions = stats.decisions;
  out.learner_version = stats.learner_version;
  out.env_frames_per_s = stats.env_frames_per_s;
  out.decisions_per_s = stats.decisions_per_s;
  out.score_mean = stats.score_mean;
  out.return_mean = stats.return_mean;
  out.episodes = stats.episodes;
  out.policy_lag_mean = stats.policy_lag_mean;
  out.policy_lag_max = stats.policy_lag_max;
  put(out.last_checkpoint, stats.last_checkpoint);
  return state_->write(kTrainStats, out);
}

std::vector<WorkerStatus> Bus::take_worker_status() {
  const std::lock_guard lock(state_->participant->mutex());
  state_->take_workers();
  return std::exchange(state_->pending_status, {});
}

std::vector<std::string> Bus::take_lost_workers() {
  const std::lock_guard lock(state_->participant->mutex());
  state_->take_workers();
  return std::exchange(state_->pending_lost, {});
}

std::optional<RunControl> Bus::take_run_control() {
  const std::lock_guard lock(state_->participant->mutex());
  std::optional<RunControl> newest;
  state_->take<comrad_wire_RunControl>(kRunControl, [&](const auto& in, const dds_sample_info_t& info) {
    if (!info.valid_data) return;
    newest = {.run_state = get(in.run_state),
              .checkpoint_seq = in.checkpoint_seq,
              .settings_epoch = in.settings_epoch};
  });
  return newest;
}

std::optional<WeightsUpdate> Bus::take_weights_update() {
  const std::lock_guard lock(state_->participant->mutex());
  std::optional<WeightsUpdate> newest;
  state_->take<comrad_wire_WeightsUpdate>(kWeightsUpdate, [&](const auto& in, const dds_sample_info_t& info) {
    if (!info.valid_data) return;
    newest = {.version = in.version, .bytes = in.bytes, .checksum = in.checksum};
  });
  return newest;
}

std::vector<EpisodeResult> Bus::take_episode_results() {
  const std::lock_guard lock(state_->participant->mutex());
  std::vector<EpisodeResult> results;
  state_->take<comrad_wire_EpisodeResult>(kEpisodeResult, [&](const auto& in, const dds_sample_info_t& info) {
    if (!info.valid_data) return;
    results.push_back({.scenario = get(in.scenario), .record = record_of(in.record)});
  });
  return results;
}

std::optional<TrainStats> Bus::take_train_stats() {
  const std::lock_guard lock(state_->participant->mutex());
  std::optional<TrainStats> newest;
  state_->take<comrad_wire_TrainStats>(kTrainStats, [&](const auto& in, const dds_sample_info_t& info) {
    if (!info.valid_data) return;
    newest = {.time_s = in.time_s,
              .env_frames = in.env_frames,
              .decisions = in.decisions,
              .learner_version = in.learner_version,
              .env_frames_per_s = in.env_frames_per_s,
              .decisions_per_s = in.decisions_per_s,
              .score_mean = in.score_mean,
              .return_mean = in.return_mean,
              .episodes = in.episodes,
              .policy_lag_mean = in.policy_lag_mean,
              .policy_lag_max = in.policy_lag_max,
              .last_checkpoint = get(in.last_checkpoint)};
  });
  return newest;
}

bool Bus::wait(int timeout_ms) { return state_->participant->wait(timeout_ms); }

}  // namespace comrad::dds
