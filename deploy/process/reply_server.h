// Answers short questions at a listening socket, one question and one answer a connection, and never blocks on its client: a
// client that is slow, sends nothing, sends too much or leaves costs a few system calls a turn and is dropped after a while.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "deploy/process/process_start.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// What clients may take.
struct ReplyLimits {
  std::size_t connections = 16;      ///< at a time; others wait in the kernel's queue
  std::size_t request_bytes = 4096;  ///< a longer one is dropped
  double seconds = 2;                ///< from the connection to its end
};

/// How requests are read and answered.
struct ReplyRules {
  /// Whether this is a whole request.
  std::function<bool(std::string_view)> is_whole;
  std::function<std::string(std::string_view)> answer;
  /// Of a connection that was accepted: why it is refused, as the answer that it gets; empty: it is not. May be null.
  std::function<std::string(int descriptor)> refusal = nullptr;
};

/// Threads: one.
class ReplyServer {
 public:
  /// `listener` is a non-blocking stream socket that listens.
  ReplyServer(Descriptor listener, ReplyRules rules, const ReplyLimits& limits = {});

  /// One turn: accepts, reads, answers and drops. Never blocks.
  void tick(double now_s);

 private:
  struct Client {
    Descriptor descriptor;
    std::string request, answer;  // an empty answer: still reading
    std::size_t sent = 0;
    double began_s = 0;
    bool is_over = false;
  };
  void accept_clients(double now_s);
  void read(Client& client) const;
  void write(Client& client) const;

  Descriptor listener_;
  ReplyRules rules_;
  ReplyLimits limits_;
  std::vector<Client> clients_;
};

/// A listening socket on a port of an IPv4 address of this machine; port 0: any. Errors: kBadInput where the address is none of this
/// machine's or the port is taken, kSystem.
Expected<Descriptor> listen_on_address(const std::string& address, int port);
/// One that listens under an abstract name, which vanishes with it. Errors: kSystem.
Expected<Descriptor> listen_on_name(const std::string& name);
/// A connection to such a name. Errors: kNotFound where no process listens, kTimeout, kSystem.
Expected<Descriptor> connect_to_name(const std::string& name);

}  // namespace comrad::deploy
