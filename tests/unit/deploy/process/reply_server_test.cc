#include "deploy/process/reply_server.h"
#include "rollout_buffer/core/abstract_address.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstring>

namespace comrad::deploy {
namespace reply_server_test {

using ::testing::HasSubstr;

constexpr const char* kName = "comrad-reply-server-test";

class ReplyServerTest : public ::testing::Test {
 protected:
  ReplyServer server(const ReplyLimits& limits = {}) {
    return ReplyServer(std::move(listen_on_name(name_)).value(),
                       {.is_whole = [](std::string_view text) { return text.ends_with('\n'); },
                        .answer =
                            [this](std::string_view text) {
                              return "you said " + std::string(text) + std::string(extra_, '.');
                            },
                        .refusal = [this](int) { return refusal_; }},
                       limits);
  }
  Descriptor client() const { return std::move(connect_to_name(name_)).value(); }
  static void say(const Descriptor& client, const std::string& text) {
    ASSERT_EQ(send(client.get(), text.data(), text.size(), MSG_NOSIGNAL), static_cast<ssize_t>(text.size()));
  }
  /// What has arrived; "<end>" where the other side is gone.
  static std::string heard(const Descriptor& client) {
    char bytes[65536];
    const ssize_t size = recv(client.get(), bytes, sizeof bytes, MSG_DONTWAIT);
    return size > 0 ? std::string(bytes, static_cast<std::size_t>(size)) : size == 0 ? "<end>" : "";
  }

  const std::string name_ = std::string(kName) + std::to_string(getpid());
  std::string refusal_;
  std::size_t extra_ = 0;
};

TEST_F(ReplyServerTest, AnswersAWholeRequestHoweverItComes) {
  ReplyServer server = this->server();
  const Descriptor one = client(), two = client();
  say(one, "good day\n");
  say(two, "good");
  server.tick(0);
  EXPECT_EQ(heard(one), "you said good day\n");
  EXPECT_EQ(heard(one), "<end>");
  EXPECT_EQ(heard(two), "");
  say(two, " evening\n");
  shutdown(two.get(), SHUT_WR);  // as `nc -N` does
  server.tick(0.1);
  EXPECT_EQ(heard(two), "you said good evening\n");
}

TEST_F(ReplyServerTest, DropsAClientThatIsSilentSendsTooMuchOrLeaves) {
  ReplyServer server = this->server({.connections = 8, .request_bytes = 100, .seconds = 2});
  const Descriptor silent = client(), chatty = client();
  {
    const Descriptor gone = client();
    say(gone, "half a req");
  }
  say(chatty, std::string(101, 'x'));
  server.tick(0);
  EXPECT_EQ(heard(chatty), "<end>");
  EXPECT_EQ(heard(silent), "");
  server.tick(1.9);
  EXPECT_EQ(heard(silent), "");
  server.tick(2.1);
  EXPECT_EQ(heard(silent), "<end>");
}

TEST_F(ReplyServerTest, AClientThatDoesNotReadBlocksNoOther) {
  ReplyServer server = this->server();
  extra_ = 8 << 20;  // more than a socket holds
  const Descriptor deaf = client();
  say(deaf, "much\n");
  server.tick(0);
  extra_ = 0;
  const Descriptor other = client();
  say(other, "little\n");
  server.tick(0.1);
  EXPECT_EQ(heard(other), "you said little\n");
  std::size_t bytes = 0;
  for (double now_s = 0.2; now_s < 1.9; now_s += 0.001) {  // it reads at last, and gets what is its own
    for (std::string more; !(more = heard(deaf)).empty() && more != "<end>";) bytes += more.size();
    server.tick(now_s);
  }
  EXPECT_EQ(bytes, (8u << 20) + std::strlen("you said much\n"));
}

TEST_F(ReplyServerTest, OfManySilentClientsAFewAreHeldAndTheNextOnesServed) {
  ReplyServer server = this->server({.connections = 4, .seconds = 1});
  std::vector<Descriptor> silent;
  for (int count = 0; count < 20; ++count) silent.push_back(client());
  const Descriptor asking = client();
  say(asking, "me\n");
  for (double now_s = 0; now_s < 7; now_s += 0.05) server.tick(now_s);
  EXPECT_EQ(heard(asking), "you said me\n") << "served when the silent ones were dropped";
}

TEST_F(ReplyServerTest, ARefusalIsTheAnswer) {
  ReplyServer server = this->server();
  refusal_ = "not you\n";
  const Descriptor unknown = client();
  say(unknown, "open\n");
  server.tick(0);
  EXPECT_EQ(heard(unknown), "not you\n");
}

TEST_F(ReplyServerTest, ReportsThePeerAndWhatIsTaken) {
  ReplyServer server = this->server();
  const Descriptor one = client();
  EXPECT_EQ(peer_of(one.get()).user, static_cast<int64_t>(geteuid()));
  EXPECT_EQ(peer_of(one.get()).pid, static_cast<int64_t>(getpid()));
  EXPECT_FALSE(listen_on_name(name_)) << "taken";
  const auto nobody = connect_to_name(name_ + "-none");
  ASSERT_FALSE(nobody);
  EXPECT_EQ(nobody.error().code, ErrorCode::kNotFound);
}

TEST(ListenOnAddress, APortIsOfItsAddressAloneAndATakenOneIsNamed) {
  const Expected<Descriptor> first = listen_on_address("127.0.0.1", 0);
  ASSERT_TRUE(first) << first.error().message;
  sockaddr_in address{};
  socklen_t size = sizeof address;
  ASSERT_EQ(getsockname(first->get(), reinterpret_cast<sockaddr*>(&address), &size), 0);
  EXPECT_EQ(address.sin_addr.s_addr, htonl(INADDR_LOOPBACK));
  const Expected<Descriptor> second = listen_on_address("127.0.0.1", ntohs(address.sin_port));
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, ErrorCode::kBadInput);
  EXPECT_THAT(second.error().message, HasSubstr("is taken by another process"));
  for (const char* word : {"localhost", "192.0.2.1", "127.0.0", ""}) {
    const Expected<Descriptor> refused = listen_on_address(word, 0);
    ASSERT_FALSE(refused) << word;
    EXPECT_EQ(refused.error().code, ErrorCode::kBadInput) << word;
  }
}

}  // namespace reply_server_test
}  // namespace comrad::deploy
