#include "sim_workers/watch/page_link.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>

#include <cstring>

#include "tests/support/watch_page.h"

namespace comrad::sim {
namespace page_link_test {

TEST(PageLink, SendsWordsAndPicturesBehindTheirHeads) {
  test::WatchPage page;
  PageLink link = page.connected();
  link.send({{"a", 1}});
  link.send_picture(3, "jpeg");
  char bytes[64];
  ASSERT_EQ(recv(page.socket_of_page(), bytes, sizeof bytes, MSG_WAITALL | MSG_DONTWAIT), 8 + 7 + 8 + 4);
  WatchHead head;
  std::memcpy(&head, bytes, sizeof head);
  EXPECT_EQ(head.bytes, 7u);
  EXPECT_EQ(head.kind, static_cast<uint8_t>(WatchKind::kWords));
  EXPECT_EQ(std::string(bytes + 8, 7), R"({"a":1})");
  std::memcpy(&head, bytes + 15, sizeof head);
  EXPECT_EQ(head.bytes, 4u);
  EXPECT_EQ(head.kind, static_cast<uint8_t>(WatchKind::kPicture) + 3);
}

TEST(PageLink, HearsCommandsHoweverTheyComeAndSkipsNonsense) {
  test::WatchPage page;
  PageLink link = page.connected();
  EXPECT_TRUE(link.commands(0).empty());
  page.say("{\"do\": \"pause\"}\nnonsense\n[1]\n{\"do\"");
  EXPECT_EQ(link.commands(1000).size(), 1u);
  page.say(": \"run\"}\n");
  const auto commands = link.commands(1000);
  ASSERT_EQ(commands.size(), 1u);
  EXPECT_EQ(commands[0]["do"], "run");
  page.say(std::string(100'000, 'x'));
  for (int turn = 0; turn < 100; ++turn) link.commands(10);
  page.say("\n{\"do\": \"step\"}\n");
  EXPECT_EQ(link.commands(1000).size(), 1u) << "what is too long is dropped";
}

TEST(PageLink, NeverWaitsForAPageThatDoesNotRead) {
  test::WatchPage page;
  PageLink link = page.connected();
  EXPECT_TRUE(link.takes_pictures());
  const std::string picture(1 << 20, 'p');
  for (int count = 0; count < 100 && link.takes_pictures(); ++count) link.send_picture(0, picture);
  EXPECT_FALSE(link.takes_pictures());
  EXPECT_FALSE(link.is_closed());
  for (int count = 0; count < 100; ++count) link.send_picture(0, picture);
  EXPECT_TRUE(link.is_closed()) << "it read nothing for too long";
}

TEST(PageLink, NoticesThatThePageLeaves) {
  test::WatchPage page;
  PageLink link = page.connected();
  page.leave();
  link.commands(1000);
  EXPECT_TRUE(link.is_closed());
  link.send({{"more", 1}});
  EXPECT_FALSE(PageLink::connect(page.name() + "-none"));
}

}  // namespace page_link_test
}  // namespace comrad::sim
