// How a run's link is found: "192.168.1.7/0123456789abcdef", the address of the learner's host and the link's id. The
// id is what a host must know to join; it lies in the run's folder for its owner alone.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/bus_config.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::link {

constexpr const char* kLoopback = "lo";
constexpr const char* kLinkIdFile =
    "link_id";  ///< in a run that serves: the link's id, kept when the run continues
constexpr const char* kKeysFile =
    "link_keys";  ///< in a run of several hosts: the path of this host's keys, if any
constexpr const char* kAddressFile =
    "link_address";  ///< of a run that serves, in its folder and in the runs that joined it

struct LinkAddress {
  std::string host = "127.0.0.1";  ///< IPv4
  uint32_t port_base = 7400;
  uint64_t link_id = 0;
};

/// "host/id" or "host:port_base/id". Errors: kBadInput saying how an address looks.
Expected<LinkAddress> parse_address(const std::string& text);
std::string text_of(const LinkAddress& address);

/// Writes `<run_dir>/link_address`, readable for its owner alone. Errors: kNoSpace, kSystem.
Status keep_address(const std::string& run_dir, const LinkAddress& address);
/// Reads it. Errors: kNotFound, those of parse_address().
Expected<LinkAddress> kept_address(const std::string& run_dir);

/// An address that a user gives: the address itself, the folder of the run or its link_address file, or "-" for a line of
/// the standard input. Errors: those of parse_address() and kept_address().
Expected<LinkAddress> read_address(const std::string& given);

/// The id in `<run_dir>/link_id`, which is made where it is missing, readable for its owner alone.
/// Errors: kBadFormat, kSystem.
Expected<uint64_t> keep_link_id(const std::string& run_dir);

/// The interface of this host through which `host` is reached. Errors: kBadInput for no IPv4 address, or an address of
/// this host other than loopback's; kNotFound without a route.
Expected<std::string> interface_towards(const std::string& host);
/// The first IPv4 address of an interface. Errors: kNotFound.
Expected<std::string> address_of_interface(const std::string& interface_name);

/// Remembers for the run's processes which folder of keys this host has; empty: as before. Errors: kNoSpace, kSystem.
Status keep_keys(const std::string& run_dir, const std::string& key_folder);
/// Empty where there are none.
std::string kept_keys(const std::string& run_dir);

/// The configurations of both ends; `key_folder` is this host's keys, empty where it has none. That of the serving one is
/// on loopback where the settings name no interface, and names no peer: it answers each question's sender.
dds::BusConfig serving_config(uint64_t link_id, const HostSettings& settings,
                              const std::string& key_folder = "");
dds::BusConfig joining_config(const LinkAddress& address, const HostSettings& settings,
                              const std::string& automatic_interface, const std::string& key_folder = "");

}  // namespace comrad::link
