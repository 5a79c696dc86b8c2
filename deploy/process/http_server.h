// Serves pages and WebSockets to browsers on this machine, for the Prometheus page of a run, `comrad watch` and `comrad play`.
// Boost.Beast, which reads HTTP and speaks WebSocket, has its home here.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "deploy/process/process_start.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// What clients may take.
struct HttpLimits {
  std::size_t connections = 32;         ///< at a time; others wait in the kernel's queue
  std::size_t head_bytes = 8192;        ///< of a request's first line and headers
  std::size_t body_bytes = 4096;        ///< of a request's body, and of a WebSocket's message
  double seconds = 2;                   ///< from a connection to the end of its answer
  double silent_s = 20;                 ///< without a sign of life from the other end of a WebSocket
  int messages_per_s = 200;             ///< that one WebSocket may send
  std::size_t picture_bytes = 1 << 19;  ///< waiting for one WebSocket; newer pictures are dropped
  std::size_t queue_bytes = 8 << 20;    ///< waiting for one WebSocket, which is closed above
};

struct HttpRequest {
  std::string method, path;
  std::string query;  ///< behind the '?'
  std::string body;
  /// The decoded value of a name of the query; empty where it is not in it.
  std::string value(std::string_view name) const;
};

struct HttpReply {
  unsigned status = 200;
  std::string type = "text/plain; charset=utf-8";
  std::string body;
};

/// A WebSocket that is open; never used again.
using SocketId = uint64_t;

/// What is served, and to which clients.
struct HttpRules {
  std::vector<std::string> tokens = {};  ///< a request's query must hold one as `token`; none: none is needed
  std::string address = {};              ///< beside 127.0.0.1, localhost and [::1] a Host that is not refused
  std::function<HttpReply(const HttpRequest&)> answer;
  /// Of a WebSocket: why it is refused, or status 200. Null: there are none.
  std::function<HttpReply(SocketId, const HttpRequest&)> open = nullptr;
  std::function<void(SocketId, std::string_view message)> heard = nullptr;  ///< a text message
  std::function<void(SocketId)> closed = nullptr;
};

/// The reply to a request's bytes, as the server sends it, with status 400 for what is no HTTP request. Threads: pure function.
std::string http_answer(std::string_view bytes, const HttpRules& rules, const HttpLimits& limits = {});

/// A random word that cannot be guessed: 32 hexadecimal digits.
std::string make_token();

/// Threads: one. Functions of the rules are called within tick() and wait(); they may send() and close().
class HttpServer {
 public:
  /// Listens on a port of an IPv4 address of this machine; port 0: any that is free. Errors: kBadInput where the address
  /// is none of this machine's or the port is taken, kSystem.
  static Expected<HttpServer> open(const std::string& address, int port, HttpRules rules,
                                   const HttpLimits& limits = {});
  HttpServer(HttpServer&&) noexcept;
  HttpServer& operator=(HttpServer&&) noexcept;
  ~HttpServer();

  int port() const;
  /// Does what can be done without waiting.
  void tick();
  /// The same for `seconds`, sleeping while there is nothing to do.
  void wait(double seconds);
  /// Calls `readable` within tick() and wait() whenever `descriptor` has something to read, until forget().
  void listen_to(int descriptor, std::function<void()> readable);
  void forget(int descriptor);

  /// Pictures, which go out as binary messages, and texts that are droppable are dropped where the other end is slow.
  enum class Kind { kText, kDroppableText, kPicture };
  void send(SocketId socket, std::shared_ptr<const std::string> message, Kind kind);
  void close(SocketId socket);

 private:
  struct State;
  explicit HttpServer(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace comrad::deploy
