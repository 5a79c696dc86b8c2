// Where a run's decisions went, as its files say, checked to the decision.
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "tests/integration/running_program.h"

namespace comrad::test {

/// The decisions_account of a run that has ended; its parts add up.
inline nlohmann::json checked_account(const std::string& run) {
  const nlohmann::json status = read_json(run + "/status.json");
  if (!status.is_object() || !status.contains("decisions_account")) {
    ADD_FAILURE() << run << " has no account: " << status;
    return {};
  }
  nlohmann::json account = status["decisions_account"];
  int64_t sum = 0;
  for (const char* part : {"trained", "lost_with_simulators", "lost_with_learners", "lost_in_restarts",
                           "lost_on_the_way", "left"})
    sum += account[part].get<int64_t>();
  EXPECT_EQ(account["made"].get<int64_t>(), sum) << run << ": " << account;
  EXPECT_EQ(account["waiting"].get<int64_t>(), 0) << run << ": " << account;
  return account;
}

/// Decisions that came from other hosts, those that are gone included; by the learner's host's word.
inline double decisions_delivered(const std::string& run, const std::string& file = "guests.json") {
  double sum = 0;
  const nlohmann::json peers = read_json(run + "/" + file);
  if (peers.is_object())
    for (const auto& peer : peers["guests"]) sum += peer["decisions_delivered"].get<double>();
  return sum;
}

}  // namespace comrad::test
