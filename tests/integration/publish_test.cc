// A run with --publish is seen from elsewhere (`comrad top --remote`), where its keys allow it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>

#include "tests/integration/running_program.h"

namespace comrad::test {
namespace publish_test {

using ::testing::HasSubstr;
using ::testing::Not;

/// One line, with the command's name and "error".
void expect_one_line(const Ending& refused, const std::string& command) {
  EXPECT_NE(refused.exit_code, 0);
  EXPECT_FALSE(refused.timed_out);
  const std::size_t at = refused.err.find("comrad " + command + ": error: ");
  ASSERT_NE(at, std::string::npos) << refused.err;
  EXPECT_EQ(refused.err.find('\n', at), refused.err.size() - 1) << refused.err;
}

Ending look(const std::string& address, const std::vector<std::string>& more = {}) {
  std::vector<std::string> words = {"top", "--remote", address, "--once", "--json"};
  words.insert(words.end(), more.begin(), more.end());
  return comrad(words);
}

TEST(Publish, ARunIsSeenFromItsFirstWorkerToItsEndAndOnlyWithItsKeys) {
  const ScratchFolder scratch;
  const std::string run = scratch / "run", keys = scratch / "keys", others = scratch / "others";
  for (const std::string& folder : {keys, others})
    ASSERT_EQ(comrad({"keys", "make", folder, "--hosts", "monitor"}).exit_code, 0);
  RunningProgram training(small_training(scratch, "run", 1e9, {"--publish", "--keys", keys + "/run"}));
  ASSERT_TRUE(wait_until([&] { return env_frames(run) > 0 || !training.running(); }));
  ASSERT_TRUE(training.running()) << training.wait().err;

  const std::string mine = keys + "/hosts/monitor";
  nlohmann::json told;
  const bool has_played = wait_until([&] {  // the report follows status.json
    const Ending seen = look(run, {"--keys", mine, "--wait_s", "60"});
    EXPECT_EQ(seen.exit_code, 0) << seen.err;
    if (seen.exit_code == 0) told = nlohmann::json::parse(seen.out)["runs"][0];
    return seen.exit_code != 0 || told["env_frames"].get<double>() > 0;
  });
  ASSERT_TRUE(has_played && !told.is_null());
  EXPECT_EQ(told["run"], "run");
  EXPECT_EQ(told["state"], "running");
  EXPECT_EQ(told["workers"].size(), 4u) << "2 simulators, a policy worker, the learner: " << told;
  const Ending page = comrad({"top", "--remote", run, "--once", "--keys", mine, "--wait_s", "60"});
  EXPECT_THAT(page.out, HasSubstr("run: running"));
  EXPECT_THAT(page.out, HasSubstr("sim-1"));

  const Ending unknown = look(run, {"--wait_s", "2"});
  expect_one_line(unknown, "top");
  EXPECT_THAT(unknown.err, HasSubstr("no report"));
  EXPECT_THAT(unknown.err, HasSubstr("--keys"));
  const Ending of_another_authority = look(run, {"--keys", others + "/hosts/monitor", "--wait_s", "5"});
  expect_one_line(of_another_authority, "top");
  EXPECT_THAT(of_another_authority.err, HasSubstr("keys are of the same authority"));

  RunningProgram watching({program("comrad"), "top", "--remote", run, "--json", "--keys", mine, "--wait_s",
                           "60", "--interval", "0.2"});
  sleep_s(1);
  training.signal(SIGTERM);
  EXPECT_EQ(training.wait().exit_code, 0);
  const Ending watched = watching.wait();
  EXPECT_EQ(watched.exit_code, 0) << watched.err;
  EXPECT_THAT(watched.out, HasSubstr("\"state\":\"interrupted\"")) << "the last look is of the run's end";
}

TEST(Publish, ARunThatServesAndDoesNotPublishIsNamed) {
  const ScratchFolder scratch;
  RunningProgram training(small_training(scratch, "run", 1e9, {"--serve"}));
  ASSERT_TRUE(wait_until([&] { return env_frames(scratch / "run") > 0 || !training.running(); }));
  const Ending refused = look(scratch / "run", {"--wait_s", "8"});
  expect_one_line(refused, "top");
  EXPECT_THAT(refused.err, HasSubstr("start it with --publish"));
  training.signal(SIGINT);
  EXPECT_EQ(training.wait().exit_code, 0);
}

TEST(Publish, WithoutKeysOrWithoutDdsTheRunIsRefusedInOneLine) {
  const ScratchFolder scratch;
  const Ending without_keys =
      RunningProgram(small_training(scratch, "run", 2048, {"--publish", "--interface", "eth0"})).wait();
  expect_one_line(without_keys, "train");
  EXPECT_THAT(without_keys.err, HasSubstr("--insecure_network"));
  EXPECT_FALSE(std::filesystem::exists(scratch / "run")) << "refused before anything is written";

  std::vector<std::string> apart = {"/usr/bin/unshare", "--map-root-user", "--net", "--", "/bin/true"};
  if (RunningProgram(apart).wait().exit_code != 0) GTEST_SKIP() << "this host allows no network namespaces";
  apart.pop_back();
  for (const std::string& word : small_training(scratch, "apart", 2048, {"--publish"})) apart.push_back(word);
  const Ending without_dds = RunningProgram(apart).wait();
  expect_one_line(without_dds, "train");
  EXPECT_THAT(without_dds.err, HasSubstr("interface 'lo'"));
}

TEST(Publish, AMonitorWithoutARunOrWithAWrongAddressIsRefusedInOneLine) {
  const Ending nobody = look("127.0.0.1/0123456789abcdef", {"--wait_s", "0.5"});
  expect_one_line(nobody, "top");
  EXPECT_THAT(nobody.err, HasSubstr("no report from 127.0.0.1"));
  for (const auto& [address, word] : {std::pair("nonsense", "nonsense"), {"127.0.0.1/xyz", "xyz"}}) {
    const Ending wrong = look(address);
    expect_one_line(wrong, "top");
    EXPECT_THAT(wrong.err, HasSubstr(word));
  }
  const Ending both = comrad({"top", "a_run", "--remote", "127.0.0.1/0123456789abcdef"});
  expect_one_line(both, "top");
  EXPECT_THAT(both.err, HasSubstr("leave a_run out"));
}

}  // namespace publish_test
}  // namespace comrad::test
