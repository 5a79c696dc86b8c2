#include "rollout_buffer/shm/arena_socket.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstddef>
#include <cstring>
#include <thread>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/shm/step_slots.h"
#include "tests/support/patience.h"
#include "tests/support/small_arena.h"

namespace comrad::shm {
namespace arena_socket_test {

using ::testing::HasSubstr;

std::string unique_name(const char* test) { return "comrad-test-" + std::to_string(getpid()) + "-" + test; }

Arena make_arena() { return *Arena::create(test::small_arena_shape(), 11); }

constexpr int kLong_ms = 3'600'000;  // of one that is answered

JoinRequest request_of(const char* role, uint32_t index) {
  JoinRequest request;
  std::strncpy(request.role, role, sizeof request.role - 1);
  request.worker_index = index;
  return request;
}

/// A bare connection, for peers that do not keep the protocol.
int connect_raw(const std::string& name) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path + 1, name.data(), name.size());
  const int peer = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
  const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + name.size());
  EXPECT_EQ(connect(peer, reinterpret_cast<sockaddr*>(&address), length), 0);
  return peer;
}

/// serve_one() for a peer whose thread may be slow to begin.
Expected<JoinRequest> serve(ArenaServer& server) {
  Expected<JoinRequest> served = server.serve_one();
  for (const double end_s = test::deadline_s();
       !served && served.error().code == ErrorCode::kTimeout && monotonic_s() < end_s;)
    served = server.serve_one();
  return served;
}

TEST(ArenaSocket, HandsTheArenaOver) {
  const Arena arena = make_arena();
  Expected<ArenaServer> server = ArenaServer::listen(unique_name("join"), arena);
  ASSERT_TRUE(server) << server.error().message;
  arena.step_slots().slot(2).step_id = 1234;
  std::thread peer([&] {
    const Expected<Arena> joined = join_arena(server->name(), request_of("policy", 3), kLong_ms);
    ASSERT_TRUE(joined) << joined.error().message;
    EXPECT_EQ(joined->run_id(), 11u);
    EXPECT_EQ(joined->step_slots().slot(2).step_id, 1234u);
    joined->step_slots().slot(2).step_id = 5678;
  });
  const Expected<JoinRequest> served = serve(*server);
  peer.join();
  ASSERT_TRUE(served) << served.error().message;
  EXPECT_STREQ(served->role, "policy");
  EXPECT_EQ(served->worker_index, 3u);
  EXPECT_EQ(arena.step_slots().slot(2).step_id, 5678u);
}

TEST(ArenaSocket, AJoinerWaitsForARunThatStartsLater) {
  const Arena arena = make_arena();
  const std::string name = unique_name("late");
  std::thread peer([&] { EXPECT_TRUE(join_arena(name, request_of("sim", 0), kLong_ms)); });
  usleep(100'000);
  Expected<ArenaServer> server = ArenaServer::listen(name, arena);
  ASSERT_TRUE(server);
  EXPECT_TRUE(serve(*server));
  peer.join();
}

TEST(ArenaSocket, WithoutAListenerIsNotFound) {
  const Expected<Arena> joined = join_arena(unique_name("absent"), request_of("sim", 0), 100);
  ASSERT_FALSE(joined);
  EXPECT_EQ(joined.error().code, ErrorCode::kNotFound);
  EXPECT_THAT(joined.error().message, HasSubstr("no run listens on"));
}

TEST(ArenaSocket, ATakenNameMeansThatARunIsAlive) {
  const Arena arena = make_arena();
  const Expected<ArenaServer> first = ArenaServer::listen(unique_name("taken"), arena);
  ASSERT_TRUE(first);
  const Expected<ArenaServer> second = ArenaServer::listen(unique_name("taken"), arena);
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, ErrorCode::kSystem);
  EXPECT_THAT(second.error().message, HasSubstr("is alive on this host"));
}

TEST(ArenaSocket, TheNameIsFreeAgainWhenTheServerIsGone) {
  const Arena arena = make_arena();
  for (int round = 0; round < 3; ++round) EXPECT_TRUE(ArenaServer::listen(unique_name("again"), arena));
}

TEST(ArenaSocket, BadNamesAreRefused) {
  const Arena arena = make_arena();
  EXPECT_FALSE(ArenaServer::listen("", arena));
  EXPECT_FALSE(ArenaServer::listen(std::string(200, 'x'), arena));
  EXPECT_FALSE(join_arena(std::string(200, 'x'), request_of("sim", 0), 10));
}

TEST(ArenaSocket, AWrongMagicIsRefusedAndTheServerContinues) {
  const Arena arena = make_arena();
  Expected<ArenaServer> server = ArenaServer::listen(unique_name("magic"), arena);
  ASSERT_TRUE(server);
  JoinRequest wrong = request_of("sim", 0);
  wrong.magic = 0x12345678;
  std::thread peer([&] {
    const Expected<Arena> joined = join_arena(server->name(), wrong, 5000);
    ASSERT_FALSE(joined);
    EXPECT_EQ(joined.error().code, ErrorCode::kBadInput);
    EXPECT_THAT(joined.error().message, HasSubstr("refused"));
  });
  const Expected<JoinRequest> refused = serve(*server);
  peer.join();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kBadInput);

  std::thread honest([&] { EXPECT_TRUE(join_arena(server->name(), request_of("sim", 0), 5000)); });
  EXPECT_TRUE(serve(*server));
  honest.join();
}

TEST(ArenaSocket, AnotherLayoutVersionIsRefused) {
  const Arena arena = make_arena();
  Expected<ArenaServer> server = ArenaServer::listen(unique_name("version"), arena);
  ASSERT_TRUE(server);
  JoinRequest wrong = request_of("sim", 0);
  wrong.arena_version = kArenaVersion + 1;
  std::thread peer([&] {
    const Expected<Arena> joined = join_arena(server->name(), wrong, 5000);
    ASSERT_FALSE(joined);
    EXPECT_THAT(joined.error().message, HasSubstr("start all programs from one build"));
  });
  EXPECT_FALSE(serve(*server));
  peer.join();
}

TEST(ArenaSocket, ShortLongAndAbsentRequestsAreRefused) {
  const Arena arena = make_arena();
  Expected<ArenaServer> server = ArenaServer::listen(unique_name("garbage"), arena);
  ASSERT_TRUE(server);
  for (const std::size_t count :
       {std::size_t{1}, sizeof(JoinRequest) - 1, sizeof(JoinRequest) + 1, std::size_t{5000}}) {
    const int peer = connect_raw(server->name());
    std::vector<char> bytes(count, 'x');
    const JoinRequest honest = request_of("sim", 0);
    std::memcpy(bytes.data(), &honest, std::min(count, sizeof honest));
    ASSERT_EQ(send(peer, bytes.data(), count, 0), static_cast<ssize_t>(count));
    EXPECT_FALSE(server->serve_one()) << count << " bytes";
    close(peer);
  }
  close(connect_raw(server->name()));
  const Expected<JoinRequest> left = server->serve_one();
  ASSERT_FALSE(left);
  EXPECT_EQ(left.error().code, ErrorCode::kPeerLost);
}

TEST(ArenaSocket, ASilentPeerIsGivenASecondAndThenUp) {
  const Arena arena = make_arena();
  Expected<ArenaServer> server = ArenaServer::listen(unique_name("silent"), arena);
  ASSERT_TRUE(server);
  const int peer = connect_raw(server->name());
  const double began_s = monotonic_s();
  const Expected<JoinRequest> served = server->serve_one();
  ASSERT_FALSE(served);
  EXPECT_EQ(served.error().code, ErrorCode::kTimeout);
  EXPECT_GT(monotonic_s() - began_s, 0.9);
  close(peer);
}

TEST(ArenaSocket, AJoinerGivesUpOnASilentServer) {
  const Arena arena = make_arena();
  const Expected<ArenaServer> server = ArenaServer::listen(unique_name("deaf"), arena);
  ASSERT_TRUE(server);
  const Expected<Arena> joined = join_arena(server->name(), request_of("sim", 0), 200);
  ASSERT_FALSE(joined);
  EXPECT_EQ(joined.error().code, ErrorCode::kTimeout);
}

TEST(ArenaSocket, AJoinerRefusesAnAnswerThatIsNoArena) {
  // A server of another kind under our name: it answers garbage of many sizes, then nothing.
  const std::string name = unique_name("impostor");
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path + 1, name.data(), name.size());
  const int listener = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
  const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + name.size());
  ASSERT_EQ(bind(listener, reinterpret_cast<sockaddr*>(&address), length), 0);
  ASSERT_EQ(::listen(listener, 4), 0);
  for (const std::size_t count : {0u, 1u, 168u, 1000u}) {
    std::thread impostor([&] {
      const int peer = accept(listener, nullptr, nullptr);
      const std::vector<char> bytes(count, 'z');
      if (count > 0) {
        EXPECT_EQ(send(peer, bytes.data(), count, 0), static_cast<ssize_t>(count));
      }
      close(peer);
    });
    EXPECT_FALSE(join_arena(name, request_of("sim", 0), 2000)) << count << " bytes";
    impostor.join();
  }
  close(listener);
}

TEST(ArenaSocket, RefusedPeersLeaveNoDescriptorsBehind) {
  const Arena arena = make_arena();
  Expected<ArenaServer> server = ArenaServer::listen(unique_name("leak"), arena);
  ASSERT_TRUE(server);
  const int before = dup(0);
  close(before);
  for (int round = 0; round < 50; ++round) {
    close(connect_raw(server->name()));
    EXPECT_FALSE(server->serve_one());
  }
  const int after = dup(0);
  close(after);
  EXPECT_EQ(after, before);
}

}  // namespace arena_socket_test
}  // namespace comrad::shm
