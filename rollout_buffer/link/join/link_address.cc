#include "rollout_buffer/link/join/link_address.h"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <spdlog/fmt/fmt.h>
#include <sys/ioctl.h>
#include <sys/random.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cstring>
#include <functional>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/parts.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/dds/keys.h"

namespace comrad::link {
namespace {

constexpr std::size_t kIdDigits = 16;

template <typename Number>
bool read_whole(std::string_view text, Number& number, int base) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number, base);
  return !text.empty() && error == std::errc() && end == text.data() + text.size();
}

/// A line that its owner alone may read, in the place of an older file.
Status write_secret(const std::string& path, const std::string& line) {
  unlink(path.c_str());
  return dds::write_private_file(path, line + "\n");
}

bool read_id(std::string_view text, uint64_t& id) {
  return text.size() == kIdDigits && read_whole(text, id, 16);
}

/// Calls `visit` for every IPv4 address of this host.
void visit_addresses(const std::function<void(const ifaddrs&, const sockaddr_in&)>& visit) {
  ifaddrs* all = nullptr;
  if (getifaddrs(&all) != 0) return;
  for (const ifaddrs* one = all; one != nullptr; one = one->ifa_next)
    if (one->ifa_addr != nullptr && one->ifa_addr->sa_family == AF_INET)
      visit(*one, *reinterpret_cast<const sockaddr_in*>(one->ifa_addr));
  freeifaddrs(all);
}

}  // namespace

Expected<LinkAddress> parse_address(const std::string& text) {
  const Error bad{ErrorCode::kBadInput, "'" + text + "' is no address of a run; it looks like " +
                                            "192.168.1.7/0123456789abcdef, as the run that serves prints it"};
  LinkAddress address;
  const std::size_t slash = text.find('/');
  if (slash == std::string::npos || !read_id(std::string_view(text).substr(slash + 1), address.link_id))
    return bad;
  std::string_view host = std::string_view(text).substr(0, slash);
  if (const std::size_t colon = host.find(':'); colon != std::string_view::npos) {
    if (!read_whole(host.substr(colon + 1), address.port_base, 10)) return bad;
    host = host.substr(0, colon);
  }
  address.host = host;
  in_addr parsed{};
  if (inet_pton(AF_INET, address.host.c_str(), &parsed) != 1) return bad;
  return address;
}

std::string text_of(const LinkAddress& address) {
  const std::string port =
      address.port_base == LinkAddress().port_base ? "" : fmt::format(":{}", address.port_base);
  return fmt::format("{}{}/{:016x}", address.host, port, address.link_id);
}

Status keep_address(const std::string& run_dir, const LinkAddress& address) {
  return write_secret(run_dir + "/" + kAddressFile, text_of(address));
}

Expected<LinkAddress> kept_address(const std::string& run_dir) {
  const std::string path = run_dir + "/" + kAddressFile;
  const std::optional<std::string> text = read_file(path);
  if (!text) return Error{ErrorCode::kNotFound, path + ": cannot be read; does that run serve?"};
  return parse_address(std::string(trimmed(*text)));
}

Expected<LinkAddress> read_address(const std::string& given) {
  struct stat there {};
  const bool is_there = stat(given.c_str(), &there) == 0;
  if (is_there && S_ISDIR(there.st_mode)) return kept_address(given);
  if (is_there) return kept_address(given.substr(0, given.find_last_of('/') + 1) + ".");
  std::string text = given;
  if (given == "-") {
    text.clear();  // byte by byte: what follows the line is not ours
    for (char letter = 0; text.size() < 256 && read(STDIN_FILENO, &letter, 1) == 1 && letter != '\n';)
      text += letter;
  }
  return parse_address(std::string(trimmed(text)));
}

Expected<uint64_t> keep_link_id(const std::string& run_dir) {
  const std::string path = run_dir + "/" + kLinkIdFile;
  uint64_t id = 0;
  if (const std::optional<std::string> text = read_file(path)) {
    if (read_id(trimmed(*text), id)) return id;
    return Error{ErrorCode::kBadFormat, path + ": is no link's id of 16 hexadecimal digits; remove it"};
  }
  if (getrandom(&id, sizeof id, 0) != sizeof id) return system_error("getrandom");
  COMRAD_TRY(write_secret(path, fmt::format("{:016x}", id)));
  return id;
}

Expected<std::string> interface_towards(const std::string& host) {
  sockaddr_in there{};
  there.sin_family = AF_INET;
  there.sin_port = htons(9);
  if (inet_pton(AF_INET, host.c_str(), &there.sin_addr) != 1)
    return Error{ErrorCode::kBadInput, "'" + host + "' is no IPv4 address"};
  const int probe = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (probe < 0) return system_error("socket");
  sockaddr_in here{};
  socklen_t size = sizeof here;
  const bool has_route = connect(probe, reinterpret_cast<const sockaddr*>(&there), sizeof there) == 0 &&
                         getsockname(probe, reinterpret_cast<sockaddr*>(&here), &size) == 0;
  close(probe);
  if (!has_route) return Error{ErrorCode::kNotFound, "no route to " + host + " (`ip route` lists them)"};
  std::string found;
  bool is_ours = false;
  visit_addresses([&](const ifaddrs& one, const sockaddr_in& address) {
    if (address.sin_addr.s_addr == here.sin_addr.s_addr) found = one.ifa_name;
    is_ours |= address.sin_addr.s_addr == there.sin_addr.s_addr && (one.ifa_flags & IFF_LOOPBACK) == 0;
  });
  if (is_ours)
    return Error{ErrorCode::kBadInput,
                 host + " is this host itself; to join a run of this host let it serve on " +
                     "--interface lo and join 127.0.0.1"};
  if (found.empty()) return Error{ErrorCode::kNotFound, "no interface of this host leads to " + host};
  return found;
}

Expected<std::string> address_of_interface(const std::string& interface_name) {
  std::string found;
  visit_addresses([&](const ifaddrs& one, const sockaddr_in& address) {
    char text[INET_ADDRSTRLEN] = {};
    if (found.empty() && interface_name == one.ifa_name &&
        inet_ntop(AF_INET, &address.sin_addr, text, sizeof text) != nullptr)
      found = text;
  });
  if (found.empty())
    return Error{ErrorCode::kNotFound,
                 "interface '" + interface_name + "' has no IPv4 address; `ip addr` lists this host's"};
  return found;
}

Status keep_keys(const std::string& run_dir, const std::string& key_folder) {
  return key_folder.empty() ? Status() : write_secret(run_dir + "/" + kKeysFile, key_folder);
}

std::string kept_keys(const std::string& run_dir) {
  return std::string(trimmed(read_file(run_dir + "/" + kKeysFile).value_or("")));
}

/// Bytes of a UDP datagram that an interface carries in one piece; loopback's limit is UDP's.
uint32_t largest_whole_datagram(const std::string& interface_name) {
  constexpr uint32_t kIpAndUdpHeaders = 28, kSmallest = 1280 - kIpAndUdpHeaders, kLargest = 65500;
  if (dds::is_loopback(interface_name)) return kLargest;
  ifreq asked{};
  std::strncpy(asked.ifr_name, interface_name.c_str(), sizeof asked.ifr_name - 1);
  const int any = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  const bool is_known = any >= 0 && ioctl(any, SIOCGIFMTU, &asked) == 0;
  if (any >= 0) close(any);
  if (!is_known) return kSmallest;
  const auto mtu = static_cast<uint32_t>(std::max(0, asked.ifr_mtu));
  return std::clamp(mtu - std::min(mtu, kIpAndUdpHeaders), kSmallest, kLargest);
}

dds::BusConfig config_on(const std::string& automatic_interface, uint64_t link_id,
                         const HostSettings& settings, const std::string& key_folder) {
  dds::BusConfig config = dds::link_config(link_id);
  config.interface_name = settings.interface == "auto" ? automatic_interface : settings.interface;
  config.port_base = static_cast<uint32_t>(settings.port_base);
  config.allows_insecure_network = settings.insecure_network;
  config.key_folder = key_folder;
  config.peers = parts_of(settings.peers, ',');
  config.receive_buffer_mb = static_cast<uint32_t>(settings.link_buffer_mb);
  config.datagram_bytes = settings.link_datagram_bytes > 0
                              ? static_cast<uint32_t>(settings.link_datagram_bytes)
                              : largest_whole_datagram(config.interface_name);
  return config;
}

dds::BusConfig serving_config(uint64_t link_id, const HostSettings& settings, const std::string& key_folder) {
  dds::BusConfig config = config_on(kLoopback, link_id, settings, key_folder);
  config.needs_keys_of_run = true;
  return config;
}

dds::BusConfig joining_config(const LinkAddress& address, const HostSettings& settings,
                              const std::string& automatic_interface, const std::string& key_folder) {
  dds::BusConfig config = config_on(automatic_interface, address.link_id, settings, key_folder);
  config.port_base = address.port_base;
  config.peers.insert(config.peers.begin(), address.host);
  return config;
}

}  // namespace comrad::link
