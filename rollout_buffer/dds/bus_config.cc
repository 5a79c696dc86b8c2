#include "rollout_buffer/dds/bus_config.h"

#include <arpa/inet.h>
#include <dds/dds.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cctype>

#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/dds/keys.h"

namespace comrad::dds {
namespace {

constexpr uint32_t kHeaderBytes =
    256;  // of RTPS, in a datagram with a fragment of a sample, and of its signature

constexpr uint32_t kDomainCount = 100;
constexpr uint32_t kPortsPerDomain = 250;  // of RTPS: two ports per participant from + 10 on
constexpr uint32_t kMaxDomain = 230;

bool is_plain_word(const std::string& word) {
  return !word.empty() && word.size() <= 64 && std::all_of(word.begin(), word.end(), [](unsigned char c) {
    return std::isalnum(c) || c == '_' || c == '-' || c == '.' || c == ':';
  });
}

bool is_address(const std::string& text) {
  in_addr address{};
  return inet_pton(AF_INET, text.c_str(), &address) == 1;
}

}  // namespace

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

PortRange ports_of(const BusConfig& config) {
  const uint32_t first = config.port_base + kPortsPerDomain * config.domain_id;
  return {first, first + 9 + 2 * static_cast<uint32_t>(config.max_participants)};
}

Status validate(const BusConfig& config) {
  const auto refuse = [](std::string what) { return Error{ErrorCode::kBadInput, "DDS " + std::move(what)}; };
  if (!is_plain_word(config.run_id))
    return refuse("run id '" + config.run_id + "': 1 to 64 letters, digits, _ - . or :");
  if (config.domain_id > kMaxDomain)
    return refuse(fmt::format("domain {}: 0 to {}", config.domain_id, kMaxDomain));
  if (config.max_participants < 1 || config.max_participants > 120)
    return refuse(fmt::format("participants of a host: {}, must be 1 to 120", config.max_participants));
  if (config.port_base < 1024 || ports_of(config).last > 65535)
    return refuse(
        fmt::format("port base {}: domain {} would use ports {} to {}; they must lie in 1024 to 65535",
                    config.port_base, config.domain_id, ports_of(config).first, ports_of(config).last));
  if (config.receive_buffer_mb < 1 || config.receive_buffer_mb > 1024)
    return refuse(fmt::format("receive buffer of {} MB: 1 to 1024", config.receive_buffer_mb));
  if (config.datagram_bytes < 1024 || config.datagram_bytes > 65500)
    return refuse(fmt::format("datagrams of {} bytes: 1024 to 65500", config.datagram_bytes));
  for (const std::string& peer : config.peers)
    if (!is_address(peer)) return refuse("peer '" + peer + "' is no IPv4 address");
  const std::string interface = "interface '" + config.interface_name + "'";
  if (!is_plain_word(config.interface_name)) return refuse(interface + ": letters, digits, _ - . or :");
  if (!is_loopback(config.interface_name) && config.key_folder.empty() && !config.allows_insecure_network)
    return refuse(
        interface +
        " is not a loopback interface of this host, and nothing keeps unknown peers of a network out: what "
        "they send would be learned from. Make keys with `comrad keys make FOLDER --hosts a,b` and name this "
        "host's with --keys; or, where every machine of that network is trusted, say --insecure_network");
  if (if_nametoindex(config.interface_name.c_str()) == 0)
    return refuse(interface + " is not there; `ip addr` lists this host's");
  if (config.key_folder.empty()) return {};
  COMRAD_TRY(security_plugins());
  COMRAD_TRY_ASSIGN(const KeyIdentity identity, check_keys(config.key_folder));
  if (config.needs_keys_of_run && identity.role != KeyRole::kRun)
    return Error{ErrorCode::kBadInput,
                 "keys " + config.key_folder + ": they are those of host '" + identity.name +
                     "', which may join but not serve; the host that serves uses the folder "
                     "`run` that `comrad keys` made"};
  return {};
}

Expected<std::string> make_cyclone_config(const BusConfig& config) {
  std::string peers, security;
  if (!config.key_folder.empty()) {
    COMRAD_TRY_ASSIGN(security, security_config(config.key_folder));
  }
  for (const std::string& peer : config.peers) peers += R"(<Peer Address=")" + peer + R"("/>)";
  // Message sizes and watermark: measured, 190 000 instead of 110 000 frames/s over loopback (design, section
  // 5). One receive thread: simulators need the cores.
  return R"(<CycloneDDS xmlns="https://cdds.io/config"><Domain Id="any">)"
         R"(<General><Interfaces><NetworkInterface name=")" +
         config.interface_name +
         R"(" multicast="false"/></Interfaces><AllowMulticast>false</AllowMulticast>)"
         R"(<MaxMessageSize>)" +
         std::to_string(config.datagram_bytes) + R"(B</MaxMessageSize><FragmentSize>)" +
         std::to_string(config.datagram_bytes - kHeaderBytes) +
         R"(B</FragmentSize></General>)"
         R"(<Discovery><Tag>)" +
         config.run_id + R"(</Tag><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>)" +
         std::to_string(config.max_participants - 1) + R"(</MaxAutoParticipantIndex><Ports><Base>)" +
         std::to_string(config.port_base) + R"(</Base></Ports><Peers>)" + peers + R"(</Peers>)" +
         // A network that was gone is soon back.
         R"(<SPDPInterval>1s</SPDPInterval></Discovery><Internal><MultipleReceiveThreads>false</MultipleReceiveThreads>)"
         R"(<SocketReceiveBufferSize min="default" max=")" +
         std::to_string(config.receive_buffer_mb) +
         R"(MB"/><Watermarks><WhcHigh>8MB</WhcHigh></Watermarks></Internal>)"
#ifdef DDS_HAS_SHM
         R"(<SharedMemory><Enable>false</Enable></SharedMemory>)"  // Iceoryx would need a daemon
#endif
         + security + R"(</Domain></CycloneDDS>)";
}

BusConfig link_config(uint64_t link_id) {
  BusConfig config;
  config.run_id = fmt::format("{:016x}", link_id);
  config.domain_id = 1 + static_cast<uint32_t>(RngKey(link_id).split("dds domain").bits() % kDomainCount);
  return config;
}

}  // namespace comrad::dds
