#include "deploy/launch/control_socket.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/support/patience.h"
#include "tests/support/scratch_folder.h"

namespace comrad::deploy {
namespace control_socket_test {

using nlohmann::json;
using ::testing::HasSubstr;

class ControlSocketTest : public ::testing::Test {
 protected:
  ControlCommands orders() {
    const auto note = [this](const char* what) { done_ += std::string(what) + " "; };
    return {.status = [] { return std::string(R"({"state":"running"})"); },
            .pause = [note] { return note("pause"), Status(); },
            .resume =
                [] {
                  return Status(Error{ErrorCode::kBadInput, "the run is not paused"});
                },
            .stop = [note] { return note("stop"), Status(); },
            .checkpoint = [] { return Expected<uint32_t>(7u); },
            .drain = [note](const std::string& host) { return note(("drain " + host).c_str()), Status(); }};
  }
  std::string error_of(const std::string& request) {
    const json answer = json::parse(answer_command(request, orders()));
    return answer.value("error", "none");
  }
  std::string done_;
};

TEST_F(ControlSocketTest, ObeysRequests) {
  EXPECT_EQ(answer_command(R"({"do":"status"})", orders()), "{\"state\":\"running\"}\n");
  EXPECT_EQ(json::parse(answer_command(R"({"do":"pause"})", orders())), json({{"ok", true}}));
  EXPECT_EQ(json::parse(answer_command(R"({"do":"checkpoint"})", orders())),
            json({{"ok", true}, {"asked", 7}}));
  EXPECT_EQ(error_of(R"({"do":"drain","host":"box-2"})"), "none");
  EXPECT_EQ(done_, "pause drain box-2 ");
  EXPECT_EQ(error_of(R"({"do":"resume"})"), "the run is not paused");
}

TEST_F(ControlSocketTest, RefusesWhatIsNoOrderInWords) {
  for (const char* request : {"", "\n", "stop", "[]", "{}", R"({"do":7})", R"({"do":)", "\xff\xfe\n"})
    EXPECT_THAT(error_of(request), HasSubstr("no request")) << request;
  EXPECT_THAT(error_of(R"({"do":"sto"})"), HasSubstr("did you mean 'stop'"));
  EXPECT_THAT(error_of(R"({"do":"drain"})"), HasSubstr("name of a host"));
  EXPECT_THAT(error_of(json({{"do", "drain"}, {"host", std::string(300, 'x')}}).dump()),
              HasSubstr("name of a host"));
  EXPECT_EQ(done_, "");
}

TEST(ControlAddress, IsWrittenToAndReadFromTheLockFile) {
  const test::ScratchFolder scratch;
  EXPECT_FALSE(read_control_address(scratch.string()));
  const int lock = open((scratch / ".lock").c_str(), O_RDWR | O_CREAT, 0644);
  ASSERT_GE(lock, 0);
  ASSERT_EQ(write(lock, "123456789\n", 10), 10);  // as a run that is being set up has it
  const auto early = read_control_address(scratch.string());
  ASSERT_TRUE(early);
  EXPECT_EQ(early->pid, 123456789);
  EXPECT_EQ(early->socket, "");
  const ControlAddress address = make_control_address();
  ASSERT_TRUE(write_control_address(lock, address));
  const auto read = read_control_address(scratch.string());
  close(lock);
  ASSERT_TRUE(read);
  EXPECT_EQ(read->pid, getpid());
  EXPECT_EQ(read->socket, address.socket);
  EXPECT_EQ(read->host, address.host);
  EXPECT_NE(make_control_address().socket, address.socket);
}

TEST(ControlAddress, WhateverLiesThereIsNoHarm) {
  const test::ScratchFolder scratch;
  std::ofstream(scratch / ".lock") << std::string(5000, 'x');
  EXPECT_FALSE(read_control_address(scratch.string()));
  std::ofstream(scratch / ".lock") << "-\n\x01\n";
  ASSERT_TRUE(read_control_address(scratch.string()));
}

TEST(ControlSocket, AnotherUserGetsNoAnswer) {
  if (geteuid() != 0) GTEST_SKIP() << "only root can become another user";
  const std::string name = make_control_address().socket;
  int stops = 0;
  auto socket = ControlSocket::open(name, {.stop = [&stops] { return ++stops, Status(); }});
  ASSERT_TRUE(socket) << socket.error().message;
  int told[2];
  ASSERT_EQ(pipe(told), 0);
  const pid_t other = fork();
  if (other == 0) {
    if (setuid(65534) != 0) _exit(2);
    const auto client = connect_to_name(name);
    if (!client || write(client->get(), "{\"do\":\"stop\"}\n", 14) != 14) _exit(3);
    char answer[512];
    ssize_t size = 0;
    if (!test::wait_until([&] { return (size = read(client->get(), answer, sizeof answer)) > 0; })) _exit(5);
    _exit(write(told[1], answer, static_cast<std::size_t>(size)) == size ? 0 : 4);
  }
  int status = 0;
  for (double now_s = 0; waitpid(other, &status, WNOHANG) == 0; now_s += 0.02) {
    socket->tick(now_s / 100);
    usleep(20'000);
  }
  ASSERT_TRUE(WIFEXITED(status)) << status;
  ASSERT_EQ(WEXITSTATUS(status), 0);
  char answer[512] = {};
  ASSERT_GT(read(told[0], answer, sizeof answer - 1), 0);
  EXPECT_THAT(std::string(answer), HasSubstr("the run belongs to user 0, you are user 65534"));
  EXPECT_EQ(stops, 0);
  close(told[0]), close(told[1]);
}

}  // namespace control_socket_test
}  // namespace comrad::deploy
