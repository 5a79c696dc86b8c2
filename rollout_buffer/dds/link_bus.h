// The link between hosts: what a host that plays for a learner of another host and that learner's host exchange, and what
// a run with --publish reports to monitors of other hosts. A network reaches nothing of a run but these topics.
#pragma once

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "rollout_buffer/core/checksum.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/bus_config.h"
#include "rollout_buffer/schema/episode_record.h"
#include "rollout_buffer/schema/train_stats.h"

namespace comrad::dds {

constexpr uint32_t kLinkVersion =
    9;  ///< of all messages but questions and answers: other versions do not meet
constexpr std::size_t kChunkBytes = 1 << 20;            ///< most of a weights chunk or of an answer's payload
constexpr std::size_t kFragmentBytes = 1 << 18;         ///< most raw bytes of a trajectory's fragment
constexpr std::size_t kFragmentPayloadBytes = 264'192;  ///< most of them as LZ4 makes them
constexpr std::size_t kFrameBatchBytes = 1 << 22;       ///< most of a batch of frames, as it travels
constexpr std::size_t kQuestionBytes = 1023;            ///< most of the text of a question or an answer
constexpr std::size_t kScenarioBytes = 4096;            ///< most of a scenario's name: no path is longer

/// A question to a run's join endpoint, and its answer. They never change.
struct JoinQuestion {
  uint64_t peer_id = 0;
  uint32_t question_id = 0;
  std::string text = {};  ///< JSON
};
struct JoinAnswer {
  uint64_t peer_id = 0;
  uint32_t question_id = 0;
  std::string text = {};  ///< JSON
  std::string payload = {};
};

enum class Topic {
  kQuestion,
  kAnswer,
  kReport,
  kState,
  kTrajectory,
  kWeights,
  kEpisode,
  kFrames,
  kActions,
  kWorker,
  kTrainStats,
  kEpisodeResult
};
constexpr std::size_t kTopicCount = 12;

/// How many bytes of `text` fit into `most`, cut between two characters of UTF-8.
std::size_t whole_characters(std::string_view text, std::size_t most);

/// Text in a message; what does not fit is cut.
template <std::size_t kBytes>
class BoundedText {
 public:
  BoundedText() = default;
  template <std::convertible_to<std::string_view> Text>
  BoundedText(const Text& text) {
    const std::string_view given = text;
    std::copy_n(given.data(), whole_characters(given, kBytes - 1), bytes_);
  }
  std::string str() const { return {bytes_, strnlen(bytes_, kBytes)}; }

 private:
  char bytes_[kBytes] = {};
};
using Words = BoundedText<256>;

// The messages travel as they lie in memory, up to `payload`: a change bumps kLinkVersion. What arrives has the right
// size, and every number and every byte of it is its sender's.

/// What a host that plays for another one's learner reports of itself, on both links. The first one requests places.
struct PeerHello {
  uint64_t peer_id = 0;
  uint64_t fingerprint = 0;  ///< of the offer that it plays
  uint64_t slab_bytes = 0;
  uint32_t epoch = 0;  ///< lives of the process that sends, and sessions of the other end in each
  uint32_t sim_workers = 0;
  uint32_t envs_per_worker = 0;
  uint32_t is_leaving = 0;
  Words host = {};
};

enum class PeerRun : uint32_t { kRunning, kPaused, kLeaving, kStopping, kRefused };

/// The desired state of one such host, on both links; never a command.
struct PeerState {
  static constexpr Topic kTopic = Topic::kState;
  uint64_t peer_id = 0;
  uint64_t session = 0;       ///< of the end that serves; another one counts from 0
  uint64_t done_index = 0;    ///< trajectories below it are sealed there, or known not to be wanted
  uint64_t credit_index = 0;  ///< trajectories below it may be sent or begun
  uint64_t schedule_env_frames = 0;
  uint32_t epoch = 0;  ///< of the hello that this answers
  PeerRun run = PeerRun::kRunning;
  Words message = {};  ///< why it is refused
  uint64_t key() const { return peer_id; }
};

/// Of a host that sends trajectories, at least once a second.
struct SenderReport {
  static constexpr Topic kTopic = Topic::kReport;
  PeerHello hello = {};
  uint64_t decisions_played = 0;
  uint64_t decisions_delivered = 0;
  uint64_t decisions_lost = 0;  ///< sent to a learner's host that began anew
  uint64_t key() const { return hello.peer_id; }
};

/// One piece of a sealed slab: `raw_bytes` from `offset_bytes` on, as one LZ4 block.
struct TrajectoryFragment {
  static constexpr Topic kTopic = Topic::kTrajectory;
  uint64_t peer_id = 0;
  uint64_t send_index = 0;  ///< counts trajectories of the epoch
  uint64_t rollout_index = 0;
  uint64_t layout_id = 0;
  uint64_t first_episode_id = 0;
  uint64_t first_episode_seed = 0;
  uint64_t offset_bytes = 0;
  uint64_t checksum = 0;  ///< of the raw bytes
  uint32_t epoch = 0;
  uint32_t fragment_index = 0;
  uint32_t fragment_count = 0;
  uint32_t env_index = 0;  ///< of the host that sends
  uint32_t length = 0;
  uint32_t raw_bytes = 0;
  std::span<const std::byte> payload = {};
  uint64_t key() const { return 0; }
};

struct WeightsChunk {
  static constexpr Topic kTopic = Topic::kWeights;
  uint64_t bytes = 0;     ///< of all chunks
  uint64_t checksum = 0;  ///< of all chunks
  uint64_t bf16_count =
      0;  ///< numbers at the beginning that are bfloat16, all behind them f32; 0: as in an arena
  uint32_t chunk_index = 0;
  uint32_t chunk_count = 0;
  uint32_t version = 0;
  uint32_t unused = 0;
  std::span<const std::byte> payload = {};
  uint64_t key() const { return chunk_index; }
};

/// Requests of a host with simulators and no policy (link/frames/frame_stream.h), as one LZ4 block or as they are.
/// Without requests it is a hello.
struct FrameBatch {
  static constexpr Topic kTopic = Topic::kFrames;
  PeerHello hello = {};
  uint64_t batch_index = 0;  ///< counts batches of the epoch; shows what was lost
  uint64_t checksum = 0;     ///< of the raw bytes
  uint32_t request_count = 0;
  uint32_t raw_bytes = 0;
  uint32_t is_compressed = 0;
  uint32_t unused = 0;
  std::span<const std::byte> payload = {};
  uint64_t key() const { return 0; }
};

/// Answers to one host's requests.
struct ActionBatch {
  static constexpr Topic kTopic = Topic::kActions;
  PeerState state = {};
  std::span<const std::byte> payload = {};
  uint64_t key() const { return 0; }
};

/// An episode that ended on a host which plays for another one's learner.
struct PeerEpisode {
  static constexpr Topic kTopic = Topic::kEpisode;
  uint64_t peer_id = 0;
  EpisodeRecord record = {};
  uint64_t key() const { return 0; }
};

// What a run with --publish reports to monitors, once a second. It reads nothing of theirs.

/// One worker of the run; its role "supervisor": the run itself, "host": all workers of another host that plays for it.
struct WorkerStatus {
  static constexpr Topic kTopic = Topic::kWorker;
  Words worker_id = {};  ///< the key: "sim-0", "policy-0", "learner", "supervisor"
  Words host = {};
  BoundedText<32> role = {}, state = {};
  double decisions_per_s = 0;
  double busy = 0;  ///< share of the last second or so that it did not wait for others, 0 to 1
  double silent_s = 0;
  double cpu_s = 0;
  uint64_t resident_bytes = 0;
  int32_t pid = 0;  ///< 0: none now
  uint32_t restarts = 0;
  BoundedText<512> message = {};
  uint64_t key() const { return checksum64(std::as_bytes(std::span(&worker_id, 1))); }
};

/// The learner's report, and what it is a part of.
struct RunStats {
  static constexpr Topic kTopic = Topic::kTrainStats;
  Words run = {};              ///< name of the run's folder
  double elapsed_s = 0;        ///< of this start of the run
  double env_frames_goal = 0;  ///< train_for_env_frames
  uint32_t frame_skip = 1;
  uint32_t unused = 0;
  TrainStats stats = {};
  uint64_t key() const { return 0; }
};

/// An episode that ended in the run; the payload is the scenario.
struct EpisodeResult {
  static constexpr Topic kTopic = Topic::kEpisodeResult;
  EpisodeRecord record = {};
  std::span<const std::byte> payload = {};
  uint64_t key() const { return 0; }
};

/// What discovery shows of a run, also of one of another version.
struct SeenRun {
  bool serves = false;
  std::vector<uint32_t> published_versions = {};  ///< of each writer that reports to monitors
};

/// What carries the messages: Cyclone DDS, or a simulated network. Threads: one.
class LinkCarrier {
 public:
  using Visitor =
      std::function<void(uint64_t key, std::span<const std::byte> head, std::span<const std::byte> payload)>;
  virtual ~LinkCarrier() = default;
  virtual Status write(Topic topic, uint64_t key, std::span<const std::byte> head,
                       std::span<const std::byte> payload) = 0;
  virtual void take(Topic topic, const Visitor& visit) = 0;
  virtual bool is_acknowledged(Topic topic) const = 0;
  virtual bool wait(int timeout_ms) = 0;
  virtual SeenRun seen() const { return {}; }
};

/// One participant of a link. Spans that a visitor gets end with its call; it may write. take() never blocks. Threads: one.
class LinkBus {
 public:
  /// Another `version` is for tests. Errors: those of validate(), kBadInput where this process takes part in another run of
  /// the same domain, kSystem with Cyclone's return code and what to check.
  static Expected<LinkBus> open(const BusConfig& config, uint32_t version = kLinkVersion);
  explicit LinkBus(std::unique_ptr<LinkCarrier> carrier) : carrier_(std::move(carrier)) {}

  /// Errors: kBadInput for a payload beyond its bound, or where keys do not allow it; kTimeout where readers do not keep up, and nothing was written;
  /// kSystem.
  template <typename Message>
  Status write(const Message& message) {
    std::span<const std::byte> payload;
    if constexpr (requires { message.payload; }) payload = message.payload;
    return carrier_->write(Message::kTopic, message.key(),
                           std::as_bytes(std::span(&message, 1)).first(head_bytes<Message>()), payload);
  }
  Status write(const JoinQuestion& question);
  Status write(const JoinAnswer& answer);

  /// Calls `visit` for each message that has arrived.
  template <typename Message, typename Visit>
  void take(Visit visit) {
    static_assert(std::is_trivially_copyable_v<Message>);
    carrier_->take(Message::kTopic,
                   [&](uint64_t, std::span<const std::byte> head, std::span<const std::byte> payload) {
                     if (head.size() != head_bytes<Message>()) return;
                     Message message;
                     std::memcpy(static_cast<void*>(&message), head.data(), head.size());
                     if constexpr (requires { message.payload; }) message.payload = payload;
                     visit(static_cast<const Message&>(message));
                   });
  }
  void take_questions(const std::function<void(const JoinQuestion&)>& visit);
  void take_answers(const std::function<void(const JoinAnswer&)>& visit);

  /// Whether all chunks of weights that were written have reached every reader.
  bool has_sent_weights() const { return carrier_->is_acknowledged(Topic::kWeights); }
  /// Blocks until something lies ready on any reader made so far, or `timeout_ms`. True if something does.
  bool wait(int timeout_ms) { return carrier_->wait(timeout_ms); }
  SeenRun seen() const { return carrier_->seen(); }

 private:
  template <typename Message>
  static constexpr std::size_t head_bytes() {
    if constexpr (requires(const Message& message) { message.payload; })
      return offsetof(Message, payload);
    else
      return sizeof(Message);
  }

  std::unique_ptr<LinkCarrier> carrier_;
};

}  // namespace comrad::dds
