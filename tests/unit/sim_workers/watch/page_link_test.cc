#include "sim_workers/watch/page_link.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstring>

#include "rollout_buffer/core/abstract_address.h"

namespace comrad::sim {
namespace page_link_test {

/// The other end.
class PageLinkTest : public ::testing::Test {
 protected:
  PageLinkTest() : listener_(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    const auto address = abstract_address(name_);
    EXPECT_EQ(bind(listener_, reinterpret_cast<const sockaddr*>(&address->bytes), address->length), 0);
    EXPECT_EQ(listen(listener_, 1), 0);
  }
  ~PageLinkTest() override {
    close(listener_);
    if (page_ >= 0) close(page_);
  }
  PageLink connected() {
    Expected<PageLink> link = PageLink::connect(name_);
    EXPECT_TRUE(link) << link.error().message;
    page_ = accept(listener_, nullptr, nullptr);
    return std::move(link).value();
  }
  void say(const std::string& text) {
    ASSERT_EQ(send(page_, text.data(), text.size(), MSG_NOSIGNAL), static_cast<ssize_t>(text.size()));
  }
  const std::string name_ = "comrad-page-link-test" + std::to_string(getpid());
  int listener_, page_ = -1;
};

TEST_F(PageLinkTest, SendsWordsAndPicturesBehindTheirHeads) {
  PageLink link = connected();
  link.send({{"a", 1}});
  link.send_picture(3, "jpeg");
  char bytes[64];
  ASSERT_EQ(recv(page_, bytes, sizeof bytes, MSG_WAITALL | MSG_DONTWAIT), 8 + 7 + 8 + 4);
  WatchHead head;
  std::memcpy(&head, bytes, sizeof head);
  EXPECT_EQ(head.bytes, 7u);
  EXPECT_EQ(head.kind, static_cast<uint8_t>(WatchKind::kWords));
  EXPECT_EQ(std::string(bytes + 8, 7), R"({"a":1})");
  std::memcpy(&head, bytes + 15, sizeof head);
  EXPECT_EQ(head.bytes, 4u);
  EXPECT_EQ(head.kind, static_cast<uint8_t>(WatchKind::kPicture) + 3);
}

TEST_F(PageLinkTest, HearsCommandsHoweverTheyComeAndSkipsNonsense) {
  PageLink link = connected();
  EXPECT_TRUE(link.commands(0).empty());
  say("{\"do\": \"pause\"}\nnonsense\n[1]\n{\"do\"");
  EXPECT_EQ(link.commands(1000).size(), 1u);
  say(": \"run\"}\n");
  const auto commands = link.commands(1000);
  ASSERT_EQ(commands.size(), 1u);
  EXPECT_EQ(commands[0]["do"], "run");
  say(std::string(100'000, 'x'));
  for (int turn = 0; turn < 100; ++turn) link.commands(10);
  say("\n{\"do\": \"step\"}\n");
  EXPECT_EQ(link.commands(1000).size(), 1u) << "what is too long is dropped";
}

TEST_F(PageLinkTest, NeverWaitsForAPageThatDoesNotRead) {
  PageLink link = connected();
  EXPECT_TRUE(link.takes_pictures());
  const std::string picture(1 << 20, 'p');
  for (int count = 0; count < 100 && link.takes_pictures(); ++count) link.send_picture(0, picture);
  EXPECT_FALSE(link.takes_pictures());
  EXPECT_FALSE(link.is_closed());
  for (int count = 0; count < 100; ++count) link.send_picture(0, picture);
  EXPECT_TRUE(link.is_closed()) << "it read nothing for too long";
}

TEST_F(PageLinkTest, NoticesThatThePageLeaves) {
  PageLink link = connected();
  close(std::exchange(page_, -1));
  link.commands(1000);
  EXPECT_TRUE(link.is_closed());
  link.send({{"more", 1}});
  EXPECT_FALSE(PageLink::connect(name_ + "-none"));
}

}  // namespace page_link_test
}  // namespace comrad::sim
