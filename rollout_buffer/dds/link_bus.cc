#include "rollout_buffer/dds/link_bus.h"

#include <comrad.h>

#include <array>
#include <utility>

#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/dds/episode_wire.h"
#include "rollout_buffer/dds/keys.h"
#include "rollout_buffer/dds/participant.h"

namespace comrad::dds {
namespace {

constexpr int kParticipantsOfAHost = 20;
constexpr int kQuestionHistory = 64;
constexpr int kLinkEpisodeHistory = 4096;
constexpr int kFragmentLimit = 256;  // x 258 kB: what a reader or writer holds at most
constexpr int kFrameLimit = 64;      // batches of 256 kB as a rule
constexpr int kActionLimit = 1024;

enum LinkTopicIndex {
  kQuestion,
  kAnswer,
  kReport,
  kState,
  kTrajectory,
  kWeights,
  kEpisode,
  kFrames,
  kActions,
  kLinkTopicCount
};

const std::array<TopicTraits, kLinkTopicCount>& link_traits() {
  static const std::array<TopicTraits, kLinkTopicCount> all = {{
      {.name = "DoorQuestion",
       .type = &comrad_wire_DoorQuestion_desc,
       .history = kQuestionHistory,
       .is_separate = true},
      {.name = "DoorAnswer",
       .type = &comrad_wire_DoorAnswer_desc,
       .history = kQuestionHistory,
       .is_separate = true},
      {.name = "FeedReport", .type = &comrad_wire_FeedReport_desc, .is_kept_for_late_joiners = true},
      {.name = "FeedState", .type = &comrad_wire_FeedState_desc, .is_kept_for_late_joiners = true},
      {.name = "TrajectoryBatch",
       .type = &comrad_wire_TrajectoryBatch_desc,
       .history = 0,
       .sample_limit = kFragmentLimit},
      {.name = "WeightsUpdate", .type = &comrad_wire_WeightsUpdate_desc, .is_kept_for_late_joiners = true},
      {.name = "FeederEpisode", .type = &comrad_wire_FeederEpisode_desc, .history = kLinkEpisodeHistory},
      {.name = "FrameBatch", .type = &comrad_wire_FrameBatch_desc, .history = 0, .sample_limit = kFrameLimit},
      {.name = "ActionBatch",
       .type = &comrad_wire_ActionBatch_desc,
       .history = 0,
       .sample_limit = kActionLimit},
  }};
  return all;
}

Error too_long(const char* what, std::size_t size, std::size_t most) {
  return Error{ErrorCode::kBadInput,
               std::string(what) + " of " + std::to_string(size) + "; at most " + std::to_string(most)};
}

template <typename Sequence>
std::span<const std::byte> bytes_of(const Sequence& sequence) {
  return {reinterpret_cast<const std::byte*>(sequence._buffer), sequence._length};
}

}  // namespace

struct LinkBus::State {
  std::unique_ptr<Participant> participant;  // of one thread: a visitor may write while samples are taken

  template <typename Wire, typename Visitor>
  void take(LinkTopicIndex index, Visitor visit) {
    participant->take<Wire>(index, [&](const Wire& in, const dds_sample_info_t& info) {
      if (info.valid_data) visit(in);
    });
  }
};

const std::vector<LinkTopic>& link_topics() {
  static const std::vector<LinkTopic> all = {
      {"DoorQuestion", false, true},  {"DoorAnswer", true, false},      {"FeedReport", false, true},
      {"FeedState", true, false},     {"TrajectoryBatch", false, true}, {"WeightsUpdate", true, false},
      {"FeederEpisode", false, true}, {"FrameBatch", false, true},      {"ActionBatch", true, false},
  };
  return all;
}

BusConfig link_config(uint64_t link_id) {
  BusConfig config = bus_config_for_run(link_id);
  config.max_participants = kParticipantsOfAHost;
  config.looks_every_second = true;
  return config;
}

LinkBus::LinkBus(std::unique_ptr<State> state) : state_(std::move(state)) {}
LinkBus::LinkBus(LinkBus&&) noexcept = default;
LinkBus& LinkBus::operator=(LinkBus&&) noexcept = default;
LinkBus::~LinkBus() = default;

Expected<LinkBus> LinkBus::open(const BusConfig& config) {
  auto state = std::make_unique<State>();
  COMRAD_TRY_ASSIGN(state->participant,
                    Participant::open(config, link_traits(),
                                      "comrad-link-" + std::to_string(kLinkVersion) + "-" + config.run_id,
                                      "comrad-door-" + config.run_id));
  return LinkBus(std::move(state));
}

Status LinkBus::write(const DoorQuestion& question) {
  if (question.text.size() > kDoorTextBytes)
    return too_long("a question's text", question.text.size(), kDoorTextBytes);
  comrad_wire_DoorQuestion out{};
  out.feeder_id = question.feeder_id;
  out.question_id = question.question_id;
  put(out.text, question.text);
  return state_->participant->write(kQuestion, out);
}

Status LinkBus::write(const DoorAnswer& answer) {
  if (answer.text.size() > kDoorTextBytes)
    return too_long("an answer's text", answer.text.size(), kDoorTextBytes);
  if (answer.payload.size() > kChunkBytes)
    return too_long("an answer's payload", answer.payload.size(), kChunkBytes);
  comrad_wire_DoorAnswer out{};
  out.feeder_id = answer.feeder_id;
  out.question_id = answer.question_id;
  put(out.text, answer.text);
  out.payload = sequence_of<decltype(out.payload)>(std::span(answer.payload.data(), answer.payload.size()));
  return state_->participant->write(kAnswer, out);
}

Status LinkBus::write(const FeedReport& report) {
  comrad_wire_FeedReport out{};
  out.feeder_id = report.feeder_id;
  out.epoch = report.epoch;
  out.beat = report.beat;
  out.fingerprint = report.fingerprint;
  out.slab_bytes = report.slab_bytes;
  out.sim_workers = report.sim_workers;
  out.envs_per_worker = report.envs_per_worker;
  out.is_leaving = report.is_leaving;
  out.weights_version = report.weights_version;
  out.decisions_played = report.decisions_played;
  out.decisions_delivered = report.decisions_delivered;
  out.decisions_lost = report.decisions_lost;
  put(out.host, report.host);
  return state_->participant->write(kReport, out);
}

Status LinkBus::write(const FeedState& state) {
  comrad_wire_FeedState out{};
  out.feeder_id = state.feeder_id;
  out.session = state.session;
  out.epoch = state.epoch;
  out.beat = state.beat;
  put(out.run_state, state.run_state);
  put(out.message, state.message);
  out.done_index = state.done_index;
  out.credit_index = state.credit_index;
  out.schedule_env_frames = state.schedule_env_frames;
  return state_->participant->write(kState, out);
}

Status LinkBus::write(const TrajectoryFragment& fragment) {
  if (fragment.payload.size() > kFragmentPayloadBytes)
    return too_long("a fragment's payload", fragment.payload.size(), kFragmentPayloadBytes);
  comrad_wire_TrajectoryBatch out{};
  out.feeder_id = fragment.feeder_id;
  out.epoch = fragment.epoch;
  out.send_index = fragment.send_index;
  out.fragment_index = fragment.fragment_index;
  out.fragment_count = fragment.fragment_count;
  out.env_index = fragment.env_index;
  out.length = fragment.length;
  out.rollout_index = fragment.rollout_index;
  out.layout_id = fragment.layout_id;
  out.first_episode_id = fragment.first_episode_id;
  out.first_episode_seed = fragment.first_episode_seed;
  out.offset_bytes = fragment.offset_bytes;
  out.raw_bytes = fragment.raw_bytes;
  out.checksum = fragment.checksum;
  out.payload = sequence_of<decltype(out.payload)>(fragment.payload);
  return state_->participant->write(kTrajectory, out);
}

Status LinkBus::write(const WeightsChunk& chunk) {
  if (chunk.payload.size() > kChunkBytes)
    return too_long("a weights chunk", chunk.payload.size(), kChunkBytes);
  comrad_wire_WeightsUpdate out{};
  out.chunk_index = chunk.chunk_index;
  out.chunk_count = chunk.chunk_count;
  out.version = chunk.version;
  out.bytes = chunk.bytes;
  out.checksum = chunk.checksum;
  out.bf16_count = chunk.bf16_count;
  out.payload = sequence_of<decltype(out.payload)>(chunk.payload);
  return state_->participant->write(kWeights, out);
}

Status LinkBus::write(const FeederEpisode& episode) {
  comrad_wire_FeederEpisode out{};
  out.feeder_id = episode.feeder_id;
  out.record = wire_of(episode.record);
  return state_->participant->write(kEpisode, out);
}

Status LinkBus::write(const FrameBatch& batch) {
  if (batch.payload.size() > kFrameBatchBytes)
    return too_long("a batch of frames", batch.payload.size(), kFrameBatchBytes);
  comrad_wire_FrameBatch out{};
  out.feeder_id = batch.feeder_id;
  out.epoch = batch.epoch;
  out.batch_index = batch.batch_index;
  out.fingerprint = batch.fingerprint;
  out.slab_bytes = batch.slab_bytes;
  out.sim_workers = batch.sim_workers;
  out.envs_per_worker = batch.envs_per_worker;
  out.is_leaving = batch.is_leaving;
  out.request_count = batch.request_count;
  out.raw_bytes = batch.raw_bytes;
  out.is_compressed = batch.is_compressed;
  out.checksum = batch.checksum;
  put(out.host, batch.host);
  out.payload = sequence_of<decltype(out.payload)>(batch.payload);
  return state_->participant->write(kFrames, out);
}

Status LinkBus::write(const ActionBatch& batch) {
  if (batch.payload.size() > kChunkBytes)
    return too_long("a batch of actions", batch.payload.size(), kChunkBytes);
  comrad_wire_ActionBatch out{};
  out.feeder_id = batch.feeder_id;
  out.session = batch.session;
  out.epoch = batch.epoch;
  out.batch_index = batch.batch_index;
  put(out.run_state, batch.run_state);
  put(out.message, batch.message);
  out.credit_index = batch.credit_index;
  out.schedule_env_frames = batch.schedule_env_frames;
  out.payload = sequence_of<decltype(out.payload)>(batch.payload);
  return state_->participant->write(kActions, out);
}

void LinkBus::take_questions(const std::function<void(const DoorQuestion&)>& visit) {
  state_->take<comrad_wire_DoorQuestion>(kQuestion, [&](const auto& in) {
    visit({.feeder_id = in.feeder_id, .question_id = in.question_id, .text = get(in.text)});
  });
}

void LinkBus::take_answers(const std::function<void(const DoorAnswer&)>& visit) {
  state_->take<comrad_wire_DoorAnswer>(kAnswer, [&](const auto& in) {
    const std::span<const std::byte> payload = bytes_of(in.payload);
    visit({.feeder_id = in.feeder_id,
           .question_id = in.question_id,
           .text = get(in.text),
           .payload = std::string(reinterpret_cast<const char*>(payload.data()), payload.size())});
  });
}

void LinkBus::take_reports(const std::function<void(const FeedReport&)>& visit) {
  state_->take<comrad_wire_FeedReport>(kReport, [&](const auto& in) {
    visit({.feeder_id = in.feeder_id,
           .epoch = in.epoch,
           .beat = in.beat,
           .fingerprint = in.fingerprint,
           .slab_bytes = in.slab_bytes,
           .sim_workers = in.sim_workers,
           .envs_per_worker = in.envs_per_worker,
           .is_leaving = in.is_leaving,
           .weights_version = in.weights_version,
           .decisions_played = in.decisions_played,
           .decisions_delivered = in.decisions_delivered,
           .decisions_lost = in.decisions_lost,
           .host = get(in.host)});
  });
}

void LinkBus::take_states(uint64_t feeder_id, const std::function<void(const FeedState&)>& visit) {
  state_->take<comrad_wire_FeedState>(kState, [&](const auto& in) {
    if (in.feeder_id != feeder_id) return;
    visit({.feeder_id = in.feeder_id,
           .session = in.session,
           .epoch = in.epoch,
           .beat = in.beat,
           .run_state = get(in.run_state),
           .message = get(in.message),
           .done_index = in.done_index,
           .credit_index = in.credit_index,
           .schedule_env_frames = in.schedule_env_frames});
  });
}

void LinkBus::take_fragments(const std::function<void(const TrajectoryFragment&)>& visit) {
  state_->take<comrad_wire_TrajectoryBatch>(kTrajectory, [&](const auto& in) {
    visit({.feeder_id = in.feeder_id,
           .epoch = in.epoch,
           .send_index = in.send_index,
           .fragment_index = in.fragment_index,
           .fragment_count = in.fragment_count,
           .env_index = in.env_index,
           .length = in.length,
           .rollout_index = in.rollout_index,
           .layout_id = in.layout_id,
           .first_episode_id = in.first_episode_id,
           .first_episode_seed = in.first_episode_seed,
           .offset_bytes = in.offset_bytes,
           .raw_bytes = in.raw_bytes,
           .checksum = in.checksum,
           .payload = bytes_of(in.payload)});
  });
}

void LinkBus::take_weights(const std::function<void(const WeightsChunk&)>& visit) {
  state_->take<comrad_wire_WeightsUpdate>(kWeights, [&](const auto& in) {
    visit({.chunk_index = in.chunk_index,
           .chunk_count = in.chunk_count,
           .version = in.version,
           .bytes = in.bytes,
           .checksum = in.checksum,
           .bf16_count = in.bf16_count,
           .payload = bytes_of(in.payload)});
  });
}

void LinkBus::take_episodes(const std::function<void(const FeederEpisode&)>& visit) {
  state_->take<comrad_wire_FeederEpisode>(
      kEpisode, [&](const auto& in) { visit({.feeder_id = in.feeder_id, .record = record_of(in.record)}); });
}

void LinkBus::take_frames(const std::function<void(const FrameBatch&)>& visit) {
  state_->take<comrad_wire_FrameBatch>(kFrames, [&](const auto& in) {
    visit({.feeder_id = in.feeder_id,
           .epoch = in.epoch,
           .batch_index = in.batch_index,
           .fingerprint = in.fingerprint,
           .slab_bytes = in.slab_bytes,
           .sim_workers = in.sim_workers,
           .envs_per_worker = in.envs_per_worker,
           .is_leaving = in.is_leaving,
           .request_count = in.request_count,
           .raw_bytes = in.raw_bytes,
           .is_compressed = in.is_compressed,
           .checksum = in.checksum,
           .host = get(in.host),
           .payload = bytes_of(in.payload)});
  });
}

void LinkBus::take_actions(uint64_t feeder_id, const std::function<void(const ActionBatch&)>& visit) {
  state_->take<comrad_wire_ActionBatch>(kActions, [&](const auto& in) {
    if (in.feeder_id != feeder_id) return;
    visit({.feeder_id = in.feeder_id,
           .session = in.session,
           .epoch = in.epoch,
           .batch_index = in.batch_index,
           .run_state = get(in.run_state),
           .message = get(in.message),
           .credit_index = in.credit_index,
           .schedule_env_frames = in.schedule_env_frames,
           .payload = bytes_of(in.payload)});
  });
}

bool LinkBus::has_sent_weights() const { return state_->participant->is_acknowledged(kWeights); }

bool LinkBus::wait(int timeout_ms) { return state_->participant->wait(timeout_ms); }

}  // namespace comrad::dds
