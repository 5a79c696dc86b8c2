#include "sim_workers/worker/episode_recorder.h"

#include <spdlog/fmt/fmt.h>

#include <cstdio>
#include <nlohmann/json.hpp>

#include "rollout_buffer/core/files.h"

namespace comrad::sim {

void EpisodeRecorder::watch(DoomEnvironmentSet& environments) {
  for (int index = 0; index < environments.size(); ++index) {
    traces_.push_back(std::make_unique<Trace>(*this));
    environments.at(index).show_to(traces_.back().get());
  }
}

void EpisodeRecorder::Trace::began(const DoomEnvironment&) {
  tics_ = 0;
  choices_.clear();
}

void EpisodeRecorder::Trace::ticked(const DoomEnvironment& environment) {
  const bool is_over = environment.last_step().episode_over();
  if (++tics_ < environment.game().frame_skip && !is_over) return;
  tics_ = 0;
  note(environment);
  if (is_over) recorder_.write(environment, choices_);
}

void EpisodeRecorder::Trace::note(const DoomEnvironment& environment) {
  const ActionMap& actions = environment.game().actions;
  std::vector<int32_t> choice(static_cast<std::size_t>(actions.head_count()));
  for (const doom::Buttons& pressed : environment.pressed()) {
    actions.choose(pressed, choice);
    if (!(actions.buttons(choice) == pressed) && recorder_.status_)
      recorder_.status_ = Error{ErrorCode::kUnsupported,
                                "an agent pressed buttons that no choice of its heads presses; such an "
                                "episode cannot be recorded"};
    for (const int32_t one : choice) choices_.push_back(static_cast<char>(one));
  }
}

void EpisodeRecorder::write(const DoomEnvironment& environment, const std::string& choices) {
  if (!status_) return;  // the first error is the one to tell
  const EnvShape& shape = environment.shape();
  const EpisodeRecord& summary = environment.summary();
  const uint64_t seed = environment.world().options().seed;
  char hash[17];
  std::snprintf(hash, sizeof hash, "%016llx", static_cast<unsigned long long>(environment.state_hash()));
  const nlohmann::ordered_json head = {
      {"episode_seed", seed},
      {"num_agents", shape.num_agents},
      {"frame_skip", environment.game().frame_skip},
      {"head_sizes",
       std::vector<int32_t>(shape.head_sizes.begin(), shape.head_sizes.begin() + shape.head_count)},
      {"decisions", summary.length_steps},
      {"terminated", environment.last_step().terminated},
      {"score", summary.score},
      {"returns", std::vector<float>(summary.returns().begin(), summary.returns().end())},
      {"length_tics", summary.length_tics},
      {"state_hash", hash}};
  status_ = write_file_atomically(fmt::format("{}/{}.comrad", folder_, seed), head.dump() + "\n" + choices,
                                  /*durable=*/false);
}

}  // namespace comrad::sim
