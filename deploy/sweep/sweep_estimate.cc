#include "deploy/sweep/sweep_estimate.h"

#include <spdlog/fmt/fmt.h>

#include <sched.h>

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "deploy/launch/progress.h"
#include "deploy/process/child_program.h"
#include "rollout_buffer/core/cores.h"

namespace comrad::deploy {
namespace {

constexpr double kSecondsPerHour = 3600;

std::string value_of(const SweepRun& run, const std::string& setting) {
  for (const auto& [name, value] : run.settings.values)
    if (name == setting) return value;
  return "";
}

std::string hours(double seconds) {
  char text[32];
  std::snprintf(text, sizeof text, seconds < 100 * kSecondsPerHour ? "%.1f" : "%.0f",
                seconds / kSecondsPerHour);
  return text;
}

}  // namespace

std::vector<EstimateGroup> estimate_groups(const SweepPlan& plan) {
  std::vector<EstimateGroup> groups;
  for (const SweepRun& run : plan.runs) {
    std::string label;
    for (const SweepAxis& axis : plan.file.axes) {
      if (axis.setting == "seed" || axis.setting == "scenario") continue;
      label += (label.empty() ? "" : ", ") + (axis.setting == "algo" ? "" : axis.setting + " ") +
               value_of(run, axis.setting);
    }
    if (label.empty()) label = "every run";
    auto group = std::ranges::find(groups, label, &EstimateGroup::label);
    if (group == groups.end()) group = groups.insert(group, {.label = label, .measured = &run});
    ++group->run_count;
    group->env_frames += run.goal_env_frames;
  }
  return groups;
}

Status measure(std::vector<EstimateGroup>& groups, const SweepPlan& plan, double seconds,
               const std::string& comrad) {
  std::vector<int> cpus = allowed_cpus();
  cpu_set_t mask;
  CPU_ZERO(&mask);
  for (std::size_t i = 0; i < std::min(cpus.size(), static_cast<std::size_t>(plan.cores)); ++i)
    CPU_SET(static_cast<std::size_t>(cpus[i]), &mask);
  sched_setaffinity(0, sizeof mask, &mask);  // the benches inherit it
  for (EstimateGroup& group : groups) {
    std::fprintf(stderr, "measuring %s on %s for %.0f s ...\n", group.label.c_str(),
                 value_of(*group.measured, "scenario").c_str(), seconds);
    std::vector<std::string> command = {comrad, "bench", "train", "--json",
                                        fmt::format("--seconds={}", seconds)};
    for (const auto& [setting, value] : group.measured->settings.values)
      // The bench ends by its own clock, and this machine's memory need not hold a replay of the sweep's size.
      if (setting != "train_for_env_frames" && setting != "train_for_seconds" && setting != "replay_gb")
        command.push_back("--" + setting + "=" + value);
    COMRAD_TRY_ASSIGN(const ProgramResult done, run_program(command, {.timeout_s = 600 + 10 * seconds}));
    if (done.interrupted) return Error{ErrorCode::kSystem, "interrupted"};
    const auto json = nlohmann::json::parse(done.output, nullptr, false);
    const auto rate = json.is_object() ? json.find("env_frames_per_s") : json.end();
    if (done.exit_code != 0 || !json.is_object() || rate == json.end() || !rate->is_number() ||
        !(rate->get<double>() > 0))
      return Error{ErrorCode::kPeerLost,
                   "comrad bench train (" + group.label + ") measured nothing: " + last_words(done)};
    group.env_frames_per_s = rate->get<double>();
  }
  return {};
}

std::string estimate_text(const std::vector<EstimateGroup>& groups, const SweepPlan& plan) {
  std::size_t width = 4;
  for (const EstimateGroup& group : groups) width = std::max(width, group.label.size());
  char line[256];
  std::string text;
  const auto add = [&](const char* label, const std::string& rate, const std::string& each,
                       const std::string& runs, const std::string& all) {
    std::snprintf(line, sizeof line, "%-*.*s  %14s  %11s  %6s  %9s\n",
                  static_cast<int>(std::min<std::size_t>(width, 120)), 120, label, rate.c_str(), each.c_str(),
                  runs.c_str(), all.c_str());
    text += line;
  };
  add("runs", "env frames/s", "hours a run", "runs", "hours");
  double seconds = 0;
  for (const EstimateGroup& group : groups) {
    const double group_s = group.env_frames_per_s > 0 ? group.env_frames / group.env_frames_per_s : 0;
    seconds += group_s;
    add(group.label.c_str(), count_text(group.env_frames_per_s),
        hours(group_s / static_cast<double>(group.run_count)), std::to_string(group.run_count),
        hours(group_s));
  }
  const auto at_once = static_cast<double>(plan.file.local_at_once);
  text += fmt::format("{} runs on {} cores each: {} hours one after the other", plan.runs.size(), plan.cores,
                      hours(seconds));
  if (at_once > 1)
    text += fmt::format(", {} with {} at once", hours(seconds / at_once), plan.file.local_at_once);
  return text + " (a run of each row's first scenario stands for all of them)\n";
}

}  // namespace comrad::deploy
