#include "sim_workers/watch/page_link.h"

#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <utility>

#include "rollout_buffer/core/abstract_address.h"

namespace comrad::sim {
namespace {

constexpr std::size_t kWaitingBytesForPictures = 64 << 10;
constexpr std::size_t kWaitingBytesMax = 32 << 20;

}  // namespace

Expected<PageLink> PageLink::connect(const std::string& name) {
  COMRAD_TRY_ASSIGN(const AbstractAddress address, abstract_address(name));
  Descriptor socket(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  if (!socket.is_open() ||
      ::connect(socket.get(), reinterpret_cast<const sockaddr*>(&address.bytes), address.length) != 0)
    return Error{ErrorCode::kNotFound,
                 "no process listens on " + name + "; comrad watch or comrad play starts this program"};
  if (!is_same_user(socket.get())) return Error{ErrorCode::kBadInput, name + " belongs to another user"};
  return PageLink(std::move(socket));
}

bool PageLink::takes_pictures() {
  flush();
  return !is_closed_ && waiting_.size() < kWaitingBytesForPictures;
}

void PageLink::send(const nlohmann::json& words) {
  append(WatchKind::kWords, words.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
}

void PageLink::send_picture(int agent, std::string_view jpeg) {
  append(static_cast<WatchKind>(static_cast<int>(WatchKind::kPicture) + agent), jpeg);
}

void PageLink::append(WatchKind kind, std::string_view payload) {
  if (is_closed_ || payload.size() > kWatchMessageBytesMax) return;
  const WatchHead head{.bytes = static_cast<uint32_t>(payload.size()), .kind = static_cast<uint8_t>(kind)};
  waiting_.append(reinterpret_cast<const char*>(&head), sizeof head);
  waiting_ += payload;
  flush();
  is_closed_ |= waiting_.size() > kWaitingBytesMax;
}

void PageLink::flush() {
  std::size_t sent = 0;
  while (!is_closed_ && sent < waiting_.size()) {
    const ssize_t size =
        ::send(socket_.get(), waiting_.data() + sent, waiting_.size() - sent, MSG_NOSIGNAL | MSG_DONTWAIT);
    if (size < 0 && errno == EINTR) continue;
    if (size < 0 && errno == EAGAIN) break;
    is_closed_ |= size < 0;
    if (size > 0) sent += static_cast<std::size_t>(size);
  }
  waiting_.erase(0, sent);
}

std::vector<nlohmann::json> PageLink::commands(int wait_ms) {
  std::vector<nlohmann::json> commands;
  flush();
  pollfd one{.fd = socket_.get(), .events = POLLIN, .revents = 0};
  if (!waiting_.empty()) one.events |= POLLOUT;
  if (is_closed_ || poll(&one, 1, wait_ms) <= 0) return commands;
  flush();
  char bytes[4096];
  for (;;) {
    const ssize_t size = recv(socket_.get(), bytes, sizeof bytes, MSG_DONTWAIT);
    if (size < 0 && errno == EINTR) continue;
    if (size < 0 && errno == EAGAIN) break;
    if (size <= 0) {
      is_closed_ = true;
      break;
    }
    received_.append(bytes, static_cast<std::size_t>(size));
  }
  std::size_t end;
  while ((end = received_.find('\n')) != std::string::npos) {
    nlohmann::json command =
        nlohmann::json::parse(received_.substr(0, end), nullptr, /*allow_exceptions=*/false);
    received_.erase(0, end + 1);
    if (command.is_object()) commands.push_back(std::move(command));
  }
  if (received_.size() > kWatchCommandBytesMax) received_.clear();
  return commands;
}

}  // namespace comrad::sim
