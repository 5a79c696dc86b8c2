// Abstract Unix addresses: names of sockets that are in no file system and vanish with the socket. Stage: loading.
#pragma once

#include <sys/socket.h>
#include <sys/un.h>

#include <cstddef>
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

}  // namespace comrad
