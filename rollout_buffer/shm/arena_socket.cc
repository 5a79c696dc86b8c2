#include "rollout_buffer/shm/arena_socket.h"

#include <spdlog/fmt/fmt.h>

#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <utility>

#include "rollout_buffer/core/abstract_address.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/files.h"

namespace comrad::shm {
namespace {

constexpr int kServeTimeoutMs = 1000;
constexpr int64_t kRetryUs = 20'000;

/// The server's answer; the arena's descriptor rides on it when `error` is empty.
struct JoinReply {
  uint32_t magic = kArenaMagic;
  uint32_t arena_version = kArenaVersion;
  char error[160] = {};
};

/// Waits until `descriptor` can be read. False after `timeout_ms`.
bool await_readable(int descriptor, int64_t timeout_ms) {
  const int64_t deadline_ns = monotonic_ns() + timeout_ms * 1'000'000;
  for (;;) {
    pollfd readable{descriptor, POLLIN, 0};
    const int64_t left_ms = std::max<int64_t>(0, (deadline_ns - monotonic_ns() + 999'999) / 1'000'000);
    const int ready = poll(&readable, 1, static_cast<int>(std::min<int64_t>(left_ms, 60'000)));
    if (ready > 0) return true;
    if (ready < 0 && errno != EINTR) return false;
    if (monotonic_ns() >= deadline_ns) return false;
  }
}

Status send_reply(int descriptor, const std::string& refusal, int arena_descriptor) {
  JoinReply reply;
  std::strncpy(reply.error, refusal.c_str(), sizeof reply.error - 1);
  iovec part{&reply, sizeof reply};
  alignas(cmsghdr) char control[CMSG_SPACE(sizeof(int))] = {};
  msghdr message{};
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  if (refusal.empty()) {
    message.msg_control = control;
    message.msg_controllen = sizeof control;
    cmsghdr* rider = CMSG_FIRSTHDR(&message);
    rider->cmsg_level = SOL_SOCKET;
    rider->cmsg_type = SCM_RIGHTS;
    rider->cmsg_len = CMSG_LEN(sizeof(int));
    std::memcpy(CMSG_DATA(rider), &arena_descriptor, sizeof(int));
  }
  if (sendmsg(descriptor, &message, MSG_NOSIGNAL | MSG_DONTWAIT) != static_cast<ssize_t>(sizeof reply))
    return system_error("answering a process that joins");
  return {};
}

/// Takes the reply and the descriptor that rides on it.
Expected<int> receive_arena(int descriptor, const std::string& name) {
  JoinReply reply;
  iovec part{&reply, sizeof reply};
  alignas(cmsghdr) char control[CMSG_SPACE(8 * sizeof(int))] = {};
  msghdr message{};
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  message.msg_control = control;
  message.msg_controllen = sizeof control;
  const ssize_t size = recvmsg(descriptor, &message, MSG_CMSG_CLOEXEC);
  if (size < 0) return system_error("joining run " + name);
  int received = -1;
  for (cmsghdr* rider = CMSG_FIRSTHDR(&message); rider != nullptr; rider = CMSG_NXTHDR(&message, rider)) {
    if (rider->cmsg_level != SOL_SOCKET || rider->cmsg_type != SCM_RIGHTS) continue;
    const std::size_t count = (rider->cmsg_len - CMSG_LEN(0)) / sizeof(int);
    for (std::size_t index = 0; index < count; ++index) {
      int sent = -1;
      std::memcpy(&sent, CMSG_DATA(rider) + index * sizeof(int), sizeof(int));
      if (received < 0) {
        received = sent;
      } else {
        close(sent);
      }
    }
  }
  Descriptor arena(received);
  if (size == 0)
    return Error{ErrorCode::kPeerLost, "joining run " + name + ": the run closed the connection"};
  if (size != static_cast<ssize_t>(sizeof reply) || reply.magic != kArenaMagic)
    return Error{ErrorCode::kBadFormat, "joining run " + name + ": the answer is not from a COMRAD run"};
  reply.error[sizeof reply.error - 1] = '\0';
  if (reply.error[0] != '\0')
    return Error{ErrorCode::kBadInput, "joining run " + name + ": refused: " + reply.error};
  if (arena.get() < 0)
    return Error{ErrorCode::kBadFormat, "joining run " + name + ": the answer carries no arena"};
  return arena.release();
}

}  // namespace

Expected<ArenaServer> ArenaServer::listen(const std::string& name, const Arena& arena) {
  COMRAD_TRY_ASSIGN(const AbstractAddress address, abstract_address(name));
  ArenaServer server;
  server.name_ = name;
  server.socket_ = Descriptor(socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (!server.socket_.is_open()) return system_error("socket " + name);
  if (bind(server.socket_.get(), reinterpret_cast<const sockaddr*>(&address.bytes), address.length) != 0) {
    if (errno != EADDRINUSE) return system_error("socket " + name);
    return Error{ErrorCode::kSystem,
                 "socket " + name +
                     ": the name is taken; another run of this name is alive on this host, stop it first"};
  }
  if (::listen(server.socket_.get(), 256) != 0) return system_error("socket " + name);
  server.arena_ = Descriptor(fcntl(arena.descriptor(), F_DUPFD_CLOEXEC, 0));
  if (!server.arena_.is_open()) return system_error("socket " + name + ", keeping the arena");
  return server;
}

Expected<JoinRequest> ArenaServer::serve_one() {
  if (!await_readable(socket_.get(), kServeTimeoutMs))
    return Error{ErrorCode::kTimeout, "no process joined " + name_};
  const Descriptor peer(accept4(socket_.get(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
  if (peer.get() < 0) {
    if (errno == EAGAIN || errno == EINTR || errno == ECONNABORTED)
      return Error{ErrorCode::kTimeout, "no process joined " + name_};
    return system_error("accepting a process that joins " + name_);
  }
  const auto refuse = [&peer](const std::string& why) -> Error {
    (void)send_reply(peer.get(), why, -1);  // the peer may be gone; the refusal stands either way
    return Error{ErrorCode::kBadInput, "a process that wanted to join was refused: " + why};
  };
  if (!is_same_user(peer.get())) return refuse("it runs as another user");
  if (!await_readable(peer.get(), kServeTimeoutMs))
    return Error{ErrorCode::kTimeout, "a process connected to " + name_ + " and stayed silent"};
  JoinRequest request;
  // MSG_TRUNC makes recv return the datagram's true length, so a longer one is noticed as well.
  const ssize_t size = recv(peer.get(), &request, sizeof request, MSG_TRUNC | MSG_DONTWAIT);
  if (size == 0) return Error{ErrorCode::kPeerLost, "a process connected to " + name_ + " and left"};
  if (size < 0) return system_error("hearing a process that joins " + name_);
  if (size != static_cast<ssize_t>(sizeof request) || request.magic != kArenaMagic)
    return refuse("it does not speak the joining protocol");
  if (request.arena_version != kArenaVersion)
    return refuse(fmt::format("its arena version is {}, the run's is {}; start all programs from one build",
                              request.arena_version, kArenaVersion));
  request.role[sizeof request.role - 1] = '\0';
  COMRAD_TRY(send_reply(peer.get(), "", arena_.get()));
  return request;
}

Expected<Arena> join_arena(const std::string& name, const JoinRequest& request, int timeout_ms) {
  COMRAD_TRY_ASSIGN(const AbstractAddress address, abstract_address(name));
  const int64_t deadline_ns = monotonic_ns() + int64_t{timeout_ms} * 1'000'000;
  for (;;) {
    const Descriptor peer(socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
    if (peer.get() < 0) return system_error("socket for run " + name);
    if (connect(peer.get(), reinterpret_cast<const sockaddr*>(&address.bytes), address.length) != 0) {
      if (errno != ECONNREFUSED && errno != EAGAIN && errno != EINTR)
        return system_error("joining run " + name);
      if (monotonic_ns() >= deadline_ns)
        return Error{ErrorCode::kNotFound,
                     "no run listens on " + name + "; start it first (comrad train), or check the name"};
      usleep(kRetryUs);
      continue;
    }
    // Any process may take an abstract name; an arena is accepted only from a process of our own user.
    if (!is_same_user(peer.get()))
      return Error{ErrorCode::kBadInput, "joining run " + name + ": the socket belongs to another user"};
    if (send(peer.get(), &request, sizeof request, MSG_NOSIGNAL) != static_cast<ssize_t>(sizeof request))
      return system_error("joining run " + name);
    if (!await_readable(peer.get(), std::max<int64_t>(0, (deadline_ns - monotonic_ns()) / 1'000'000)))
      return Error{ErrorCode::kTimeout,
                   fmt::format("joining run {}: no answer within {} ms; the supervisor hangs or is stopped",
                               name, timeout_ms)};
    COMRAD_TRY_ASSIGN(const int descriptor, receive_arena(peer.get(), name));
    return Arena::adopt(descriptor);
  }
}

}  // namespace comrad::shm
