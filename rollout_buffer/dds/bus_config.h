// Where participants meet: the interface, the ports, the first peers, and Cyclone's configuration made of these. All stays
// on loopback unless an interface is named.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::dds {

/// Two runs never share domain, tag and partition, which are all made from `run_id`.
struct BusConfig {
  std::string run_id;  ///< DDS partition and discovery tag
  uint32_t domain_id = 0;
  std::string interface_name = "lo";
  std::vector<std::string> peers = {
      "127.0.0.1"};                 ///< IPv4 addresses that are queried for participants; all unicast
  uint32_t port_base = 7400;        ///< the domain's ports are port_base + 250 * domain_id and up
  uint32_t receive_buffer_mb = 10;  ///< of a socket, where the kernel allows as much
  /// Of a UDP datagram. What an interface does not carry in one piece (its MTU) the kernel cuts, and keeps what came of it for
  /// 30 s where a piece is lost, in 4 MB for all: then a network that loses 1 % carries nothing any more.
  uint32_t datagram_bytes = 65500;
  int max_participants = 20;  ///< of one host in this domain
  /// Folder of this host's keys (keys.h): participants prove their identity, and what they send is encrypted. Empty: none.
  std::string key_folder = {};
  bool needs_keys_of_run = false;  ///< this end serves, which only the run's own identity may
  /// Another interface than loopback may be used although nothing keeps unknown peers of that network out.
  bool allows_insecure_network = false;
};

/// The configuration of a run's link, the same for all that know its id: the partition and the discovery tag are the id
/// as 16 hex digits, the domain (1..100, so that all ports lie below the ephemeral range) is drawn from it.
/// Participants of two runs that draw the same domain still never see each other, because their tags differ.
BusConfig link_config(uint64_t link_id);

/// Cyclone's configuration: no multicast, explicit peers, the run's tag, its message sizes and buffers, Iceoryx off, the
/// security plugins where there is a key folder. Errors: kUnsupported where those are missing.
Expected<std::string> make_cyclone_config(const BusConfig& config);

/// UDP ports that participants of this configuration may use, first and last.
struct PortRange {
  uint32_t first = 0;
  uint32_t last = 0;
};
PortRange ports_of(const BusConfig& config);

/// Checks what a user or a file may have set. Errors: kBadInput for a run id, interface, peer or port that cannot be
/// used, and for a network interface with neither keys nor allows_insecure_network; those of check_keys() and
/// security_plugins().
Status validate(const BusConfig& config);

/// Whether this host has an interface of that name that only it can send to.
bool is_loopback(const std::string& interface_name);

}  // namespace comrad::dds
