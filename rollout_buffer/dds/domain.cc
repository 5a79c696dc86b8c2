#include "rollout_buffer/dds/domain.h"

#include <dirent.h>
#include <linux/filter.h>
#include <netinet/in.h>
#include <spdlog/fmt/fmt.h>
#include <sys/socket.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <map>
#include <mutex>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/dds/unknown_peers.h"

namespace comrad::dds {
namespace {

std::string what_to_check(const BusConfig& config) {
  const PortRange ports = ports_of(config);
  const bool is_local = is_loopback(config.interface_name);
  return fmt::format(
      "; check that {} is up (`ip addr show {}`), that UDP ports {}-{}{} are not filtered, and that at most "
      "{} processes of this host use DDS domain {}",
      (is_local ? "loopback" : config.interface_name), config.interface_name, ports.first, ports.last,
      (is_local ? " of 127.0.0.1" : ""), config.max_participants, config.domain_id);
}

// Cyclone's lines end in a newline.
void log_cyclone(void*, const dds_log_data_t* data) {
  std::string_view text(data->message, data->size);
  while (!text.empty() && (text.back() == '\n' || text.back() == '\0')) text.remove_suffix(1);
  if (is_about_an_unknown_peer(text)) {
    spdlog::debug("cyclonedds: {}", text);  // again every second; each unknown peer gets one line of ours
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

}  // namespace

Error dds_error(dds_return_t code, const std::string& what, const BusConfig& config) {
  return Error{
      code == DDS_RETCODE_TIMEOUT ? ErrorCode::kTimeout : ErrorCode::kSystem,
      fmt::format("DDS: cannot {}: {} ({}){}", what, dds_strretcode(code), code, what_to_check(config))};
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

}  // namespace comrad::dds
