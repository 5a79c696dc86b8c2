// A run that trains, watched and controlled while it continues: comrad ctl, comrad top, the Prometheus page, the logs.

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <csignal>
#include <fstream>
#include <regex>
#include <sstream>
#include <utility>

#include "tests/integration/running_program.h"

namespace comrad::test {
namespace operation_test {

using nlohmann::json;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr int kBadInput = 2;

int connect_to(int port) {
  const int client = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  if (connect(client, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) return client;
  close(client);
  return -1;
}

int free_port() {
  const int listener = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  EXPECT_EQ(bind(listener, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  EXPECT_EQ(getsockname(listener, reinterpret_cast<sockaddr*>(&address), &size), 0);
  close(listener);
  return ntohs(address.sin_port);
}

std::string http(int port, const std::string& request) {
  const int client = connect_to(port);
  if (client < 0) return "no connection";
  (void)!write(client, request.data(), request.size());
  std::string answer;
  char bytes[8192];
  for (ssize_t size; (size = read(client, bytes, sizeof bytes)) > 0;)
    answer.append(bytes, static_cast<size_t>(size));
  close(client);
  return answer;
}

class Operation : public ::testing::Test {
 protected:
  void SetUp() override {
    training_ = std::make_unique<RunningProgram>(
        small_training(scratch_, "run", 1e9, {"--metrics_port", std::to_string(port_)}));
    ASSERT_TRUE(wait_until([this] { return env_frames(run_) > 0 || !training_->running(); }));
    ASSERT_TRUE(training_->running()) << training_->wait().err;
  }
  static Ending ctl(std::vector<std::string> words) {
    words.insert(words.begin(), "ctl");
    return comrad(words);
  }
  json status() const {
    const Ending said = ctl({run_, "status", "--json"});
    EXPECT_EQ(said.exit_code, 0) << said.err;
    return json::parse(said.out, nullptr, false);
  }

  const ScratchFolder scratch_;
  const std::string run_ = scratch_ / "run";
  const int port_ = free_port();
  std::unique_ptr<RunningProgram> training_;
};

TEST_F(Operation, ARunIsLookedAtPausedSavedAndStopped) {
  // Looked at.
  const json first = status();
  EXPECT_EQ(first["state"], "running");
  EXPECT_EQ(first["pid"], training_->pid());
  ASSERT_EQ(first["workers"].size(), 4u);
  EXPECT_EQ(first["workers"][0]["worker"], "sim-0");
  EXPECT_EQ(first["hosts"].size(), 1u);
  const json account = first["decisions_account"];
  EXPECT_EQ(account["made"].get<int64_t>(),
            account["trained"].get<int64_t>() + account["waiting"].get<int64_t>());
  EXPECT_THAT(ctl({"run", "status", "--train_dir", scratch_.string()}).out, HasSubstr("env frames/s"));
  EXPECT_THAT(ctl({run_, "workers"}).out,
              AllOf(HasSubstr("sim-1"), HasSubstr("policy-0"), HasSubstr("learner")));
  const Ending one = ctl({run_, "workers", "sim-1"});
  EXPECT_THAT(one.out, AllOf(HasSubstr("sim-1"), Not(HasSubstr("sim-0"))));

  // What cannot be done is said.
  const auto refused = [](const Ending& ending, const std::string& words) {
    EXPECT_EQ(ending.exit_code, kBadInput) << ending.out;
    EXPECT_THAT(ending.err, HasSubstr(words));
  };
  refused(ctl({run_, "workers", "sim-7"}), "unknown worker 'sim-7'");
  refused(ctl({run_, "resume"}), "the run is not paused");
  refused(ctl({run_, "drain"}), "name the host");
  refused(ctl({run_, "drain", "nowhere"}), "unknown host 'nowhere'");
  refused(ctl({run_, "drain", first["host"].get<std::string>()}), "the learner is on");
  refused(ctl({run_, "puase"}), "did you mean 'pause'");
  refused(ctl({run_, "pause", "now"}), "unexpected argument");
  refused(ctl({"rum", "status", "--train_dir", scratch_.string()}), "did you mean 'run'");
  if (geteuid() == 0) {
    chmod(scratch_.string().c_str(), 0755);
    const Ending other = RunningProgram({"/usr/bin/setpriv", "--reuid=65534", "--regid=65534",
                                         "--clear-groups", program("comrad"), "ctl", run_, "stop"})
                             .wait();
    refused(other, "belongs to user root");
    EXPECT_TRUE(training_->running());
  }

  // Paused: nothing is trained on, and a checkpoint can be had; then it continues.
  ASSERT_EQ(ctl({run_, "pause"}).exit_code, 0);
  refused(ctl({run_, "pause"}), "paused already");
  ASSERT_TRUE(wait_until([&] { return read_json(run_ + "/status.json")["state"] == "paused"; }));
  // The learner writes it between two updates and then stands still; simulators finish what they had begun.
  const Ending saved = ctl({run_, "checkpoint"});
  ASSERT_EQ(saved.exit_code, 0) << saved.err;
  const std::string path = saved.out.substr(0, saved.out.find('\n'));
  EXPECT_TRUE(std::filesystem::is_regular_file(path)) << path;
  json still = status();
  ASSERT_TRUE(wait_until([&] {
    const json before = std::exchange(still, status());
    return still["decisions_account"]["made"] == before["decisions_account"]["made"];
  }));
  EXPECT_EQ(ctl({run_, "workers"}).exit_code, 0);
  EXPECT_EQ(status()["decisions"], still["decisions"]);
  EXPECT_EQ(status()["decisions_account"]["made"], still["decisions_account"]["made"]);
  EXPECT_THAT(path, HasSubstr("_" + std::to_string(status()["env_frames"].get<int64_t>()) + ".pt"));
  ASSERT_EQ(ctl({run_, "resume"}).exit_code, 0);
  EXPECT_TRUE(wait_until([&] { return status()["decisions"] > still["decisions"]; }));

  // A file where the folder for checkpoints was: the answer is an error, and training continues.
  std::filesystem::rename(run_ + "/checkpoint", run_ + "/gone");
  std::ofstream(run_ + "/checkpoint") << "no folder";
  const Ending unsaved = ctl({run_, "checkpoint"});
  EXPECT_NE(unsaved.exit_code, 0);
  EXPECT_THAT(unsaved.err, HasSubstr("could not be written"));
  std::filesystem::remove(run_ + "/checkpoint");
  std::filesystem::rename(run_ + "/gone", run_ + "/checkpoint");

  // Stopped: the command returns when it is.
  const Ending stopped = ctl({run_, "stop"});
  EXPECT_EQ(stopped.exit_code, 0) << stopped.err;
  const Ending ending = training_->wait();
  EXPECT_EQ(ending.exit_code, 0) << ending.err;
  EXPECT_THAT(ending.err,
              AllOf(HasSubstr("stopped by comrad ctl"), HasSubstr("warning: no checkpoint was written")));
  EXPECT_EQ(read_json(run_ + "/status.json")["state"], "paused");
  const Ending late = ctl({run_, "status"});
  EXPECT_EQ(late.exit_code, kBadInput);
  EXPECT_THAT(late.err,
              AllOf(HasSubstr("is not running, its last state is paused"), HasSubstr("--experiment run")));

  // Every line of every log names run, host and worker.
  char host[256] = {};
  gethostname(host, sizeof host - 1);
  for (const char* word : {"supervisor", "sim-0", "sim-1", "policy-0", "learner-0"}) {
    const std::string name = word;
    std::istringstream log(read_text(run_ + "/logs/" + name + ".log"));
    int lines = 0;
    for (std::string line; std::getline(log, line); ++lines)
      EXPECT_THAT(line, HasSubstr(std::string(" run@") + host + " " +
                                  (name == "learner-0" ? "learner" : name) + ": "));
    EXPECT_GT(lines, 0) << name;
  }
}

TEST_F(Operation, TopAndThePageShowItAndNoClientDelaysIt) {
  const Ending once = comrad({"top", "--once", "--json", "--train_dir", scratch_.string()});
  ASSERT_EQ(once.exit_code, 0) << once.err;
  const json runs = json::parse(once.out)["runs"];
  ASSERT_EQ(runs.size(), 1u);
  EXPECT_EQ(runs[0]["run"], "run");
  const Ending table = comrad({"top", run_, "--once"});
  EXPECT_THAT(table.out, AllOf(HasSubstr("HOST"), HasSubstr("CREDITS"), HasSubstr("DECISIONS/S"),
                               HasSubstr("policy-0")));
  EXPECT_THAT(comrad({"top", "--once", "--train_dir", "/"}).out, HasSubstr("no run is alive"));

  const std::string page = http(port_, "GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_THAT(page, AllOf(HasSubstr("HTTP/1.1 200 OK"), HasSubstr("# TYPE comrad_env_frames gauge"),
                          HasSubstr("comrad_run_state{run=\"run\",state=\"running\"} 1"),
                          HasSubstr("worker=\"sim-1\"")));
  EXPECT_THAT(http(port_, "GET /secret HTTP/1.1\r\n\r\n"), HasSubstr("404"));

  // Slow, silent, rude and many at once, beside a run that continues as before.
  std::vector<int> clients;
  const std::string flood(100'000, 'x');
  const double before = env_frames(run_);
  for (int count = 0; count < 100; ++count) {
    const int client = connect_to(port_);
    if (client < 0) continue;
    clients.push_back(client);
    if (clients.size() % 3 == 0) (void)!send(client, flood.data(), flood.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (clients.size() % 3 == 1) (void)!send(client, "GET /met", 8, MSG_NOSIGNAL | MSG_DONTWAIT);
    if (clients.size() > 40) {
      for (const int old : clients) close(old);
      clients.clear();
    }
  }
  for (const int client : clients) close(client);
  EXPECT_TRUE(wait_until([&] { return env_frames(run_) > before; }));
  EXPECT_TRUE(wait_until(
      [&] { return http(port_, "GET /metrics HTTP/1.1\r\n\r\n").find("200 OK") != std::string::npos; }));

  // The page is of this machine alone, and of one run.
  const Ending second =
      RunningProgram(small_training(scratch_, "second", 4096, {"--metrics_port", std::to_string(port_)}))
          .wait();
  EXPECT_EQ(second.exit_code, kBadInput);
  EXPECT_THAT(second.err, AllOf(HasSubstr("--metrics_port " + std::to_string(port_)), HasSubstr("is taken")));
  training_->signal(SIGTERM);
  EXPECT_EQ(training_->wait().exit_code, 0);
}

}  // namespace operation_test
}  // namespace comrad::test
