#include "deploy/settings/start_check.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <filesystem>

#include "deploy/settings/game_files.h"

namespace comrad::deploy {

Expected<StartCheck> check_start(const RunConfig& config, const EnvShape& env, const std::string& run_dir,
                                 const DescribeNetwork& describe_network) {
  if (!config.environment.wad.empty()) COMRAD_TRY(check_wad(config.environment.wad));
  const std::string& graph = config.curriculum.interestingness_graph_path;
  std::error_code failed;
  if (!graph.empty() && !std::filesystem::is_regular_file(graph, failed))
    return Error{ErrorCode::kNotFound, "interestingness_graph_path is " + graph + ", which is no file"};
  COMRAD_TRY(check_pool_to_draw(config.environment.layout_pool, /*for_training=*/true));
  StartCheck check;
  COMRAD_TRY_ASSIGN(check.network, describe_network(config, env));
  COMRAD_TRY_ASSIGN(check.replay, chosen_replay(config, env, check.network, run_dir));
  return check;
}

Expected<std::optional<replay::ReplayPlan>> chosen_replay(const RunConfig& config, const EnvShape& env,
                                                          const NetworkSize& network,
                                                          const std::string& run_dir) {
  if (!config.run.algo->learns_q_values()) return std::optional<replay::ReplayPlan>();
  TrajectoryShape shape;
  shape.env = env;
  shape.rollout_steps = static_cast<int32_t>(config.collection.rollout);
  shape.recurrent_state_count = network.recurrent_state_count;
  COMRAD_TRY_ASSIGN(
      replay::ReplayPlan plan,
      replay::replay_plan(config, shape, replay::probe_space(run_dir),
                          replay::reserved_bytes(config, shape, network.weights_bytes), run_dir));
  return std::optional(std::move(plan));
}

Status check_learning_begins(const RunConfig& config, const std::optional<replay::ReplayPlan>& replay) {
  if (!replay) return {};
  const auto begins =
      static_cast<double>(replay->decisions_before_training * config.environment.env_frameskip);
  const double ends = config.run.train_for_env_frames;
  if (begins < ends) return {};
  const bool is_half = replay->decisions_before_training < config.q_learning.learning_starts_decisions;
  return Error{
      ErrorCode::kBadInput,
      fmt::format("learning begins at {} env frames ({} agent decisions, {}), the run ends at {} "
                  "(train_for_env_frames), without an update or a checkpoint; raise --train_for_env_frames, "
                  "lower --learning_starts_decisions, or say --allow_no_update",
                  std::llround(begins), replay->decisions_before_training,
                  (is_half ? "half of what the replay holds" : "learning_starts_decisions"),
                  std::llround(ends))};
}

}  // namespace comrad::deploy
