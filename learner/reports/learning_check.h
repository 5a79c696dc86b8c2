// Checks the numbers of a report and warns, once each, when one of them shows that learning cannot
// work: what it means and which setting to change. Stage: beside update, for the user.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "learner/reports/metrics.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::learn {

/// Judges reports in the order in which they are written. A number that a report does not have, or that is not
/// finite, is not judged; one that is bad must be so in several reports in a row, because most numbers are those
/// of one minibatch. Every finding is reported once in the life of the object. Threads: one.
class LearningCheck {
 public:
  explicit LearningCheck(const RunConfig& config) : config_(config) {}

  /// What the settings alone show, before anything was trained: a sentence each.
  std::vector<std::string> judge_settings();
  /// What this report is the first to show.
  std::vector<std::string> judge(const MetricValues& values);

 private:
  struct Finding {
    int bad_in_a_row = 0;
    bool told = false;
  };
  /// Counts one look at finding `name`; true when it is to be reported now: it was `bad` in `reports` looks in a row.
  bool shows(const std::string& name, bool bad, int reports);

  void judge_batches(const MetricValues& values, std::vector<std::string>& told);
  void judge_optimizer(const MetricValues& values, std::vector<std::string>& told);
  void judge_targets(const MetricValues& values, std::vector<std::string>& told);

  RunConfig config_;
  std::map<std::string, Finding> findings_;
};

}  // namespace comrad::learn
