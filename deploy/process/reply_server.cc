#include "deploy/process/reply_server.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <spdlog/fmt/fmt.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <utility>

#include "rollout_buffer/core/abstract_address.h"
#include "rollout_buffer/core/files.h"

namespace comrad::deploy {
namespace {

constexpr int kQueue = 64;

}  // namespace

ReplyServer::ReplyServer(Descriptor listener, ReplyRules rules, const ReplyLimits& limits)
    : listener_(std::move(listener)), rules_(std::move(rules)), limits_(limits) {}

void ReplyServer::tick(double now_s) {
  accept_clients(now_s);
  for (Client& client : clients_) {
    read(client);
    write(client);
    client.is_over |= now_s - client.began_s > limits_.seconds;
  }
  std::erase_if(clients_, [](const Client& client) { return client.is_over; });
}

void ReplyServer::accept_clients(double now_s) {
  while (clients_.size() < limits_.connections) {
    Descriptor client(accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
    if (!client.is_open()) return;
    Client& entry = clients_.emplace_back();
    entry.descriptor = std::move(client);
    entry.began_s = now_s;
    if (rules_.refusal) entry.answer = rules_.refusal(entry.descriptor.get());
  }
}

/// What comes after the answer has begun is thrown away: the client has asked.
void ReplyServer::read(Client& client) const {
  char bytes[2048];
  bool has_ended = false;
  for (int turn = 0; turn < 4 && !has_ended; ++turn) {
    const ssize_t size = recv(client.descriptor.get(), bytes, sizeof bytes, MSG_DONTWAIT);
    if (size < 0 && (errno == EAGAIN || errno == EINTR)) break;
    has_ended = size <= 0;
    client.is_over |= size < 0;
    if (size > 0 && client.answer.empty()) client.request.append(bytes, static_cast<std::size_t>(size));
  }
  if (client.is_over) return;
  if (!client.answer.empty()) {
    client.is_over = has_ended && client.sent == client.answer.size();
  } else if (client.request.size() > limits_.request_bytes) {
    client.is_over = true;
  } else if (rules_.is_whole(client.request)) {
    client.answer = rules_.answer(client.request);
    client.is_over = client.answer.empty();
  } else {
    client.is_over = has_ended;
  }
}

void ReplyServer::write(Client& client) const {
  if (client.is_over || client.sent == client.answer.size()) return;
  const ssize_t size = send(client.descriptor.get(), client.answer.data() + client.sent,
                            client.answer.size() - client.sent, MSG_NOSIGNAL | MSG_DONTWAIT);
  if (size < 0) {
    client.is_over = errno != EAGAIN && errno != EINTR;
    return;
  }
  client.sent += static_cast<std::size_t>(size);
  // The client ends the connection: if we did, what it still sends would cut our answer off.
  if (client.sent == client.answer.size()) shutdown(client.descriptor.get(), SHUT_WR);
}

Expected<Descriptor> listen_on_address(const std::string& host, int port) {
  Descriptor listener(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (!listener.is_open()) return system_error("a socket");
  const std::string place = fmt::format("{}:{}", host, port);
  const int yes = 1;
  setsockopt(listener.get(), SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  if (inet_pton(AF_INET, host.c_str(), &address.sin_addr) != 1)
    return Error{ErrorCode::kBadInput, "'" + host + "' is no IPv4 address"};
  if (bind(listener.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
      listen(listener.get(), kQueue) != 0) {
    if (errno == EADDRINUSE) return Error{ErrorCode::kBadInput, place + " is taken by another process"};
    if (errno == EACCES)
      return Error{ErrorCode::kBadInput, place + " is kept for root; choose one from 1024 on"};
    if (errno == EADDRNOTAVAIL)
      return Error{ErrorCode::kBadInput, host + " is no address of this machine; `ip address` lists them"};
    return system_error(place);
  }
  return listener;
}

Expected<Descriptor> listen_on_name(const std::string& name) {
  COMRAD_TRY_ASSIGN(const AbstractAddress address, abstract_address(name));
  Descriptor listener(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (!listener.is_open() ||
      bind(listener.get(), reinterpret_cast<const sockaddr*>(&address.bytes), address.length) != 0 ||
      listen(listener.get(), kQueue) != 0)
    return system_error("socket " + name);
  return listener;
}

Expected<Descriptor> connect_to_name(const std::string& name) {
  COMRAD_TRY_ASSIGN(const AbstractAddress address, abstract_address(name));
  Descriptor client(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (!client.is_open()) return system_error("a socket");
  if (connect(client.get(), reinterpret_cast<const sockaddr*>(&address.bytes), address.length) == 0)
    return client;
  if (errno == ECONNREFUSED) return Error{ErrorCode::kNotFound, "no process listens on " + name};
  if (errno == EAGAIN) return Error{ErrorCode::kTimeout, "too many clients wait at " + name};
  return system_error("socket " + name);
}

}  // namespace comrad::deploy
