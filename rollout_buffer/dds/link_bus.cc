#include "rollout_buffer/dds/link_bus.h"

#include <spdlog/fmt/fmt.h>

#include <comrad.h>

#include <array>
#include <cstring>
#include <utility>

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

struct LinkTraits {
  std::size_t most_payload_bytes;
  bool is_written_by_run;
  TopicTraits topic;
};

/// By Topic. Names are part of the permissions that keys hold: a new one needs new keys.
const std::array<LinkTraits, 9>& link_traits() {
  static const std::array<LinkTraits, 9> all = {{
      {0,
       false,
       {.name = "DoorQuestion",
        .type = &comrad_wire_DoorQuestion_desc,
        .history = kQuestionHistory,
        .is_separate = true}},
      {kChunkBytes,
       true,
       {.name = "DoorAnswer",
        .type = &comrad_wire_DoorAnswer_desc,
        .history = kQuestionHistory,
        .is_separate = true}},
      {0, false, {.name = "FeedReport", .type = &comrad_wire_Note_desc, .is_kept_for_late_joiners = true}},
      {0, true, {.name = "FeedState", .type = &comrad_wire_Note_desc, .is_kept_for_late_joiners = true}},
      {kFragmentPayloadBytes,
       false,
       {.name = "TrajectoryBatch",
        .type = &comrad_wire_Fragment_desc,
        .history = 0,
        .sample_limit = kFragmentLimit}},
      {kChunkBytes,
       true,
       {.name = "WeightsUpdate", .type = &comrad_wire_Chunk_desc, .is_kept_for_late_joiners = true}},
      {0, false, {.name = "PeerEpisode", .type = &comrad_wire_Note_desc, .history = kLinkEpisodeHistory}},
      {kFrameBatchBytes,
       false,
       {.name = "FrameBatch", .type = &comrad_wire_Frames_desc, .history = 0, .sample_limit = kFrameLimit}},
      {kChunkBytes,
       true,
       {.name = "ActionBatch", .type = &comrad_wire_Chunk_desc, .history = 0, .sample_limit = kActionLimit}},
  }};
  return all;
}

template <typename Sequence>
std::span<const std::byte> bytes_of(const Sequence& sequence) {
  return {reinterpret_cast<const std::byte*>(sequence._buffer), sequence._length};
}

/// Calls `use` with a null pointer to the wire's type of a topic; questions and answers have their own.
template <typename Use>
auto with_type_of(Topic topic, Use use) {
  switch (topic) {
    case Topic::kTrajectory:
      return use(static_cast<comrad_wire_Fragment*>(nullptr));
    case Topic::kWeights:
    case Topic::kActions:
      return use(static_cast<comrad_wire_Chunk*>(nullptr));
    case Topic::kFrames:
      return use(static_cast<comrad_wire_Frames*>(nullptr));
    default:
      return use(static_cast<comrad_wire_Note*>(nullptr));
  }
}

class CycloneCarrier final : public LinkCarrier {
 public:
  static Expected<std::unique_ptr<LinkCarrier>> open(const BusConfig& config) {
    auto carrier = std::make_unique<CycloneCarrier>();
    for (const LinkTraits& traits : link_traits()) carrier->topics_.push_back(traits.topic);
    COMRAD_TRY_ASSIGN(carrier->participant_,
                      Participant::open(config, carrier->topics_,
                                        fmt::format("comrad-link-{}-{}", kLinkVersion, config.run_id),
                                        "comrad-door-" + config.run_id));
    return std::unique_ptr<LinkCarrier>(std::move(carrier));
  }

  Status write(Topic topic, uint64_t key, std::span<const std::byte> head,
               std::span<const std::byte> payload) override {
    const LinkTraits& traits = link_traits()[static_cast<std::size_t>(topic)];
    if (payload.size() > traits.most_payload_bytes)
      return Error{ErrorCode::kBadInput,
                   fmt::format("a payload of {} of {} bytes; at most {}", traits.topic.name, payload.size(),
                               traits.most_payload_bytes)};
    if (topic == Topic::kQuestion) return write_door<comrad_wire_DoorQuestion>(topic, key, head, payload);
    if (topic == Topic::kAnswer) return write_door<comrad_wire_DoorAnswer>(topic, key, head, payload);
    return with_type_of(topic, [&]<typename Wire>(Wire*) {
      Wire out{};
      out.key = key;
      out.head = sequence_of<decltype(out.head)>(head);
      out.payload = sequence_of<decltype(out.payload)>(payload);
      return participant_->write(static_cast<int>(topic), out);
    });
  }

  void take(Topic topic, const Visitor& visit) override {
    const auto take_all = [&]<typename Wire>(Wire*) {
      participant_->take<Wire>(static_cast<int>(topic), [&](const Wire& in, const dds_sample_info_t& info) {
        if (!info.valid_data) return;
        if constexpr (requires { in.head; }) {
          visit(in.key, bytes_of(in.head), bytes_of(in.payload));
        } else {
          std::vector<std::byte> head(sizeof in.question_id + strnlen(in.text, sizeof in.text));
          std::memcpy(head.data(), &in.question_id, sizeof in.question_id);
          std::memcpy(head.data() + sizeof in.question_id, in.text, head.size() - sizeof in.question_id);
          if constexpr (requires { in.payload; })
            visit(in.feeder_id, head, bytes_of(in.payload));
          else
            visit(in.feeder_id, head, {});
        }
      });
    };
    if (topic == Topic::kQuestion) return take_all(static_cast<comrad_wire_DoorQuestion*>(nullptr));
    if (topic == Topic::kAnswer) return take_all(static_cast<comrad_wire_DoorAnswer*>(nullptr));
    with_type_of(topic, take_all);
  }

  bool is_acknowledged(Topic topic) const override {
    return participant_->is_acknowledged(static_cast<int>(topic));
  }
  bool wait(int timeout_ms) override { return participant_->wait(timeout_ms); }

 private:
  /// `head` is the question's id and its text.
  template <typename Wire>
  Status write_door(Topic topic, uint64_t key, std::span<const std::byte> head,
                    std::span<const std::byte> payload) {
    auto out = std::make_unique<Wire>();
    const std::span<const std::byte> text = head.subspan(sizeof out->question_id);
    if (text.size() > kQuestionBytes)
      return Error{ErrorCode::kBadInput, fmt::format("a question's or answer's text of {} bytes; at most {}",
                                                     text.size(), kQuestionBytes)};
    out->feeder_id = key;
    std::memcpy(&out->question_id, head.data(), sizeof out->question_id);
    std::memcpy(out->text, text.data(), text.size());
    if constexpr (requires { out->payload; }) out->payload = sequence_of<decltype(out->payload)>(payload);
    return participant_->write(static_cast<int>(topic), *out);
  }

  std::vector<TopicTraits> topics_;
  std::unique_ptr<Participant> participant_;
};

std::vector<std::byte> door_head(uint32_t question_id, const std::string& text) {
  std::vector<std::byte> head(sizeof question_id + text.size());
  std::memcpy(head.data(), &question_id, sizeof question_id);
  std::memcpy(head.data() + sizeof question_id, text.data(), text.size());
  return head;
}

/// A JoinQuestion or JoinAnswer without its payload.
template <typename Message>
Message door_message(uint64_t key, std::span<const std::byte> head) {
  Message message{.peer_id = key};
  if (head.size() < sizeof message.question_id) return message;
  std::memcpy(&message.question_id, head.data(), sizeof message.question_id);
  const auto text = head.subspan(sizeof message.question_id);
  message.text.assign(reinterpret_cast<const char*>(text.data()), text.size());
  return message;
}

}  // namespace

const std::vector<LinkTopic>& link_topics() {
  static const std::vector<LinkTopic> all = [] {
    std::vector<LinkTopic> topics;
    for (const LinkTraits& traits : link_traits())
      topics.push_back({traits.topic.name, traits.is_written_by_run, !traits.is_written_by_run});
    return topics;
  }();
  return all;
}

BusConfig link_config(uint64_t link_id) {
  BusConfig config = bus_config_for_run(link_id);
  config.max_participants = kParticipantsOfAHost;
  config.looks_every_second = true;
  return config;
}

Words::Words(std::string_view text) { put(bytes_, std::string(text)); }
std::string Words::str() const { return get(bytes_); }

Expected<LinkBus> LinkBus::open(const BusConfig& config) {
  COMRAD_TRY_ASSIGN(std::unique_ptr<LinkCarrier> carrier, CycloneCarrier::open(config));
  return LinkBus(std::move(carrier));
}

Status LinkBus::write(const JoinQuestion& question) {
  return carrier_->write(Topic::kQuestion, question.peer_id, door_head(question.question_id, question.text),
                         {});
}

Status LinkBus::write(const JoinAnswer& answer) {
  return carrier_->write(Topic::kAnswer, answer.peer_id, door_head(answer.question_id, answer.text),
                         std::as_bytes(std::span(answer.payload)));
}

void LinkBus::take_questions(const std::function<void(const JoinQuestion&)>& visit) {
  carrier_->take(Topic::kQuestion,
                 [&](uint64_t key, std::span<const std::byte> head, std::span<const std::byte>) {
                   visit(door_message<JoinQuestion>(key, head));
                 });
}

void LinkBus::take_answers(const std::function<void(const JoinAnswer&)>& visit) {
  carrier_->take(Topic::kAnswer,
                 [&](uint64_t key, std::span<const std::byte> head, std::span<const std::byte> payload) {
                   auto answer = door_message<JoinAnswer>(key, head);
                   answer.payload.assign(reinterpret_cast<const char*>(payload.data()), payload.size());
                   visit(answer);
                 });
}

}  // namespace comrad::dds
