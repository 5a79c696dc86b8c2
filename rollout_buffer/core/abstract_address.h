// Abstract Unix addresses: names of sockets that are in no file system and vanish with the socket. Any user may take one, so the
// kernel reports the peer. Stage: loading.
#pragma once

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>

#include "rollout_buffer/core/expected.h"

namespace comrad {

/// A zero byte, then the name.
struct AbstractAddress {
  sockaddr_un bytes{};
  socklen_t length = 0;
};

/// Errors: kBadInput where the name is empty or too long.
inline Expected<AbstractAddress> abstract_address(const std::string& name) {
  AbstractAddress address;
  if (name.empty() || name.size() > sizeof address.bytes.sun_path - 1)
    return Error{ErrorCode::kBadInput, "socket name '" + name + "' must have 1 to " +
                                           std::to_string(sizeof address.bytes.sun_path - 1) + " characters"};
  address.bytes.sun_family = AF_UNIX;
  std::memcpy(address.bytes.sun_path + 1, name.data(), name.size());
  address.length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + name.size());
  return address;
}

/// The user and process at the other end of a connected Unix socket; -1 where the kernel does not report it.
struct Peer {
  int64_t user = -1;
  int64_t pid = -1;
};
inline Peer peer_of(int descriptor) {
  ucred peer{};
  socklen_t size = sizeof peer;
  if (getsockopt(descriptor, SOL_SOCKET, SO_PEERCRED, &peer, &size) != 0 || size != sizeof peer) return {};
  return {.user = peer.uid, .pid = peer.pid};
}
inline bool is_same_user(int descriptor) {
  return peer_of(descriptor).user == static_cast<int64_t>(geteuid());
}

}  // namespace comrad
