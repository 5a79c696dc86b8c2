#include "deploy/launch/metrics_page.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <regex>
#include <set>
#include <sstream>

namespace comrad::deploy {
namespace metrics_page_test {

using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

RunSnapshot small_run() {
  RunSnapshot run;
  run.run = "lava \"pit\"\\ 1\n";
  run.status.state = "running";
  run.status.env_frames = 12'345'678'901;
  run.accounts = {.made = 100,
                  .trained = 60,
                  .forgotten = 10,
                  .lost_with_simulators = 8,
                  .lost_with_learners = 2,
                  .waiting = 30};
  run.lag_mean = 2.5;
  run.hosts.push_back({.name = "box", .workers = 2, .decisions_per_s = 12.5, .credits = 7});
  run.workers.push_back(
      {.name = "sim-0", .role = "sim", .host = "box", .state = "running", .pid = 7, .restarts = 3});
  run.workers.push_back({.name = "learner", .role = "learner", .host = "box", .state = "restarting"});
  return run;
}

/// The page's samples by name and labels, read as strictly as the format defines.
std::map<std::string, double> read_page(const std::string& text) {
  std::map<std::string, double> samples;
  std::set<std::string> families;
  std::string family, type;
  const std::regex sample(
      R"re(([a-z][a-z0-9_]*)\{((?:[a-z]+="(?:[^"\\\n]|\\[\\"n])*",?)+)\} (-?[0-9.e+-]+))re");
  std::istringstream lines(text);
  EXPECT_TRUE(text.ends_with('\n'));
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string hash, kind, name;
    if (line.starts_with("# HELP ")) {
      words >> hash >> kind >> name;
      EXPECT_TRUE(families.insert(name).second) << name << " comes twice";
      family = name;
      type.clear();
      continue;
    }
    if (line.starts_with("# TYPE ")) {
      words >> hash >> kind >> name >> type;
      EXPECT_EQ(name, family);
      EXPECT_TRUE(type == "gauge" || type == "counter") << line;
      EXPECT_EQ(type == "counter", name.ends_with("_total")) << line;
      continue;
    }
    std::smatch parts;
    EXPECT_TRUE(std::regex_match(line, parts, sample)) << line;
    if (parts.empty()) continue;
    EXPECT_EQ(parts[1], family) << line;
    EXPECT_FALSE(type.empty()) << line;
    EXPECT_TRUE(samples.emplace(parts[1].str() + "{" + parts[2].str() + "}", std::stod(parts[3])).second)
        << line;
  }
  return samples;
}

TEST(MetricsText, IsOneFamilyAMetricInTheTextFormat) {
  const std::map<std::string, double> samples = read_page(metrics_text(small_run()));
  const std::string run = R"(run="lava \"pit\"\\ 1\n")";
  EXPECT_EQ(samples.at("comrad_env_frames{" + run + "}"), 12'345'678'901.0);
  EXPECT_EQ(samples.at("comrad_run_state{" + run + ",state=\"running\"}"), 1);
  EXPECT_EQ(samples.at("comrad_run_state{" + run + ",state=\"paused\"}"), 0);
  EXPECT_EQ(samples.at("comrad_decisions_lost_total{" + run + ",where=\"simulator\"}"), 8);
  EXPECT_EQ(samples.at("comrad_host_credits{" + run + ",host=\"box\"}"), 7);
  EXPECT_EQ(
      samples.at("comrad_worker_restarts_total{" + run + ",worker=\"sim-0\",role=\"sim\",host=\"box\"}"), 3);
  EXPECT_EQ(samples.at("comrad_worker_up{" + run + ",worker=\"learner\",role=\"learner\",host=\"box\"}"), 0);
  EXPECT_EQ(samples.at("comrad_policy_lag_mean{" + run + "}"), 2.5);
}

TEST(MetricsText, LeavesOutWhatIsNotKnown) {
  RunSnapshot run = small_run();
  run.workers.clear();
  EXPECT_THAT(metrics_text(run), Not(HasSubstr("comrad_score_mean")));
  EXPECT_THAT(metrics_text(run), Not(HasSubstr("comrad_worker_up")));
  run.status.score_mean = 412.25;
  EXPECT_THAT(metrics_text(run), HasSubstr("} 412.25\n"));
  run.run = "\xff";
  read_page(metrics_text(run));
}

TEST(MetricsRules, GiveThePageAndNothingElse) {
  const HttpRules rules = metrics_rules([] { return std::string("page\n"); });
  EXPECT_THAT(http_answer("GET /metrics HTTP/1.1\r\nHost: 127.0.0.1:9400\r\n\r\n", rules),
              StartsWith("HTTP/1.1 200 OK\r\n"));
  EXPECT_THAT(http_answer("GET /metrics?x=1 HTTP/1.0\r\n\r\n", rules), HasSubstr("version=0.0.4"));
  EXPECT_THAT(http_answer("GET / HTTP/1.1\r\n\r\n", rules), StartsWith("HTTP/1.1 404 "));
  EXPECT_THAT(http_answer("POST /metrics HTTP/1.1\r\n\r\n", rules), StartsWith("HTTP/1.1 405 "));
}

}  // namespace metrics_page_test
}  // namespace comrad::deploy
