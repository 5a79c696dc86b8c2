#include "rollout_buffer/dds/cyclone_carrier.h"

#include <comrad.h>
#include <dds/dds.h>
#include <spdlog/fmt/fmt.h>

#include <array>
#include <charconv>
#include <cstring>
#include <type_traits>
#include <utility>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/dds/domain.h"
#include "rollout_buffer/dds/keys.h"
#include "rollout_buffer/dds/unknown_peers.h"

namespace comrad::dds {
namespace {

constexpr dds_duration_t kMaxBlocking = DDS_MSECS(100);  // of a write whose readers do not keep up
constexpr std::string_view kPartition = "comrad-link-";  // then the version and the run's id
constexpr std::string_view kJoinPartition = "comrad-door-";

/// How a topic travels. All are reliable.
struct TopicTraits {
  const char* name;
  KeyRole writer;
  std::size_t most_payload_bytes = 0;
  bool is_kept_for_late_joiners = false;  ///< transient-local
  int history = 1;                        ///< keep-last; 0: every sample counts
  int sample_limit = 0;       ///< of a reader or writer that keeps all; what comes beyond waits at the writer
  bool is_for_joins = false;  ///< in a partition that is the same for all versions
};

/// By Topic. Names are part of the permissions that keys hold: a new one needs new keys.
constexpr std::array<TopicTraits, kTopicCount> kTraits = {{
    {.name = "DoorQuestion", .writer = KeyRole::kHost, .history = 64, .is_for_joins = true},
    {.name = "DoorAnswer",
     .writer = KeyRole::kRun,
     .most_payload_bytes = kChunkBytes,
     .history = 64,
     .is_for_joins = true},
    {.name = "FeedReport", .writer = KeyRole::kHost, .is_kept_for_late_joiners = true},
    {.name = "FeedState", .writer = KeyRole::kRun, .is_kept_for_late_joiners = true},
    {.name = "TrajectoryBatch",
     .writer = KeyRole::kHost,
     .most_payload_bytes = kFragmentPayloadBytes,
     .history = 0,
     .sample_limit = 256},
    {.name = "WeightsUpdate",
     .writer = KeyRole::kRun,
     .most_payload_bytes = kChunkBytes,
     .is_kept_for_late_joiners = true},
    {.name = "PeerEpisode", .writer = KeyRole::kHost, .history = 4096},
    {.name = "FrameBatch",
     .writer = KeyRole::kHost,
     .most_payload_bytes = kFrameBatchBytes,
     .history = 0,
     .sample_limit = 64},  // of 256 kB as a rule
    {.name = "ActionBatch",
     .writer = KeyRole::kRun,
     .most_payload_bytes = kChunkBytes,
     .history = 0,
     .sample_limit = 1024},
    {.name = "WorkerStatus", .writer = KeyRole::kRun, .is_kept_for_late_joiners = true},
    {.name = "TrainStats", .writer = KeyRole::kRun, .is_kept_for_late_joiners = true},
    {.name = "EpisodeResult", .writer = KeyRole::kRun, .most_payload_bytes = kScenarioBytes, .history = 1000},
}};

const TopicTraits& traits_of(Topic topic) { return kTraits[static_cast<std::size_t>(topic)]; }

/// Calls `use` with an empty sample of a topic's type, and the type.
template <typename Use>
auto with_sample_of(Topic topic, Use use) {
  switch (topic) {
    case Topic::kQuestion:
      return use(comrad_wire_DoorQuestion{}, comrad_wire_DoorQuestion_desc);
    case Topic::kAnswer:
      return use(comrad_wire_DoorAnswer{}, comrad_wire_DoorAnswer_desc);
    case Topic::kTrajectory:
      return use(comrad_wire_Fragment{}, comrad_wire_Fragment_desc);
    case Topic::kWeights:
    case Topic::kActions:
      return use(comrad_wire_Chunk{}, comrad_wire_Chunk_desc);
    case Topic::kFrames:
      return use(comrad_wire_Frames{}, comrad_wire_Frames_desc);
    case Topic::kWorker:
    case Topic::kTrainStats:
    case Topic::kEpisodeResult:
      return use(comrad_wire_Report{}, comrad_wire_Report_desc);
    case Topic::kReport:
    case Topic::kState:
    case Topic::kEpisode:
      break;
  }
  return use(comrad_wire_Note{}, comrad_wire_Note_desc);
}

/// A sequence that Cyclone only reads while it writes a sample.
template <typename Sequence>
void point_to(std::span<const std::byte> bytes, Sequence& sequence) {
  sequence._length = sequence._maximum = static_cast<uint32_t>(bytes.size());
  sequence._buffer = reinterpret_cast<uint8_t*>(const_cast<std::byte*>(bytes.data()));
}

template <typename Sequence>
std::span<const std::byte> bytes_of(const Sequence& sequence) {
  return {reinterpret_cast<const std::byte*>(sequence._buffer), sequence._length};
}

dds_qos_t* make_qos(const TopicTraits& traits) {
  dds_qos_t* qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, kMaxBlocking);
  dds_qset_history(qos, traits.history > 0 ? DDS_HISTORY_KEEP_LAST : DDS_HISTORY_KEEP_ALL, traits.history);
  if (traits.sample_limit > 0)
    dds_qset_resource_limits(qos, traits.sample_limit, DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
  dds_qset_durability(
      qos, traits.is_kept_for_late_joiners ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE);
  if (traits.is_kept_for_late_joiners)
    dds_qset_durability_service(qos, 0, DDS_HISTORY_KEEP_LAST, traits.history, DDS_LENGTH_UNLIMITED,
                                DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
  dds_qset_writer_data_lifecycle(qos, /*autodispose=*/false);
  return qos;
}

class CycloneCarrier final : public LinkCarrier {
 public:
  explicit CycloneCarrier(const BusConfig& config) : config_(config) {}
  CycloneCarrier(const CycloneCarrier&) = delete;
  CycloneCarrier& operator=(const CycloneCarrier&) = delete;
  ~CycloneCarrier() override {
    if (participant_ > 0) dds_delete(participant_);
    if (is_in_domain_) leave_domain(config_.domain_id);
  }

  Status start(uint32_t version) {
    COMRAD_TRY(validate(config_));
    COMRAD_TRY(enter_domain(config_));
    is_in_domain_ = true;
    participant_ = dds_create_participant(config_.domain_id, nullptr, nullptr);
    if (participant_ < 0) return error(participant_, "make a participant");
    const std::string of_links = fmt::format("{}{}-{}", kPartition, version, config_.run_id),
                      of_joins = fmt::format("{}{}", kJoinPartition, config_.run_id);
    for (const bool is_for_joins : {false, true}) {
      const char* name = (is_for_joins ? of_joins : of_links).c_str();
      dds_qos_t* qos = dds_create_qos();
      dds_qset_partition(qos, 1, &name);
      publisher_[is_for_joins] = dds_create_publisher(participant_, qos, nullptr);
      subscriber_[is_for_joins] = dds_create_subscriber(participant_, qos, nullptr);
      dds_delete_qos(qos);
      if (publisher_[is_for_joins] < 0) return error(publisher_[is_for_joins], "make a publisher");
      if (subscriber_[is_for_joins] < 0) return error(subscriber_[is_for_joins], "make a subscriber");
    }
    waitset_ = dds_create_waitset(participant_);
    if (waitset_ < 0) return error(waitset_, "make a wait set");
    if (!config_.key_folder.empty()) unknown_peers_ = std::make_unique<UnknownPeers>(participant_);
    return {};
  }

  Status write(Topic topic, uint64_t key, std::span<const std::byte> head,
               std::span<const std::byte> payload) override {
    const TopicTraits& traits = traits_of(topic);
    if (payload.size() > traits.most_payload_bytes)
      return Error{ErrorCode::kBadInput, fmt::format("a payload of {} of {} bytes; at most {}", traits.name,
                                                     payload.size(), traits.most_payload_bytes)};
    COMRAD_TRY_ASSIGN(const dds_entity_t writer, end_of(topic, /*is_writer=*/true));
    const dds_return_t code = with_sample_of(topic, [&](auto out, const auto&) {
      if constexpr (requires { out.head; }) {
        out.key = key;
        point_to(head, out.head);
      } else {
        out.sender_id = key;
        std::memcpy(&out.question_id, head.data(), sizeof out.question_id);
        std::memcpy(out.text, head.data() + sizeof out.question_id, head.size() - sizeof out.question_id);
      }
      if constexpr (requires { out.payload; }) point_to(payload, out.payload);
      return dds_write(writer, &out);
    });
    return code < 0 ? Status(error(code, std::string("write ") + traits.name)) : Status();
  }

  void take(Topic topic, const Visitor& visit) override {
    const Expected<dds_entity_t> reader = end_of(topic, /*is_writer=*/false);
    if (!reader) return spdlog::warn("{}", reader.error().message);
    with_sample_of(topic, [&]<typename Wire>(const Wire&, const auto&) {
      take_all(*reader, [&](const void* sample, const dds_sample_info_t& info) {
        if (!info.valid_data) return;
        const auto& in = *static_cast<const Wire*>(sample);
        std::span<const std::byte> payload;
        if constexpr (requires { in.payload; }) payload = bytes_of(in.payload);
        if constexpr (requires { in.head; }) {
          visit(in.key, bytes_of(in.head), payload);
        } else {
          std::vector<std::byte> head(sizeof in.question_id + strnlen(in.text, sizeof in.text));
          std::memcpy(head.data(), &in.question_id, sizeof in.question_id);
          std::memcpy(head.data() + sizeof in.question_id, in.text, head.size() - sizeof in.question_id);
          visit(in.sender_id, head, payload);
        }
      });
    });
  }

  bool is_acknowledged(Topic topic) const override {
    const dds_entity_t writer = ends_[static_cast<std::size_t>(topic)].writer;
    return writer <= 0 || dds_wait_for_acks(writer, 0) == DDS_RETCODE_OK;
  }

  bool wait(int timeout_ms) override {
    if (unknown_peers_ != nullptr) unknown_peers_->look();
    dds_attach_t ready[1];
    return dds_waitset_wait(waitset_, ready, 1, DDS_MSECS(timeout_ms)) > 0;
  }

  SeenRun seen() const override {
    SeenRun seen;
    visit_ends(DDS_BUILTIN_TOPIC_DCPSSUBSCRIPTION, [&](std::string_view topic, uint32_t) {
      seen.serves |= topic == traits_of(Topic::kReport).name;
    });
    visit_ends(DDS_BUILTIN_TOPIC_DCPSPUBLICATION, [&](std::string_view topic, uint32_t version) {
      if (topic == traits_of(Topic::kWorker).name) seen.published_versions.push_back(version);
    });
    return seen;
  }

 private:
  struct Ends {
    dds_entity_t topic = 0, writer = 0, reader = 0;
  };

  Error error(dds_return_t code, const std::string& what) const {
    if (code == DDS_RETCODE_NOT_ALLOWED_BY_SECURITY)
      return Error{ErrorCode::kBadInput,
                   "DDS: cannot " + what + ": " + config_.key_folder +
                       "/permissions.p7s does not allow it; `comrad keys show` names the host of these keys"};
    return dds_error(code, what, config_);
  }

  Expected<dds_entity_t> end_of(Topic topic, bool is_writer) {
    Ends& ends = ends_[static_cast<std::size_t>(topic)];
    dds_entity_t& end = is_writer ? ends.writer : ends.reader;
    if (end > 0) return end;
    const TopicTraits& traits = traits_of(topic);
    if (ends.topic <= 0)
      ends.topic = with_sample_of(topic, [&](const auto&, const dds_topic_descriptor_t& type) {
        return dds_create_topic(participant_, &type, traits.name, nullptr, nullptr);
      });
    if (ends.topic < 0) return error(ends.topic, std::string("make topic ") + traits.name);
    dds_qos_t* qos = make_qos(traits);
    const dds_entity_t made =
        is_writer ? dds_create_writer(publisher_[traits.is_for_joins], ends.topic, qos, nullptr)
                  : dds_create_reader(subscriber_[traits.is_for_joins], ends.topic, qos, nullptr);
    dds_delete_qos(qos);
    if (made < 0)
      return error(made, fmt::format("make a {} of {}", is_writer ? "writer" : "reader", traits.name));
    if (is_writer) return end = made;
    const dds_entity_t condition = dds_create_readcondition(made, DDS_ANY_STATE);
    const dds_return_t attached =
        condition < 0 ? condition : dds_waitset_attach(waitset_, condition, condition);
    if (attached < 0) {
      dds_delete(made);
      return error(attached, std::string("wait for ") + traits.name);
    }
    return end = made;
  }

  /// Calls `visit(topic, version)` for each writer or reader of a link that discovery shows.
  template <typename Visit>
  void visit_ends(dds_entity_t kind, Visit visit) const {
    const dds_entity_t reader = dds_create_reader(participant_, kind, nullptr, nullptr);
    take_all(reader, [&](const void* sample, const dds_sample_info_t& info) {
      const auto& end = *static_cast<const dds_builtintopic_endpoint_t*>(sample);
      uint32_t count = 0, version = 0;
      char** names = nullptr;
      if (info.instance_state != DDS_IST_ALIVE || !info.valid_data || end.qos == nullptr ||
          !dds_qget_partition(end.qos, &count, &names))
        return;
      const std::string_view partition = count > 0 ? names[0] : "";
      if (partition.starts_with(kPartition) &&
          std::from_chars(partition.data() + kPartition.size(), partition.data() + partition.size(), version)
                  .ec == std::errc())
        visit(end.topic_name, version);
      for (uint32_t i = 0; i < count; ++i) dds_free(names[i]);
      dds_free(names);
    });
    if (reader > 0) dds_delete(reader);
  }

  const BusConfig config_;
  bool is_in_domain_ = false;
  dds_entity_t participant_ = 0, waitset_ = 0;
  dds_entity_t publisher_[2] = {}, subscriber_[2] = {};  // of links, and of joins
  std::array<Ends, kTopicCount> ends_ = {};
  std::unique_ptr<UnknownPeers> unknown_peers_;  // where there are keys
};

}  // namespace

const std::vector<LinkTopic>& link_topics() {
  static const std::vector<LinkTopic> all = [] {
    std::vector<LinkTopic> topics;
    for (const TopicTraits& traits : kTraits) topics.push_back({traits.name, traits.writer});
    return topics;
  }();
  return all;
}

Expected<std::unique_ptr<LinkCarrier>> open_cyclone_carrier(const BusConfig& config, uint32_t version) {
  auto carrier = std::make_unique<CycloneCarrier>(config);
  COMRAD_TRY(carrier->start(version));
  return std::unique_ptr<LinkCarrier>(std::move(carrier));
}

}  // namespace comrad::dds
