#include "deploy/watch/session.h"

#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstring>
#include <utility>

#include "deploy/process/reply_server.h"
#include "rollout_buffer/core/abstract_address.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/schema/watch_message.h"

namespace comrad::deploy {
namespace {

constexpr double kEndS = 200;  // that processes may take to end, which leave the cores to others
constexpr int kAgentsMax = 8;

/// "comrad eval: error: words" without what names the program.
std::string without_program(const std::string& line) {
  const std::size_t at = line.find("error: ");
  return at == std::string::npos ? line : line.substr(at + std::strlen("error: "));
}

}  // namespace

Session::~Session() {
  leave();
  const double deadline_s = monotonic_s() + kEndS;
  for (ChildProcess& process : leaving_)
    while (!process.poll_exit() && monotonic_s() < deadline_s) {
      process.read_lines();
      usleep(20'000);
    }
}

void Session::close_link() {
  if (link_.is_open()) server_.forget(link_.get());
  if (listener_.is_open()) server_.forget(listener_.get());
  link_.close();
  listener_.close();
  received_.clear();
}

void Session::leave() {
  close_link();
  if (!process_) return;
  process_->send_signal(SIGTERM);
  leaving_.push_back(std::move(*process_));
  process_.reset();
}

Status Session::start(const std::string& program, std::vector<std::string> arguments) {
  leave();
  last_words_.clear();
  state_ = State::kEnded;
  const std::string name = "comrad-page-" + make_token();
  COMRAD_TRY_ASSIGN(listener_, listen_on_name(name));
  server_.listen_to(listener_.get(), [this] { accept(); });
  arguments.insert(arguments.end(), {"--page", name});
  ChildOptions options;
  options.program = program;
  options.arguments = std::move(arguments);
  COMRAD_TRY_ASSIGN(process_, ChildProcess::spawn(options));
  state_ = State::kStarting;
  return {};
}

void Session::accept() {
  Descriptor client(accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
  if (!client.is_open() || link_.is_open() || !is_same_user(client.get())) return;
  link_ = std::move(client);
  server_.listen_to(link_.get(), [this] { read(); });
  state_ = State::kPlaying;
}

void Session::read() {
  char bytes[1 << 16];
  for (int turn = 0; turn < 16; ++turn) {
    const ssize_t size = recv(link_.get(), bytes, sizeof bytes, MSG_DONTWAIT);
    if (size < 0 && (errno == EAGAIN || errno == EINTR)) break;
    if (size <= 0) return close_link();
    received_.append(bytes, static_cast<std::size_t>(size));
  }
  std::size_t at = 0;
  WatchHead head;
  while (received_.size() - at >= sizeof head) {
    std::memcpy(&head, received_.data() + at, sizeof head);
    if (head.bytes > kWatchMessageBytesMax) return close_link();
    if (received_.size() - at - sizeof head < head.bytes) break;
    const std::string_view payload = std::string_view(received_).substr(at + sizeof head, head.bytes);
    at += sizeof head + head.bytes;
    const int agent = head.kind - static_cast<int>(WatchKind::kPicture);
    if (agent >= 0 && agent < kAgentsMax) {
      heard_.picture(agent, payload);
    } else if (head.kind == static_cast<uint8_t>(WatchKind::kWords)) {
      nlohmann::json words = nlohmann::json::parse(payload, nullptr, /*allow_exceptions=*/false);
      if (words.is_object()) heard_.words(std::move(words));
    }
  }
  received_.erase(0, at);
}

void Session::tell(const nlohmann::json& command) {
  if (!link_.is_open()) return;
  const std::string line = command.dump() + "\n";
  // What does not fit is lost: the simulator does not read, so it does not play either.
  (void)!send(link_.get(), line.data(), line.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
}

void Session::tick() {
  std::erase_if(leaving_, [](ChildProcess& process) {
    process.read_lines();
    return process.poll_exit().has_value();
  });
  if (!process_) return;
  const bool has_ended = process_->poll_exit().has_value();
  for (const std::string& line : process_->read_lines())
    if (!line.empty()) last_words_ = without_program(line);
  if (!has_ended) return;
  if (last_words_.empty()) last_words_ = "the game ended: " + process_->poll_exit()->text();
  close_link();
  process_.reset();
  state_ = State::kEnded;
}

}  // namespace comrad::deploy
