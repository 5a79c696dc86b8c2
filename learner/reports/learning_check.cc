#include "learner/reports/learning_check.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>

#include "learner/algorithms/q_learning.h"

namespace comrad::learn {
namespace {

/// Reports in a row before a number of the last minibatch counts: at the usual ten seconds each, a minute.
constexpr int kReports = 6;
/// Before this many optimizer steps Adam's second moments (0.999 a step) and value estimates are still those of
/// the start.
constexpr double kFirstSteps = 1000;

/// Before the first step on a batch no sample would lie outside the interval if the behaviour policy were the
/// one that is trained; ten to twenty per cent are usual after all epochs of a healthy run. A sample outside, on
/// the side that its advantage points to, has no gradient.
constexpr double kClippedMax = 0.3;
/// Adam's step is scaled by s / (s + epsilon), s the root of the second moment: below a tenth the part learns
/// at less than a tenth of the learning rate, and the less the smaller its gradient, as plain SGD would.
constexpr double kAdamGainMin = 0.1;
/// The limit is there for outliers. Where a tenth of the targets lies beyond it, it cuts what is to be learned.
constexpr double kTargetsClippedMax = 0.1;
/// Below 0.6 in a QMIX run that learned, 4 to 22 from the report on in which it lost what it had learned
/// (learner/RECIPES.md).
constexpr double kMixerStateMax = 3;
/// Rows that are too old, or of dead agents, are computed and thrown away. At a half the run costs twice.
constexpr double kValidsMin = 0.5;
/// The queues of a run that keeps up hold two to five batches. From ten on nothing that PPO assumes of the
/// behaviour policy holds.
constexpr double kLagBatchesMax = 10;
/// Noise of a minibatch makes 0 a hard limit, so it has to be crossed for twice as long.
constexpr int kValueReports = 12;
/// Even where chance is paid only in one episode of thirty, fewer than one run in twenty sees none in a hundred.
constexpr double kEpisodesMin = 100;
/// At the end a policy should mostly do what it has learned.
constexpr double kLastEpsilonMax = 0.5;

std::optional<double> find(const MetricValues& values, const std::string& name) {
  const auto found = std::ranges::find(values, name, &MetricValues::value_type::first);
  if (found == values.end() || !std::isfinite(found->second)) return std::nullopt;
  return found->second;
}

template <typename... Values>
std::string format(const char* pattern, Values... values) {
  char text[400];
  std::snprintf(text, sizeof text, pattern, values...);
  return text;
}

double per_cent(double share) { return 100 * share; }

/// No episode brought a reward: then there are no gradients, and their size shows nothing else.
bool is_unpaid(const MetricValues& values) {
  return find(values, "stats/rewarded_episodes_fraction").value_or(1) == 0;
}

bool is_early(const MetricValues& values) {
  return find(values, "train/num_sgd_steps").value_or(kFirstSteps) < kFirstSteps;
}

}  // namespace

bool LearningCheck::shows(const std::string& name, bool bad, int reports) {
  Finding& finding = findings_[name];
  finding.bad_in_a_row = bad ? finding.bad_in_a_row + 1 : 0;
  if (finding.told || finding.bad_in_a_row < reports) return false;
  return finding.told = true;
}

std::vector<std::string> LearningCheck::judge_settings() {
  std::vector<std::string> told;
  const Schedule& epsilon = config_.q_learning.epsilon;
  const double last = epsilon.at(config_.run.train_for_env_frames);
  const bool is_meant = epsilon.last() > kLastEpsilonMax;
  if (config_.run.algo->learns_q_values() && shows("epsilon", last > kLastEpsilonMax && !is_meant, 1))
    told.push_back(
        format("the run ends at epsilon %.2f: agents then still choose %.0f%% of their actions by chance; "
               "--epsilon (%s) must end before train_for_env_frames (%.3g)",
               last, per_cent(last), epsilon.text().c_str(), config_.run.train_for_env_frames));
  return told;
}

std::vector<std::string> LearningCheck::judge(const MetricValues& values) {
  std::vector<std::string> told;
  judge_batches(values, told);
  judge_optimizer(values, told);
  judge_targets(values, told);
  return told;
}

/// What comes into the updates.
void LearningCheck::judge_batches(const MetricValues& values, std::vector<std::string>& told) {
  const std::optional<double> rewarded = find(values, "stats/rewarded_episodes_fraction");
  const double enough = std::max(kEpisodesMin, static_cast<double>(config_.run.stats_avg));
  if (rewarded && find(values, "stats/episodes").value_or(0) >= enough &&
      shows("rewarded", *rewarded == 0, kReports))
    told.push_back(
        format("none of the last %d episodes brought any reward, so there is nothing to learn from; "
               "explore more (exploration_loss_coeff, epsilon) or begin on an easier map",
               static_cast<int>(config_.run.stats_avg)));

  // Later epochs move away from the behaviour policy on purpose, so their share shows nothing.
  std::optional<double> clipped = find(values, "train/fraction_clipped_first");
  if (!clipped && config_.optimisation.num_epochs == 1) clipped = find(values, "train/fraction_clipped");
  if (clipped && shows("clipped", *clipped > kClippedMax, kReports))
    told.push_back(format(
        "%.0f%% of the samples lie outside PPO's clip interval before the first step on them: they come from "
        "a policy that is too different by now, and many teach nothing; lower learning_rate or "
        "num_envs_per_worker, or raise ppo_clip_ratio (%s)",
        per_cent(*clipped), config_.on_policy.ppo_clip_ratio.text().c_str()));

  const std::optional<double> valid = find(values, "train/valids_fraction");
  if (valid && shows("valid", *valid < kValidsMin, kReports))
    told.push_back(
        format("only %.0f%% of the decisions in a batch can be trained on; the others are older than "
               "max_policy_lag (%d optimizer steps) or of agents that are dead: fewer environments "
               "(num_workers, num_envs_per_worker) make them younger",
               per_cent(*valid), static_cast<int>(config_.collection.max_policy_lag)));

  if (config_.run.algo->learns_q_values()) return;  // a replay is old on purpose
  const std::optional<double> lag = find(values, "train/version_diff_avg");
  // HAPPO makes a version for each agent's turn and one for the critic.
  const double steps =
      static_cast<double>(config_.optimisation.num_epochs * config_.optimisation.num_batches_per_epoch *
                          config_.run.algo->versions_per_batch(config_.environment.num_agents));
  if (lag && shows("lag", *lag > kLagBatchesMax * steps, kReports))
    told.push_back(
        format("decisions are %.0f optimizer steps (%.0f batches) old when they are trained on, too old "
               "for an on-policy algorithm; lower num_envs_per_worker, num_workers or trajectory_slabs, "
               "or turn on with_vtrace",
               *lag, *lag / steps));
}

/// What the optimizer makes of gradients.
void LearningCheck::judge_optimizer(const MetricValues& values, std::vector<std::string>& told) {
  static const std::string kGain = "train/adam_gain_";
  if (is_early(values) || is_unpaid(values)) return;
  for (const auto& [name, gain] : values) {
    if (!name.starts_with(kGain) || !std::isfinite(gain) || !shows(name, gain < kAdamGainMin, kReports))
      continue;
    told.push_back(
        format("gradients of the network's part \"%s\" are so small that Adam's epsilon leaves %.2g of "
               "their step: it hardly learns; lower adam_eps (%g) or raise reward_scale (%g)",
               name.substr(kGain.size()).c_str(), gain, config_.optimisation.adam_eps,
               config_.environment.reward_scale));
  }
}

/// What values are taught.
void LearningCheck::judge_targets(const MetricValues& values, std::vector<std::string>& told) {
  const std::optional<double> clipped = find(values, "train/targets_clipped_fraction");
  if (clipped && shows("targets", *clipped > kTargetsClippedMax, kReports)) {
    const bool is_q = config_.run.algo->learns_q_values();
    told.push_back(
        format("%.0f%% of the value targets are cut off at the limit %s (%g), so values above it cannot "
               "be distinguished; raise it or lower reward_scale (%g)",
               per_cent(*clipped), is_q ? "q_value_clamp" : "returns_clip",
               is_q ? config_.q_learning.q_value_clamp : config_.optimisation.returns_clip,
               config_.environment.reward_scale));
  }
  const std::optional<double> state = find(values, "train/mixer_state_rms");
  if (state && shows("mixer_state", *state > kMixerStateMax, kReports))
    told.push_back(format(
        "the features that are the mixer's state have grown to a root mean square of %.1f (below 1 in runs "
        "that learn): its weights and gradients grow with them, and agents may lose what they have learned; "
        "set mixer_state_deviation (1), or lower learning_rate (%s) or max_grad_norm (%g)",
        *state, config_.optimisation.learning_rate.text().c_str(), config_.optimisation.max_grad_norm));
  const std::optional<double> explained = find(values, "train/explained_variance");
  if (explained && !is_early(values) && !is_unpaid(values) &&
      shows("explained", *explained < 0, kValueReports))
    told.push_back(
        format("the critic predicts returns worse than their mean would (explained variance %.2f), so "
               "advantages are mostly noise; raise value_loss_coeff (%g) or batch_size, or lower gamma (%g)",
               *explained, config_.on_policy.value_loss_coeff, config_.optimisation.gamma));
}

}  // namespace comrad::learn
