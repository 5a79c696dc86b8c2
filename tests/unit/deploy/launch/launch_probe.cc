// Supervises fake workers for supervisor_test: `launch_probe RUN_DIR BIN_DIR [name=value ...]`, prints the
// outcome as one JSON object.
#include <cstdio>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>

#include "deploy/launch/supervisor.h"

int main(int argc, char** argv) {
  using namespace comrad;
  if (argc < 3) return 2;
  deploy::LaunchPlan plan;
  plan.run_dir = argv[1];
  plan.bin_dir = argv[2];
  plan.env.head_sizes = {3, 3, 3};
  plan.decision_limit = 100;
  plan.restarts = {.first_delay_s = 0.05, .max_delay_s = 0.2, .window_s = 60, .deaths = 4};
  plan.config.collection.num_workers = 2;
  plan.config.collection.worker_num_splits = 2;
  plan.config.collection.policy_workers = 1;
  plan.config.collection.num_envs_per_worker = 2;
  plan.config.collection.trajectory_slabs = 8;
  plan.config.collection.rollout = 8;
  plan.config.network.rnn_size = 16;
  plan.config.collection.learner_threads = 2;
  plan.config.run.progress_interval = 0.2;
  for (int i = 3; i < argc; ++i) {
    const std::string word = argv[i];
    const std::size_t equals = word.find('=');
    const std::string name = word.substr(0, equals), value = word.substr(equals + 1);
    if (name == "policy")
      plan.policy = value == "random" ? deploy::PolicySource::kRandom : deploy::PolicySource::kCheckpoint;
    if (name == "checkpoint") plan.checkpoint = value;
    if (name == "episodes") plan.episodes = std::stoull(value);
    if (name == "seconds") plan.seconds = std::stod(value);
    if (name == "warmup") plan.warmup_seconds = std::stod(value);
    if (name == "lock") plan.lock_descriptor = std::atoi(value.c_str());
    if (name == "deterministic") plan.config.collection.deterministic = true;
    if (name == "slabs") plan.config.collection.trajectory_slabs = std::stoll(value);
  }
  const Expected<deploy::RunOutcome> outcome = deploy::run(plan);
  nlohmann::json json;
  if (!outcome) {
    json["error"] = outcome.error().message;
    std::puts(json.dump().c_str());
    return 1;
  }
  json["exit_code"] = outcome->exit_code;
  json["interrupted"] = outcome->reason == deploy::StopReason::kInterrupted;
  json["message"] = outcome->message;
  json["restarts"] = outcome->restarts;
  json["steps_lost"] = outcome->accounts.lost_with_the_dead();
  json["env_frames_lost"] = outcome->env_frames_lost;
  json["learner_version"] = outcome->last_stats.learner_version;
  json["measured_seconds"] = outcome->measured.seconds;
  json["measured_decisions"] = outcome->measured.decisions;
  json["measured_updates"] = outcome->measured.updates;
  json["lag_mean"] = outcome->lag_mean;
  for (const EpisodeRecord& episode : outcome->episodes) {
    json["episodes"].push_back(
        {{"id", episode.episode_id}, {"score", episode.score}, {"agents", episode.returns().size()}});
  }
  std::puts(json.dump().c_str());
  return outcome->exit_code;
}
