#include "rollout_buffer/metrics/metric_table.h"

#include <algorithm>

namespace comrad {
namespace {

// An empty meaning adds nothing to the name, an empty unit means a plain number.
constexpr Metric kEveryAlgorithm[] = {
    {"train/env_steps", "env frames", "same as `env_frames`"},
    {"train/lr", "", "learning rate of the schedule"},
    {"train/loss", "", "sum of the losses; Q-learning: with the regularizer"},
    {"train/grad_norm", "", "before clipping; HAPPO: mean over the actors"},
    {"train/grad_norm_<part>", "", "before clipping"},
    {"train/adam_gain_<part>", "0 to 1",
     "mean of s / (s + `adam_eps`), s = sqrt(v_hat); near 0 epsilon swallows the gradient"},
    {"train/adam_max_second_moment", "", "largest entry"},
    {"train/valids_fraction", "share", "decisions of the batch that count"},
    {"train/num_sgd_steps", "steps", "so far; the policy version"},
    {"train/skipped_sgd_steps", "steps", "left out since the learner began: loss or gradient not finite"},
    {"train/version_diff_avg", "steps", "policy lag; Q-learning: of the newest data"},
    {"train/version_diff_min", "steps", ""},
    {"train/version_diff_max", "steps", ""},
};
constexpr Metric kIppoMappoHappo[] = {
    {"train/actual_lr", "", "of the last step; lower where decisions were invalid"},
    {"train/exploration_loss_coeff", "", "the schedule's value"},
    {"train/ppo_clip_ratio", "", "the schedule's value"},
    {"train/policy_loss", "", "PPO's clipped objective, negated"},
    {"train/value_loss", "", "clipped, times its weight"},
    {"train/exploration_loss", "", "entropy or symmetric KL to uniform, times its weight"},
    {"train/kl_loss", "", "KL to the behaviour policy, times its weight"},
    {"train/kl_divergence", "nats", "to the behaviour policy, mean"},
    {"train/kl_divergence_max", "nats", ""},
    {"train/kl_first", "nats", "in a batch's first minibatch: staleness alone"},
    {"train/entropy", "nats", "summed over heads"},
    {"train/entropy_head_<i>", "nats", "ln n for a uniform head of n choices"},
    {"train/value", "normalised", "predicted"},
    {"train/value_delta", "normalised", "mean distance from the behaviour policy's value"},
    {"train/value_delta_max", "normalised", ""},
    {"train/value_clip_fraction", "share", "samples whose value loss `ppo_clip_value` decides"},
    {"train/explained_variance", "",
     "1 - Var(R - V) / Var(R) of the behaviour policy's values; null where all returns are equal"},
    {"train/ratio_mean", "", "pi / mu of the actions taken"},
    {"train/ratio_min", "", ""},
    {"train/ratio_max", "", ""},
    {"train/fraction_clipped", "share", "samples whose ratio is beyond the clip"},
    {"train/fraction_clipped_first", "share", "in a batch's first minibatch"},
    {"train/max_abs_logprob", "nats", ""},
    {"train/adv_mean", "reward", "before standardisation"},
    {"train/adv_min", "reward", ""},
    {"train/adv_max", "reward", ""},
    {"train/adv_std", "reward", ""},
    {"train/act_min", "index", "smallest choice in any head"},
    {"train/act_max", "index", "largest choice in any head"},
    {"train/same_policy_fraction", "share", "always 1: a run trains one team"},
    {"train/obs_running_mean", "", "mean over the input's elements"},
    {"train/obs_running_std", "", "mean over the input's elements"},
    {"train/returns_running_mean", "reward", "with `normalize_returns`"},
    {"train/returns_running_std", "reward", "with `normalize_returns`"},
    {"train/targets_clipped_fraction", "share",
     "returns beyond `returns_clip` deviations; mixers: targets cut by `q_value_clamp`"},
    {"happo/factor_m_mean", "", "mean of M over the advantage: what agents trained earlier changed"},
    {"happo/factor_m_max", "", ""},
    {"happo/agent_order_first", "index", "agent trained first"},
    {"happo/critic_grad_norm", "", "before clipping"},
    {"happo/agent_<i>_policy_loss", "", "`train/` has the mean over agents"},
    {"happo/agent_<i>_grad_norm", "", "before clipping"},
    {"happo/agent_<i>_post_ratio_mean", "", "new policy over old; not of the last in the order"},
};
constexpr Metric kQLearningItsReplay[] = {
    {"train/td_loss", "", "the part that compares Q-values and targets"},
    {"train/target_q_max", "return", ""},
    {"train/target_mean_square", "return²", "`train/q_sigma` follows it"},
    {"train/agent_qs_mean", "return", "utility of an agent's action; QMIX: in the mixer's unit"},
    {"train/agent_qs_max", "return", ""},
    {"train/agent_qs_min", "return", ""},
    {"train/q_std_across_actions", "return", "over the choices of all heads"},
    {"train/q_sigma", "return", "factor of the networks' outputs (`normalize_q_values`)"},
    {"train/q_resets", "resets", "so far (`q_reset_every_updates`)"},
    {"train/n_step", "decisions", "rewards in a target (`n_step`, where `td_lambda` is below 0)"},
    {"train/done_ratio", "share", "decisions that ended an episode"},
    {"train/timeout_ratio", "share", "decisions at which time cut an episode"},
    {"train/num_updates", "updates", "so far"},
    {"train/epsilon", "share", "decisions left to chance"},
    {"train/per_beta", "0 to 1", "exponent of the importance weights (`per`)"},
    {"train/rewards_clipped_fraction", "share", "cut by `dqn_reward_clip`"},
    {"train/buffer_size", "units", "decisions or sequences, of all learners"},
    {"train/buffer_transitions", "agent decisions", ""},
    {"train/buffer_capacity", "agent decisions", ""},
    {"train/buffer_bytes", "bytes", ""},
    {"train/buffer_capacity_bytes", "bytes", ""},
};
constexpr Metric kIdqn[] = {
    {"train/dqn_q_mean", "return", "Q of the decisions taken, over heads"},
    {"train/dqn_q_max", "return", ""},
    {"train/dqn_q_min", "return", ""},
    {"train/dqn_target_q_mean", "return", ""},
    {"train/dqn_td_error_mean", "return", ""},
    {"train/dqn_num_updates", "updates", "same as `train/num_updates`"},
    {"train/dqn_steps_per_update", "agent decisions", "that came in for each update"},
    {"train/dqn_pending_steps", "agent decisions", "came in, updates still to be made"},
    {"train/policy_lag_valid_frac", "share", "decisions that count; age excludes none"},
    {"train/policy_lag_dropped", "agent decisions", "that do not count"},
    {"train/policy_lag_total", "agent decisions", "of the batch"},
};
constexpr Metric kVdnQmixQplex[] = {
    {"train/q_tot_mean", "return", "of the decisions taken"},
    {"train/q_tot_max", "return", ""},
    {"train/target_q_tot_mean", "return", ""},
    {"train/target_before_clamp", "return", "mean, before `q_value_clamp`"},
    {"train/td_error_mean", "return", "mean absolute error"},
    {"train/pending_transition_debt", "agent decisions", "came in, updates still to be made"},
    {"train/mixer_gain", "", "dQ_tot / dQ_i, mean over agents"},
    {"train/mixer_state_rms", "", "of the state that the mixer sees"},
    {"train/attend_mag_regs", "", "the attention's regularizer"},
    {"train/head_entropy_mean", "nats", "of the attention's heads over the agents"},
};
constexpr Metric kEpisodes[] = {
    {"reward/reward", "reward", "mean return of an agent"},
    {"reward/reward_min", "reward", ""},
    {"reward/reward_max", "reward", ""},
    {"len/len", "tics", "mean"},
    {"len/len_min", "tics", ""},
    {"len/len_max", "tics", ""},
    {"policy_stats/avg_true_objective", "score", "J, the scenario's team score"},
    {"policy_stats/avg_true_objective_min", "score", ""},
    {"policy_stats/avg_true_objective_max", "score", ""},
    {"policy_stats/avg_true_objective_share", "share",
     "of the best that each map allows (scenarios/POOLS.md)"},
    {"stats/rewarded_episodes_fraction", "share", "some agent's return was not 0"},
    {"stats/episodes", "episodes", "since the learner began"},
};
constexpr Metric kTheSystem[] = {
    {"perf/_fps", "env frames/s", "learned from, last 60 s"},
    {"perf/decisions_per_s", "decisions/s", "learned from, last 60 s"},
    {"perf/_sample_throughput", "decisions/s", "of the simulators, since the last report"},
    {"stats/learner_busy_fraction", "share", "of the learner's time not spent waiting"},
    {"stats/memory_learner", "MB", "resident, 10^6 bytes, with shared memory"},
    {"stats/avg_request_count", "rows", "in an inference batch"},
    {"stats/wait_policy", "s", "a policy worker's wait for a batch"},
    {"stats/step_policy", "s", "its work on a batch"},
    {"stats/batches_waiting", "batches", "full, not yet trained on"},
    {"stats/slabs_sealed", "slabs", "not yet taken by the learner"},
    {"stats/broken_decisions", "agent decisions", "damaged and left out"},
    {"stats/env_frames_lost", "env frames", "trained on, then forgotten by killed learners"},
};
constexpr Metric kEvaluations[] = {
    {"eval/J", "score", "mean over episodes"},
    {"eval/J_ci95", "score", "half-width, Student t"},
    {"eval/J_min", "score", ""},
    {"eval/J_max", "score", ""},
    {"eval/J_share", "share", "of the best that each map allows"},
    {"eval/return", "reward", "mean of an agent"},
    {"eval/length", "tics", "mean"},
    {"eval/episodes", "episodes", "played"},
    {"eval/version", "steps", "policy version that played"},
    {"eval/seconds", "s", "the evaluation took"},
};
constexpr Metric kCurricula[] = {
    {"curriculum/entropy", "nats", "of the weights"},
    {"curriculum/tasks", "layouts", "with a weight"},
    {"curriculum/layouts_seen", "layouts", ""},
    {"curriculum/episodes", "episodes", ""},
    {"curriculum/draws", "draws", ""},
    {"curriculum/weight_max", "share", ""},
    {"curriculum/mean_score", "score", "smoothed J, mean over played layouts"},
    {"curriculum/late_draws", "draws", "too late: the simulator repeated its layout"},
    {"curriculum/lost_outcomes", "episodes", "overwritten before the learner read them"},
    {"curriculum/position", "index", "layout learned now"},
    {"curriculum/learning_progress", "score", "mean over layouts"},
    {"curriculum/raw_score", "score", "mean over layouts"},
    {"curriculum/score", "", "PLR score, mean over layouts"},
    {"curriculum/staleness", "draws", "mean over layouts"},
    {"curriculum/seen", "share", "layouts already played"},
};

}  // namespace

const std::vector<MetricGroup>& metric_groups() {
  static const std::vector<MetricGroup> groups = {
      {"Every algorithm: the last minibatch before the report", "", kEveryAlgorithm},
      {"IPPO, MAPPO and HAPPO",
       "Policy numbers are means over living agents' decisions, value numbers over all valid ones.",
       kIppoMappoHappo},
      {"Q-learning and its replay", "", kQLearningItsReplay},
      {"IDQN", "", kIdqn},
      {"VDN, QMIX and QPLEX", "The last four are not VDN's; the last two are QPLEX-Q's alone.",
       kVdnQmixQplex},
      {"Episodes: the last `stats_avg`", "Not written before an episode has ended, except `stats/episodes`.",
       kEpisodes},
      {"The system", "", kTheSystem},
      {"Evaluations (`--eval_every_env_frames`)",
       "Separate lines, whose `env_frames` and `time_s` are the checkpoint's; in TensorBoard the run "
       "`<run>/eval`, with `eval/video`, a GIF (`--video_every_env_frames`). The supervisor writes them.",
       kEvaluations},
      {"Curricula (`--layout_pool`)",
       "`position` belongs to `sequential`, the next two to `learning_progress` and `omni`, the last three "
       "to `plr`; the rest to all.",
       kCurricula},
  };
  return groups;
}

std::string metrics_text() {
  constexpr std::size_t kNameColumns = 42, kUnitColumns = 16;
  const auto padded = [](std::string_view word, std::size_t columns) {
    return std::string(word) + std::string(columns - std::min(word.size(), columns), ' ') + " ";
  };
  std::string text;
  for (const MetricGroup& group : metric_groups()) {
    text += (text.empty() ? "" : "\n") + std::string(group.title) + "\n";
    if (!group.note.empty()) text += std::string(group.note) + "\n";
    for (const Metric& metric : group.metrics)
      text += "  " + padded(metric.name, kNameColumns) + padded(metric.unit, kUnitColumns) +
              std::string(metric.meaning) + "\n";
  }
  return text;
}

std::string metrics_markdown() {
  std::string text;
  for (const MetricGroup& group : metric_groups()) {
    text += (text.empty() ? "### " : "\n### ") + std::string(group.title) + "\n\n";
    if (!group.note.empty()) text += std::string(group.note) + "\n\n";
    text += "| name | unit | meaning |\n|---|---|---|\n";
    for (const Metric& metric : group.metrics)
      text += "| `" + std::string(metric.name) + "` | " + std::string(metric.unit) + " | " +
              std::string(metric.meaning) + " |\n";
  }
  return text;
}

}  // namespace comrad
