#include "deploy/launch/control_socket.h"

#include <spdlog/fmt/fmt.h>
#include <sys/random.h>
#include <unistd.h>

#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <sstream>
#include <utility>

#include "rollout_buffer/core/abstract_address.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/host_name.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

using nlohmann::ordered_json;

constexpr std::size_t kLongestHost = 255;

std::string line_of(const ordered_json& json) {
  return json.dump(-1, ' ', false, ordered_json::error_handler_t::replace) + "\n";
}
std::string refused(const std::string& why) { return line_of({{"error", why}}); }
std::string answer_of(const Status& status) {
  return status ? line_of({{"ok", true}}) : refused(status.error().message);
}

/// The same user, or root, which has every right anyhow.
std::string refusal(int client) {
  const Peer peer = peer_of(client);
  if (peer.user == static_cast<int64_t>(geteuid()) || peer.user == 0) return "";
  spdlog::info("user {} (pid {}) connected to the run's control socket and was refused", peer.user, peer.pid);
  return refused(fmt::format("the run belongs to user {}, you are user {}", geteuid(), peer.user));
}

}  // namespace

ControlAddress make_control_address() {
  uint64_t id = 0;
  (void)!getrandom(&id, sizeof id, 0);  // a name that is taken is refused when it is bound
  char name[40];
  std::snprintf(name, sizeof name, "comrad-control-%016" PRIx64, id);
  return {.pid = getpid(), .socket = name, .host = host_name()};
}

Status write_control_address(int lock, const ControlAddress& address) {
  const std::string text = fmt::format("{}\n{}\n{}\n", address.pid, address.socket, address.host);
  if (ftruncate(lock, 0) != 0 ||
      pwrite(lock, text.data(), text.size(), 0) != static_cast<ssize_t>(text.size()))
    return system_error("the run's lock file");
  return {};
}

std::optional<ControlAddress> read_control_address(const std::string& run_dir) {
  const Expected<std::string> text = read_short_file(run_dir + "/.lock", 512);
  if (!text) return std::nullopt;
  std::istringstream lines(*text);
  std::string pid;
  ControlAddress address;
  std::getline(lines, pid) && std::getline(lines, address.socket) && std::getline(lines, address.host);
  address.pid = std::strtoll(pid.c_str(), nullptr, 10);
  return address;
}

std::string answer_command(std::string_view request, const ControlCommands& orders) {
  const ordered_json json = ordered_json::parse(request, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object() || !json.contains("do") || !json["do"].is_string())
    return refused("this is no request of comrad ctl");
  const auto order = json["do"].get<std::string>();
  if (order == "status") return orders.status() + "\n";
  spdlog::info("comrad ctl: {}", order.substr(0, 32));
  if (order == "pause") return answer_of(orders.pause());
  if (order == "resume") return answer_of(orders.resume());
  if (order == "stop") return answer_of(orders.stop());
  if (order == "checkpoint") {
    const Expected<uint32_t> number = orders.checkpoint();
    return number ? line_of({{"ok", true}, {"asked", *number}}) : refused(number.error().message);
  }
  if (order == "drain") {
    if (!json.contains("host") || !json["host"].is_string() ||
        json["host"].get<std::string>().size() > kLongestHost)
      return refused("drain needs the name of a host");
    return answer_of(orders.drain(json["host"].get<std::string>()));
  }
  return refused(unknown_word("order", order.substr(0, 32),
                              {"status", "pause", "resume", "checkpoint", "stop", "drain"}));
}

Expected<ControlSocket> ControlSocket::open(const std::string& name, ControlCommands orders) {
  COMRAD_TRY_ASSIGN(Descriptor listener, listen_on_name(name));
  return ControlSocket(ReplyServer(
      std::move(listener),
      {.is_whole = [](std::string_view request) { return request.ends_with('\n'); },
       .answer =
           [orders = std::move(orders)](std::string_view request) { return answer_command(request, orders); },
       .refusal = refusal}));
}

}  // namespace comrad::deploy
