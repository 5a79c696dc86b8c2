#include "rollout_buffer/dds/bus.h"

#include <comrad.h>
#include <dds/dds.h>
#include <dirent.h>
#include <ifaddrs.h>
#include <linux/filter.h>
#include <net/if.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <mutex>
#include <set>
#include <utility>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/rng.h"

namespace comrad::dds {
namespace {

constexpr int kBusVersion = 3;  // part of the partition: builds that disagree on comrad.idl do not meet
constexpr int kMaxParticipantIndex = 119;
constexpr uint32_t kDomainCount = 100;
constexpr uint32_t kPortBase = 7400;  // RTPS: two ports per participant from kPortBase + 250 * domain + 10
constexpr uint32_t kPortsPerDomain = 250;
constexpr dds_duration_t kLiveliness = DDS_SECS(2);
constexpr dds_duration_t kMaxBlocking = DDS_MSECS(100);  // of a write whose readers do not keep up
constexpr int kEpisodeHistory = 1000;
constexpr int kTakeAtOnce = 32;
constexpr std::size_t kMaxPending =
    4096;  // statuses kept for a caller that only asks who was lost, or the reverse

std::string what_to_check(uint32_t domain_id) {
  const uint32_t first_port = kPortBase + kPortsPerDomain * domain_id;
  return "; check that loopback is up (`ip addr show lo`), that UDP ports " + std::to_string(first_port) +
         "-" + std::to_string(first_port + 11 + 2 * kMaxParticipantIndex) +
         " of 127.0.0.1 are not filtered, and that at most " + std::to_string(kMaxParticipantIndex + 1) +
         " processes of this host use DDS domain " + std::to_string(domain_id);
}

Error dds_error(dds_return_t code, const std::string& what, uint32_t domain_id) {
  return Error{ErrorCode::kSystem, "DDS: cannot " + what + ": " + dds_strretcode(code) + " (" +
                                       std::to_string(code) + ")" + what_to_check(domain_id)};
}

// Cyclone's own complaints go where ours go. Its lines end in a newline.
void log_cyclone(void*, const dds_log_data_t* data) {
  std::string_view text(data->message, data->size);
  while (!text.empty() && (text.back() == '\n' || text.back() == '\0')) text.remove_suffix(1);
  if (data->priority & (DDS_LC_FATAL | DDS_LC_ERROR)) {
    spdlog::error("cyclonedds: {}", text);
  } else {
    spdlog::warn("cyclonedds: {}", text);
  }
}

bool is_plain_word(const std::string& word) {
  return !word.empty() && word.size() <= 64 && std::all_of(word.begin(), word.end(), [](unsigned char c) {
    return std::isalnum(c) || c == '_' || c == '-' || c == '.' || c == ':';
  });
}

bool is_loopback(const std::string& interface_name) {
  ifaddrs* all = nullptr;
  if (getifaddrs(&all) != 0) return false;
  bool found = false;
  for (const ifaddrs* one = all; one != nullptr; one = one->ifa_next) {
    if (interface_name == one->ifa_name && (one->ifa_flags & IFF_LOOPBACK)) found = true;
  }
  freeifaddrs(all);
  return found;
}

// Lets only packets from 127.0.0.0/8 through to a socket; needs no privilege on any kernel.
bool drop_packets_from_elsewhere(int descriptor) {
  sock_filter program[] = {
      {BPF_LD | BPF_W | BPF_ABS, 0, 0, static_cast<uint32_t>(SKF_NET_OFF + 12)},  // source address
      {BPF_ALU | BPF_AND | BPF_K, 0, 0, 0xFF000000},
      {BPF_JMP | BPF_JEQ | BPF_K, 0, 1, 0x7F000000},
      {BPF_RET | BPF_K, 0, 0, 0xFFFFFFFF},
      {BPF_RET | BPF_K, 0, 0, 0},
  };
  const sock_fprog filter = {.len = std::size(program), .filter = program};
  return setsockopt(descriptor, SOL_SOCKET, SO_ATTACH_FILTER, &filter, sizeof filter) == 0;
}

// Cyclone 0.10 sends from the interface it is told but binds its receive sockets to 0.0.0.0, whatever the
// configuration says. Ties those of `domain_id` to the loopback device.
Status keep_sockets_on(const std::string& interface_name, uint32_t domain_id) {
  const int first_port = static_cast<int>(kPortBase + kPortsPerDomain * domain_id);
  DIR* descriptors = opendir("/proc/self/fd");
  if (descriptors == nullptr) {
    return Error{ErrorCode::kSystem, "DDS: cannot list /proc/self/fd; check that /proc is mounted"};
  }
  Status status;
  while (const dirent* entry = readdir(descriptors)) {
    const int descriptor = std::atoi(entry->d_name);
    sockaddr_in address{};
    socklen_t size = sizeof address;
    if (entry->d_name[0] == '.' || getsockname(descriptor, reinterpret_cast<sockaddr*>(&address), &size) != 0)
      continue;
    const int port = ntohs(address.sin_port);
    if (address.sin_family != AF_INET || address.sin_addr.s_addr != htonl(INADDR_ANY) || port < first_port ||
        port >= first_port + static_cast<int>(kPortsPerDomain)) {
      continue;
    }
    const bool is_bound = setsockopt(descriptor, SOL_SOCKET, SO_BINDTODEVICE, interface_name.c_str(),
                                     static_cast<socklen_t>(interface_name.size() + 1)) == 0;
    if (!is_bound && !drop_packets_from_elsewhere(descriptor)) {
      status = Error{ErrorCode::kSystem, "DDS: cannot keep UDP port " + std::to_string(port) + " on " +
                                             interface_name + ": " + std::strerror(errno) +
                                             "; Linux 5.7 or newer allows it without privileges"};
    }
  }
  closedir(descriptors);
  return status;
}

// A process has one Cyclone domain object per domain id, made with the configuration of whoever came
// first; buses of the same run share it, and the last one to go deletes it and with it Cyclone's threads
// and sockets.
struct DomainUse {
  dds_entity_t entity = 0;
  std::string uri;
  int count = 0;
};
std::mutex domains_mutex;
std::map<uint32_t, DomainUse>& domains() {
  static auto* all = new std::map<uint32_t, DomainUse>();  // never destroyed: a bus may live in a static
  return *all;
}

Status enter_domain(const BusConfig& config) {
  const std::lock_guard lock(domains_mutex);
  DomainUse& use = domains()[config.domain_id];
  if (use.count > 0 && use.uri != config.uri) {
    return Error{ErrorCode::kBadInput,
                 "DDS domain " + std::to_string(config.domain_id) +
                     " is used by another run in this process; one process joins one run"};
  }
  if (use.count == 0) {
    dds_set_log_sink(&log_cyclone, nullptr);
    use.entity = dds_create_domain(config.domain_id, config.uri.c_str());
    if (use.entity < 0)
      return dds_error(use.entity, "start domain " + std::to_string(config.domain_id), config.domain_id);
    if (Status kept = keep_sockets_on(config.interface_name, config.domain_id); !kept) {
      dds_delete(use.entity);
      return kept.error();
    }
    use.uri = config.uri;
  }
  ++use.count;
  return {};
}

void leave_domain(uint32_t domain_id) {
  const std::lock_guard lock(domains_mutex);
  DomainUse& use = domains()[domain_id];
  if (--use.count == 0) dds_delete(use.entity);
}

// Copies into a bounded wire string and cuts what does not fit, never inside a UTF-8 character.
template <std::size_t size>
void put(char (&out)[size], const std::string& text) {
  std::size_t length = std::min(text.size(), size - 1);
  if (length < text.size()) {
    while (length > 0 && (static_cast<unsigned char>(text[length]) & 0xC0) == 0x80) --length;
  }
  std::memcpy(out, text.data(), length);
  out[length] = '\0';
}

template <std::size_t size>
std::string get(const char (&in)[size]) {
  return std::string(in, strnlen(in, size));
}

dds_sequence_double view(const std::vector<double>& values) {
  dds_sequence_double sequence{};
  sequence._length = sequence._maximum = static_cast<uint32_t>(values.size());
  sequence._buffer = const_cast<double*>(values.data());  // only read by dds_write
  return sequence;
}

std::vector<double> get(const dds_sequence_double& sequence) {
  return std::vector<double>(sequence._buffer, sequence._buffer + sequence._length);
}

template <typename T>
void forget_oldest(std::vector<T>& pending) {
  if (pending.size() > kMaxPending) pending.erase(pending.begin(), pending.end() - kMaxPending);
}

enum TopicIndex { kWorkerStatus, kRunControl, kWeightsUpdate, kEpisodeResult, kTrainStats, kTopicCount };

struct TopicTraits {
  const char* name;
  const dds_topic_descriptor_t* type;
  bool is_kept_for_late_joiners;  // transient-local
  int history;                    // keep-last
  bool has_liveliness;
};

const std::array<TopicTraits, kTopicCount>& topics() {
  static const std::array<TopicTraits, kTopicCount> all = {{
      {"WorkerStatus", &comrad_wire_WorkerStatus_desc, true, 1, true},
      {"RunControl", &comrad_wire_RunControl_desc, true, 1, false},
      {"WeightsUpdate", &comrad_wire_WeightsUpdate_desc, true, 1, false},
      {"EpisodeResult", &comrad_wire_EpisodeResult_desc, false, kEpisodeHistory, false},
      {"TrainStats", &comrad_wire_TrainStats_desc, true, 1, false},
  }};
  return all;
}

dds_qos_t* make_qos(const TopicTraits& traits) {
  dds_qos_t* qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, kMaxBlocking);
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, traits.history);
  dds_qset_durability(
      qos, traits.is_kept_for_late_joiners ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE);
  if (traits.is_kept_for_late_joiners) {
    dds_qset_durability_service(qos, 0, DDS_HISTORY_KEEP_LAST, traits.history, DDS_LENGTH_UNLIMITED,
                                DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
  }
  if (traits.has_liveliness) dds_qset_liveliness(qos, DDS_LIVELINESS_AUTOMATIC, kLiveliness);
  // A goodbye is an explicit dispose; a writer that just vanishes leaves "no writers" behind.
  dds_qset_writer_data_lifecycle(qos, /*autodispose=*/false);
  return qos;
}

}  // namespace

std::string make_cyclone_config(const std::string& run_id, const std::string& interface_name) {
  // Message sizes and watermark: measured, 190 000 instead of 110 000 frames/s over loopback (design, section
  // 5). One receive thread: a run's topics are small and rare, and simulators need the cores.
  return R"(<CycloneDDS xmlns="https://cdds.io/config"><Domain Id="any">)"
         R"(<General><Interfaces><NetworkInterface name=")" +
         interface_name +
         R"(" multicast="false"/></Interfaces><AllowMulticast>false</AllowMulticast>)"
         R"(<MaxMessageSize>65500B</MaxMessageSize><FragmentSize>65000B</FragmentSize></General>)"
         R"(<Discovery><Tag>)" +
         run_id + R"(</Tag><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>)" +
         std::to_string(kMaxParticipantIndex) +
         R"(</MaxAutoParticipantIndex><Peers><Peer Address="127.0.0.1"/></Peers></Discovery>)"
         R"(<Internal><MultipleReceiveThreads>false</MultipleReceiveThreads>)"
         R"(<SocketReceiveBufferSize min="default" max="10MB"/>)"
         R"(<Watermarks><WhcHigh>8MB</WhcHigh></Watermarks></Internal>)"
#ifdef DDS_HAS_SHM
         R"(<SharedMemory><Enable>false</Enable></SharedMemory>)"  // Iceoryx would need a daemon
#endif
         R"(</Domain></CycloneDDS>)";
}

BusConfig bus_config_for_run(uint64_t run_id) {
  char digits[17];
  std::snprintf(digits, sizeof digits, "%016" PRIx64, run_id);
  BusConfig config;
  config.run_id = digits;
  config.domain_id = 1 + static_cast<uint32_t>(RngKey(run_id).split("dds domain").bits() % kDomainCount);
  config.uri = make_cyclone_config(config.run_id, config.interface_name);
  return config;
}

struct Bus::State {
  BusConfig config;
  bool is_in_domain = false;
  dds_entity_t participant = 0;
  dds_entity_t publisher = 0;
  dds_entity_t subscriber = 0;
  dds_entity_t waitset = 0;

  std::mutex mutex;  // guards what follows; Cyclone guards its own
  std::array<dds_entity_t, kTopicCount> topic{};
  std::array<dds_entity_t, kTopicCount> writer{};
  std::array<dds_entity_t, kTopicCount> reader{};
  std::set<std::string> own_workers;  // ids this bus spoke for: they get a goodbye
  std::vector<WorkerStatus> pending_status;
  std::vector<std::string> pending_lost;

  ~State() {
    for (const std::string& worker_id : own_workers) {
      comrad_wire_WorkerStatus key{};
      put(key.worker_id, worker_id);
      dds_dispose(writer[kWorkerStatus], &key);
    }
    if (participant > 0) dds_delete(participant);
    if (is_in_domain) leave_domain(config.domain_id);
  }

  // Makes the topic, then the writer or reader, on first use. The caller holds `mutex`.
  Expected<dds_entity_t> topic_of(TopicIndex index) {
    if (topic[index] > 0) return topic[index];
    const TopicTraits& traits = topics()[index];
    const dds_entity_t made = dds_create_topic(participant, traits.type, traits.name, nullptr, nullptr);
    if (made < 0) return dds_error(made, std::string("make topic ") + traits.name, config.domain_id);
    return topic[index] = made;
  }

  Expected<dds_entity_t> writer_of(TopicIndex index) {
    const std::lock_guard lock(mutex);
    if (writer[index] > 0) return writer[index];
    COMRAD_TRY_ASSIGN(const dds_entity_t about, topic_of(index));
    dds_qos_t* qos = make_qos(topics()[index]);
    const dds_entity_t made = dds_create_writer(publisher, about, qos, nullptr);
    dds_delete_qos(qos);
    if (made < 0)
      return dds_error(made, std::string("make a writer of ") + topics()[index].name, config.domain_id);
    return writer[index] = made;
  }

  Expected<dds_entity_t> reader_of(TopicIndex index) {
    if (reader[index] > 0) return reader[index];
    COMRAD_TRY_ASSIGN(const dds_entity_t about, topic_of(index));
    dds_qos_t* qos = make_qos(topics()[index]);
    const dds_entity_t made = dds_create_reader(subscriber, about, qos, nullptr);
    dds_delete_qos(qos);
    if (made < 0)
      return dds_error(made, std::string("make a reader of ") + topics()[index].name, config.domain_id);
    const dds_entity_t condition = dds_create_readcondition(made, DDS_ANY_STATE);
    const dds_return_t attached =
        condition < 0 ? condition : dds_waitset_attach(waitset, condition, condition);
    if (attached < 0) {
      dds_delete(made);
      return dds_error(attached, std::string("wait for ") + topics()[index].name, config.domain_id);
    }
    return reader[index] = made;
  }

  template <typename Wire>
  Status write(TopicIndex index, const Wire& sample) {
    COMRAD_TRY_ASSIGN(const dds_entity_t to, writer_of(index));
    const dds_return_t code = dds_write(to, &sample);
    if (code < 0) return dds_error(code, std::string("write ") + topics()[index].name, config.domain_id);
    return {};
  }

  // Calls `visit(sample, info)` for all that lies ready, oldest first. The caller holds `mutex`.
  template <typename Wire, typename Visitor>
  void take(TopicIndex index, Visitor visit) {
    Expected<dds_entity_t> from = reader_of(index);
    if (!from) {
      spdlog::warn("{}", from.error().message);
      return;
    }
    for (int taken = kTakeAtOnce; taken == kTakeAtOnce;) {
      void* samples[kTakeAtOnce] = {};
      dds_sample_info_t infos[kTakeAtOnce];
      taken = dds_take(*from, samples, infos, kTakeAtOnce, kTakeAtOnce);
      for (int i = 0; i < taken; ++i) visit(*static_cast<const Wire*>(samples[i]), infos[i]);
      if (taken > 0) dds_return_loan(*from, samples, taken);
    }
  }

  // WorkerStatus feeds two calls, so what one of them takes is kept for the other. The caller holds `mutex`.
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
  if (!is_plain_word(config.run_id)) {
    return Error{ErrorCode::kBadInput,
                 "DDS run id '" + config.run_id + "': 1 to 64 letters, digits, _ - . or :"};
  }
  if (config.domain_id > 230) {
    return Error{ErrorCode::kBadInput, "DDS domain " + std::to_string(config.domain_id) + ": 0 to 230"};
  }
  if (!is_plain_word(config.interface_name) || !is_loopback(config.interface_name)) {
    return Error{ErrorCode::kBadInput, "DDS interface '" + config.interface_name +
                                           "' is not a loopback interface of this host, and nothing of a run "
                                           "listens beyond loopback; check `ip addr show lo`"};
  }
  auto state = std::make_unique<State>();
  state->config = config;
  if (state->config.uri.empty())
    state->config.uri = make_cyclone_config(config.run_id, config.interface_name);
  COMRAD_TRY(enter_domain(state->config));
  state->is_in_domain = true;

  const auto failed = [&](dds_return_t code, const char* what) {
    return dds_error(code, what, config.domain_id);
  };
  state->participant = dds_create_participant(config.domain_id, nullptr, nullptr);
  if (state->participant < 0) return failed(state->participant, "make a participant");
  const std::string partition = "comrad-" + std::to_string(kBusVersion) + "-" + config.run_id;
  const char* names[] = {partition.c_str()};
  dds_qos_t* qos = dds_create_qos();
  dds_qset_partition(qos, 1, names);
  state->publisher = dds_create_publisher(state->participant, qos, nullptr);
  state->subscriber = dds_create_subscriber(state->participant, qos, nullptr);
  dds_delete_qos(qos);
  if (state->publisher < 0) return failed(state->publisher, "make a publisher");
  if (state->subscriber < 0) return failed(state->subscriber, "make a subscriber");
  state->waitset = dds_create_waitset(state->participant);
  if (state->waitset < 0) return failed(state->waitset, "make a wait set");
  return Bus(std::move(state));
}

Status Bus::write(const WorkerStatus& status) {
  comrad_wire_WorkerStatus out{};
  if (status.worker_id.empty() || status.worker_id.size() >= sizeof out.worker_id) {
    return Error{ErrorCode::kBadInput, "WorkerStatus.worker_id '" + status.worker_id.substr(0, 80) +
                                           "': 1 to " + std::to_string(sizeof out.worker_id - 1) + " bytes"};
  }
  put(out.worker_id, status.worker_id);
  put(out.host, status.host);
  out.pid = status.pid;
  put(out.role, status.role);
  put(out.state, status.state);
  out.decisions_per_s = status.decisions_per_s;
  put(out.message, status.message);
  COMRAD_TRY(state_->write(kWorkerStatus, out));
  const std::lock_guard lock(state_->mutex);
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
  constexpr std::size_t kMaxAgentsOnWire = 8;  // the bound in comrad.idl
  if (result.agent_return.size() > kMaxAgentsOnWire || result.agent_score.size() > kMaxAgentsOnWire) {
    return Error{ErrorCode::kBadInput, "EpisodeResult: more than 8 agents"};
  }
  comrad_wire_EpisodeResult out{};
  put(out.scenario, result.scenario);
  out.layout_id = result.layout_id;
  out.episode_id = result.episode_id;
  out.episode_seed = result.episode_seed;
  out.env_index = result.env_index;
  out.score = result.score;
  out.ceiling = result.ceiling;
  out.agent_return = view(result.agent_return);
  out.agent_score = view(result.agent_score);
  out.length_steps = result.length_steps;
  out.length_tics = result.length_tics;
  out.terminated = result.terminated;
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
  const std::lock_guard lock(state_->mutex);
  state_->take_workers();
  return std::exchange(state_->pending_status, {});
}

std::vector<std::string> Bus::take_lost_workers() {
  const std::lock_guard lock(state_->mutex);
  state_->take_workers();
  return std::exchange(state_->pending_lost, {});
}

std::optional<RunControl> Bus::take_run_control() {
  const std::lock_guard lock(state_->mutex);
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
  const std::lock_guard lock(state_->mutex);
  std::optional<WeightsUpdate> newest;
  state_->take<comrad_wire_WeightsUpdate>(kWeightsUpdate, [&](const auto& in, const dds_sample_info_t& info) {
    if (!info.valid_data) return;
    newest = {.version = in.version, .bytes = in.bytes, .checksum = in.checksum};
  });
  return newest;
}

std::vector<EpisodeResult> Bus::take_episode_results() {
  const std::lock_guard lock(state_->mutex);
  std::vector<EpisodeResult> results;
  state_->take<comrad_wire_EpisodeResult>(kEpisodeResult, [&](const auto& in, const dds_sample_info_t& info) {
    if (!info.valid_data) return;
    results.push_back({.scenario = get(in.scenario),
                       .layout_id = in.layout_id,
                       .episode_id = in.episode_id,
                       .episode_seed = in.episode_seed,
                       .env_index = in.env_index,
                       .score = in.score,
                       .ceiling = in.ceiling,
                       .agent_return = get(in.agent_return),
                       .agent_score = get(in.agent_score),
                       .length_steps = in.length_steps,
                       .length_tics = in.length_tics,
                       .terminated = in.terminated});
  });
  return results;
}

std::optional<TrainStats> Bus::take_train_stats() {
  const std::lock_guard lock(state_->mutex);
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

bool Bus::wait(int timeout_ms) {
  dds_attach_t ready[1];
  return dds_waitset_wait(state_->waitset, ready, 1, DDS_MSECS(timeout_ms)) > 0;
}

}  // namespace comrad::dds
