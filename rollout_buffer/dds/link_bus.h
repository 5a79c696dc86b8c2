// The link between hosts: what a host that feeds a learner and that learner's host say to each other. A participant of
// its own, apart from the run's bus, so that a network reaches nothing but these topics.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/bus_config.h"
#include "rollout_buffer/schema/episode_record.h"

namespace comrad::dds {

constexpr uint32_t kLinkVersion = 7;  ///< of the topics but the door's: other versions do not meet on them
constexpr std::size_t kChunkBytes = 1 << 20;            ///< most of a weights chunk or of a door's payload
constexpr std::size_t kFragmentBytes = 1 << 18;         ///< most raw bytes of a trajectory's fragment
constexpr std::size_t kFragmentPayloadBytes = 264'192;  ///< most of them as LZ4 makes them
constexpr std::size_t kFrameBatchBytes = 1 << 22;       ///< most of a batch of frames, as it travels
constexpr std::size_t kDoorTextBytes = 1023;

struct DoorQuestion {
  uint64_t feeder_id = 0;
  uint32_t question_id = 0;
  std::string text = {};  ///< JSON
};

struct DoorAnswer {
  uint64_t feeder_id = 0;
  uint32_t question_id = 0;
  std::string text = {};  ///< JSON
  std::string payload = {};
};

/// Of a feeding host; the members as comrad.idl has them.
struct FeedReport {
  uint64_t feeder_id = 0;
  uint32_t epoch = 0;
  uint64_t beat = 0;
  uint64_t fingerprint = 0;
  uint64_t slab_bytes = 0;
  uint32_t sim_workers = 0;
  uint32_t envs_per_worker = 0;
  bool is_leaving = false;
  uint32_t weights_version = 0;
  uint64_t decisions_played = 0;
  uint64_t decisions_delivered = 0;
  uint64_t decisions_lost = 0;  ///< sent to a learner's host that began anew
  std::string host = {};
};

struct FeedState {
  uint64_t feeder_id = 0;
  uint64_t session = 0;
  uint32_t epoch = 0;
  uint64_t beat = 0;
  std::string run_state = {};  ///< running, paused, leaving (asked to), stopping, refused
  std::string message = {};
  uint64_t done_index = 0;
  uint64_t credit_index = 0;
  uint64_t schedule_env_frames = 0;
};

struct TrajectoryFragment {
  uint64_t feeder_id = 0;
  uint32_t epoch = 0;
  uint64_t send_index = 0;
  uint32_t fragment_index = 0;
  uint32_t fragment_count = 0;
  uint32_t env_index = 0;
  uint32_t length = 0;
  uint64_t rollout_index = 0;
  uint64_t layout_id = 0;
  uint64_t first_episode_id = 0;
  uint64_t first_episode_seed = 0;
  uint64_t offset_bytes = 0;
  uint32_t raw_bytes = 0;
  uint64_t checksum = 0;
  std::span<const std::byte> payload = {};
};

struct WeightsChunk {
  uint32_t chunk_index = 0;
  uint32_t chunk_count = 0;
  uint32_t version = 0;
  uint64_t bytes = 0;     ///< of all chunks
  uint64_t checksum = 0;  ///< of all chunks
  uint64_t bf16_count =
      0;  ///< numbers at the beginning that are bfloat16, all behind them f32; 0: as in an arena
  std::span<const std::byte> payload = {};
};

/// Of a host with simulators and no policy; the members as comrad.idl has them.
struct FrameBatch {
  uint64_t feeder_id = 0;
  uint32_t epoch = 0;
  uint64_t batch_index = 0;
  uint64_t fingerprint = 0;
  uint64_t slab_bytes = 0;
  uint32_t sim_workers = 0;
  uint32_t envs_per_worker = 0;
  bool is_leaving = false;
  uint32_t request_count = 0;
  uint32_t raw_bytes = 0;
  bool is_compressed = false;
  uint64_t checksum = 0;
  std::string host = {};
  std::span<const std::byte> payload = {};
};

struct ActionBatch {
  uint64_t feeder_id = 0;
  uint64_t session = 0;
  uint32_t epoch = 0;
  uint64_t batch_index = 0;
  std::string run_state = {};  ///< running, paused, stopping, refused
  std::string message = {};
  uint64_t credit_index = 0;
  uint64_t schedule_env_frames = 0;
  std::span<const std::byte> payload = {};
};

struct FeederEpisode {
  uint64_t feeder_id = 0;
  EpisodeRecord record = {};
};

/// The configuration of a run's link, for all that know its id. It is a small domain: one receiver, and on each host a
/// few that feed it.
BusConfig link_config(uint64_t link_id);

/// One participant of a link; what arrives is as hostile as its sender, only bounds are kept by the types. Spans that a
/// visitor gets end with its call; it may write. take_*() never blocks. Threads: one.
class LinkBus {
 public:
  /// Errors: as Bus::open.
  static Expected<LinkBus> open(const BusConfig& config);
  LinkBus(LinkBus&&) noexcept;
  LinkBus& operator=(LinkBus&&) noexcept;
  ~LinkBus();

  /// Errors: kBadInput for a payload or list beyond its bound; kTimeout where readers do not keep up, and nothing was
  /// written; kSystem.
  Status write(const DoorQuestion& question);
  Status write(const DoorAnswer& answer);
  Status write(const FeedReport& report);
  Status write(const FeedState& state);
  Status write(const TrajectoryFragment& fragment);
  Status write(const WeightsChunk& chunk);
  Status write(const FeederEpisode& episode);
  Status write(const FrameBatch& batch);
  Status write(const ActionBatch& batch);

  /// Whether all chunks of weights that were written have reached everybody who listens.
  bool has_sent_weights() const;

  void take_questions(const std::function<void(const DoorQuestion&)>& visit);
  void take_answers(const std::function<void(const DoorAnswer&)>& visit);
  void take_reports(const std::function<void(const FeedReport&)>& visit);
  /// Those for one feeding host.
  void take_states(uint64_t feeder_id, const std::function<void(const FeedState&)>& visit);
  void take_fragments(const std::function<void(const TrajectoryFragment&)>& visit);
  void take_weights(const std::function<void(const WeightsChunk&)>& visit);
  void take_episodes(const std::function<void(const FeederEpisode&)>& visit);

  void take_frames(const std::function<void(const FrameBatch&)>& visit);
  /// Those for one feeding host.
  void take_actions(uint64_t feeder_id, const std::function<void(const ActionBatch&)>& visit);

  /// As Bus::wait.
  bool wait(int timeout_ms);

 private:
  struct State;
  explicit LinkBus(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace comrad::dds
