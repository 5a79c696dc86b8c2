// The other end of a PageLink: the process that shows what a simulator plays.
#pragma once

#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "rollout_buffer/core/abstract_address.h"
#include "rollout_buffer/schema/watch_message.h"
#include "sim_workers/watch/page_link.h"
#include "tests/support/patience.h"

namespace comrad::test {

class WatchPage {
 public:
  WatchPage() : listener_(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    const auto address = abstract_address(name_);
    EXPECT_EQ(bind(listener_, reinterpret_cast<const sockaddr*>(&address->bytes), address->length), 0);
    EXPECT_EQ(listen(listener_, 1), 0);
  }
  ~WatchPage() {
    close(listener_);
    leave();
  }

  const std::string& name() const { return name_; }
  int socket_of_page() const { return page_; }
  sim::PageLink connected() {
    Expected<sim::PageLink> link = sim::PageLink::connect(name_);
    EXPECT_TRUE(link) << link.error().message;
    page_ = accept(listener_, nullptr, nullptr);
    return std::move(link).value();
  }
  void say(const std::string& text) {
    ASSERT_EQ(send(page_, text.data(), text.size(), MSG_NOSIGNAL), static_cast<ssize_t>(text.size()));
  }
  void leave() {
    if (page_ >= 0) close(std::exchange(page_, -1));
  }
  /// The next words, pictures left out; null, with a failure noted, where none come.
  nlohmann::json words() {
    for (const double end_s = deadline_s(); monotonic_s() < end_s;) {
      WatchHead head;
      std::string payload;
      if (!receive(&head, sizeof head, end_s)) break;
      payload.resize(head.bytes);
      if (!receive(payload.data(), payload.size(), end_s)) break;
      if (head.kind == static_cast<uint8_t>(WatchKind::kWords))
        return nlohmann::json::parse(payload, nullptr, /*allow_exceptions=*/false);
    }
    ADD_FAILURE() << "no words come";
    return nullptr;
  }

 private:
  bool receive(void* bytes, std::size_t size, double end_s) {
    for (std::size_t got = 0; got < size;) {
      pollfd one{.fd = page_, .events = POLLIN, .revents = 0};
      if (poll(&one, 1, 100) == 0 && monotonic_s() < end_s) continue;
      const ssize_t more = recv(page_, static_cast<char*>(bytes) + got, size - got, MSG_DONTWAIT);
      if (more <= 0) return false;
      got += static_cast<std::size_t>(more);
    }
    return true;
  }

  const std::string name_ = "comrad-watch-page-test" + std::to_string(getpid());
  int listener_, page_ = -1;
};

}  // namespace comrad::test
