#include "rollout_buffer/dds/participant.h"

#include <spdlog/fmt/fmt.h>

#include "rollout_buffer/dds/strangers.h"

#include <dirent.h>
#include <linux/filter.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <cerrno>
#include <cstdlib>
#include <map>
#include <mutex>

namespace comrad::dds {
namespace {

constexpr dds_duration_t kMaxBlocking = DDS_MSECS(100);  // of a write whose readers do not keep up

std::string what_to_check(const BusConfig& config) {
  const PortRange ports = ports_of(config);
  const bool is_local = is_loopback(config.interface_name);
  return fmt::format(
      "; check that {} is up (`ip addr show {}`), that UDP ports {}-{}{} are not filtered, and that at most "
      "{} processes of this host use DDS domain {}",
      (is_local ? "loopback" : config.interface_name), config.interface_name, ports.first, ports.last,
      (is_local ? " of 127.0.0.1" : ""), config.max_participants, config.domain_id);
}

Error dds_error(dds_return_t code, const std::string& what, const BusConfig& config) {
  return Error{
      code == DDS_RETCODE_TIMEOUT ? ErrorCode::kTimeout : ErrorCode::kSystem,
      fmt::format("DDS: cannot {}: {} ({}){}", what, dds_strretcode(code), code, what_to_check(config))};
}

// Cyclone's own complaints go where ours go. Its lines end in a newline.
void log_cyclone(void*, const dds_log_data_t* data) {
  std::string_view text(data->message, data->size);
  while (!text.empty() && (text.back() == '\n' || text.back() == '\0')) text.remove_suffix(1);
  if (is_about_a_stranger(text)) {
    spdlog::debug("cyclonedds: {}", text);  // again every second; UnknownPeers reports it once
  } else if (data->priority & (DDS_LC_FATAL | DDS_LC_ERROR)) {
    spdlog::error("cyclonedds: {}", text);
  } else {
    spdlog::warn("cyclonedds: {}", text);
  }
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

// Cyclone 0.10 sends from the given interface but binds its receive sockets to 0.0.0.0, whatever the
// configuration is. Ties those of the domain to the interface.
Status keep_sockets_on_interface(const BusConfig& config) {
  const PortRange ports = ports_of(config);
  const bool is_local = is_loopback(config.interface_name);
  DIR* descriptors = opendir("/proc/self/fd");
  if (descriptors == nullptr)
    return Error{ErrorCode::kSystem, "DDS: cannot list /proc/self/fd; check that /proc is mounted"};
  Status status;
  while (const dirent* entry = readdir(descriptors)) {
    const int descriptor = std::atoi(entry->d_name);
    sockaddr_in address{};
    socklen_t size = sizeof address;
    if (entry->d_name[0] == '.' || getsockname(descriptor, reinterpret_cast<sockaddr*>(&address), &size) != 0)
      continue;
    const uint32_t port = ntohs(address.sin_port);
    if (address.sin_family != AF_INET || address.sin_addr.s_addr != htonl(INADDR_ANY) || port < ports.first ||
        port > ports.last)
      continue;
    const bool is_bound = setsockopt(descriptor, SOL_SOCKET, SO_BINDTODEVICE, config.interface_name.c_str(),
                                     static_cast<socklen_t>(config.interface_name.size() + 1)) == 0;
    if (!is_bound && !(is_local && drop_packets_from_elsewhere(descriptor)))
      status =
          Error{ErrorCode::kSystem,
                fmt::format(
                    "DDS: cannot keep UDP port {} on {}: {}; Linux 5.7 or newer allows it without privileges",
                    port, config.interface_name, std::strerror(errno))};
  }
  closedir(descriptors);
  return status;
}

// A process has one Cyclone domain object per domain id, made with the configuration of the bus that came
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
  COMRAD_TRY_ASSIGN(const std::string uri, make_cyclone_config(config));
  if (use.count > 0 && use.uri != uri)
    return Error{
        ErrorCode::kBadInput,
        fmt::format("DDS domain {} is used by another run in this process; one process joins one run",
                    config.domain_id)};
  if (use.count == 0) {
    dds_set_log_sink(&log_cyclone, nullptr);
    use.entity = dds_create_domain(config.domain_id, uri.c_str());
    if (use.entity < 0)
      return dds_error(use.entity, fmt::format("start domain {}", config.domain_id), config);
    if (Status kept = keep_sockets_on_interface(config); !kept) {
      dds_delete(use.entity);
      return kept.error();
    }
    use.uri = uri;
  }
  ++use.count;
  return {};
}

void leave_domain(uint32_t domain_id) {
  const std::lock_guard lock(domains_mutex);
  DomainUse& use = domains()[domain_id];
  if (--use.count == 0) dds_delete(use.entity);
}

dds_qos_t* make_qos(const TopicTraits& traits) {
  dds_qos_t* qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, kMaxBlocking);
  dds_qset_history(qos, traits.history > 0 ? DDS_HISTORY_KEEP_LAST : DDS_HISTORY_KEEP_ALL, traits.history);
  if (traits.sample_limit > 0)
    dds_qset_resource_limits(qos, traits.sample_limit, DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
  dds_qset_durability(
      qos, traits.is_kept_for_late_joiners ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE);
  if (traits.is_kept_for_late_joiners) {
    dds_qset_durability_service(qos, 0, DDS_HISTORY_KEEP_LAST, traits.history, DDS_LENGTH_UNLIMITED,
                                DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
  }
  dds_qset_writer_data_lifecycle(qos, /*autodispose=*/false);
  return qos;
}

std::vector<std::string> partitions_in(dds_entity_t participant, dds_entity_t topic) {
  std::vector<std::string> found;
  const dds_entity_t reader = dds_create_reader(participant, topic, nullptr, nullptr);
  take_all(reader, [&](const void* sample, const dds_sample_info_t& info) {
    const auto& end = *static_cast<const dds_builtintopic_endpoint_t*>(sample);
    uint32_t count = 0;
    char** names = nullptr;
    if (info.instance_state != DDS_IST_ALIVE || !info.valid_data || end.qos == nullptr ||
        !dds_qget_partition(end.qos, &count, &names))
      return;
    if (count > 0) found.emplace_back(names[0]);
    for (uint32_t i = 0; i < count; ++i) dds_free(names[i]);
    dds_free(names);
  });
  if (reader > 0) dds_delete(reader);
  return found;
}

}  // namespace

Participant::Participant(const BusConfig& config, std::span<const TopicTraits> topics)
    : config_(config), topics_(topics) {
  entities_.resize(topics.size());
}

Expected<std::unique_ptr<Participant>> Participant::open(const BusConfig& config,
                                                         std::span<const TopicTraits> topics,
                                                         const std::string& partition,
                                                         const std::string& separate_partition) {
  COMRAD_TRY(validate(config));
  COMRAD_TRY(enter_domain(config));
  std::unique_ptr<Participant> made(new Participant(config, topics));
  made->is_in_domain_ = true;
  COMRAD_TRY(made->make(partition, separate_partition));
  return made;
}

Status Participant::make(const std::string& partition, const std::string& separate_partition) {
  participant_ = dds_create_participant(config_.domain_id, nullptr, nullptr);
  if (participant_ < 0) return error(participant_, "make a participant");
  for (int which = 0; which < (separate_partition.empty() ? 1 : 2); ++which) {
    const char* names[] = {which == 0 ? partition.c_str() : separate_partition.c_str()};
    dds_qos_t* qos = dds_create_qos();
    dds_qset_partition(qos, 1, names);
    publisher_[which] = dds_create_publisher(participant_, qos, nullptr);
    subscriber_[which] = dds_create_subscriber(participant_, qos, nullptr);
    dds_delete_qos(qos);
    if (publisher_[which] < 0) return error(publisher_[which], "make a publisher");
    if (subscriber_[which] < 0) return error(subscriber_[which], "make a subscriber");
  }
  waitset_ = dds_create_waitset(participant_);
  if (waitset_ < 0) return error(waitset_, "make a wait set");
  if (!config_.key_folder.empty()) strangers_ = std::make_unique<Strangers>(participant_);
  return {};
}

Participant::~Participant() {
  if (participant_ > 0) dds_delete(participant_);
  if (is_in_domain_) leave_domain(config_.domain_id);
}

Error Participant::error(dds_return_t code, const std::string& what) const {
  if (code == DDS_RETCODE_NOT_ALLOWED_BY_SECURITY)
    return Error{ErrorCode::kBadInput,
                 "DDS: cannot " + what + ": " + config_.key_folder +
                     "/permissions.p7s does not allow it; `comrad keys show` names the host of these keys"};
  return dds_error(code, what, config_);
}

Expected<dds_entity_t> Participant::topic_of(int index) {
  Entities& entities = entities_[static_cast<std::size_t>(index)];
  if (entities.topic > 0) return entities.topic;
  const TopicTraits& traits = topics_[static_cast<std::size_t>(index)];
  const dds_entity_t made = dds_create_topic(participant_, traits.type, traits.name, nullptr, nullptr);
  if (made < 0) return error(made, std::string("make topic ") + traits.name);
  return entities.topic = made;
}

Expected<dds_entity_t> Participant::writer_of(int index) {
  Entities& entities = entities_[static_cast<std::size_t>(index)];
  if (entities.writer > 0) return entities.writer;
  COMRAD_TRY_ASSIGN(const dds_entity_t about, topic_of(index));
  const TopicTraits& traits = topics_[static_cast<std::size_t>(index)];
  dds_qos_t* qos = make_qos(traits);
  const dds_entity_t made = dds_create_writer(publisher_[traits.is_separate], about, qos, nullptr);
  dds_delete_qos(qos);
  if (made < 0) return error(made, std::string("make a writer of ") + traits.name);
  return entities.writer = made;
}

Expected<dds_entity_t> Participant::reader_of(int index) {
  Entities& entities = entities_[static_cast<std::size_t>(index)];
  if (entities.reader > 0) return entities.reader;
  COMRAD_TRY_ASSIGN(const dds_entity_t about, topic_of(index));
  const TopicTraits& traits = topics_[static_cast<std::size_t>(index)];
  dds_qos_t* qos = make_qos(traits);
  const dds_entity_t made = dds_create_reader(subscriber_[traits.is_separate], about, qos, nullptr);
  dds_delete_qos(qos);
  if (made < 0) return error(made, std::string("make a reader of ") + traits.name);
  const dds_entity_t condition = dds_create_readcondition(made, DDS_ANY_STATE);
  const dds_return_t attached =
      condition < 0 ? condition : dds_waitset_attach(waitset_, condition, condition);
  if (attached < 0) {
    dds_delete(made);
    return error(attached, std::string("wait for ") + traits.name);
  }
  return entities.reader = made;
}

Status Participant::write_sample(int topic, const void* sample) {
  COMRAD_TRY_ASSIGN(const dds_entity_t to, writer_of(topic));
  const dds_return_t code = dds_write(to, sample);
  if (code < 0) return error(code, std::string("write ") + topics_[static_cast<std::size_t>(topic)].name);
  return {};
}

bool Participant::is_acknowledged(int topic) const {
  const dds_entity_t writer = entities_[static_cast<std::size_t>(topic)].writer;
  return writer <= 0 || dds_wait_for_acks(writer, 0) == DDS_RETCODE_OK;
}

std::vector<std::string> Participant::partitions_of_writers() const {
  return partitions_in(participant_, DDS_BUILTIN_TOPIC_DCPSPUBLICATION);
}
std::vector<std::string> Participant::partitions_of_readers() const {
  return partitions_in(participant_, DDS_BUILTIN_TOPIC_DCPSSUBSCRIPTION);
}

bool Participant::wait(int timeout_ms) {
  if (strangers_ != nullptr) strangers_->look();
  dds_attach_t ready[1];
  return dds_waitset_wait(waitset_, ready, 1, DDS_MSECS(timeout_ms)) > 0;
}

}  // namespace comrad::dds
