// Which layout of a pool comes next: one object per run makes every draw. Pure bookkeeping: same seed, same
// messages, same draws. Stage: reset (what the next episode is played on).
//
//   draw    a fresh generator seeded with seed + counter * 0x9E3779B97F4A7C15, counter += 1: index ~ weights
//   update  a finished episode: (task, mean over agents of J)
//   score   PLR alone: what the learner saw in a batch: (task, steps, mean, max of the chosen signal)
//
// Sources: Portelas et al. 2020 (learning progress); Kanitscheider et al. 2021, arXiv:2106.14876 (its
// reweighting); Zhang et al. 2024, OMNI, arXiv:2306.01711; Jiang et al. 2021, PLR, arXiv:2010.03934.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/words.h"

namespace comrad::learn {

struct CurriculumOptions {
  CurriculumKind kind = CurriculumKind::kUniform;
  uint64_t seed = 0;
  // sequential
  double threshold = 0.8,
         max_return = 1.0;  ///< max_return: a scenario's ceiling; learning progress uses it too
  int window = 100;
  int min_outcomes =
      20;  ///< outcomes of a task, or a full window, before the next one may come; 1: as published
  // learning_progress, omni
  double p_theta = 0.1, min_return = 0.0, uniform_prob = 0.25, smoothing = 0.1;
  double omni_mastery = 0.0;  ///< a task counts as mastered from this fraction of max_return on
  double boring_factor = 0.001;
  /// task -> tasks that it makes uninteresting once it is mastered; empty: each makes itself so (no effect)
  std::map<std::string, std::set<std::string>> uninteresting = {};
  /// Per task: its best score (0: max_return). Stands for max_return then, and OMNI compares scores as
  /// fractions of it.
  std::vector<double> task_scale = {};
  // plr
  double max_score_coef = 0.0, alpha = 1.0, temperature = 0.1;
  PlrTransform transform = PlrTransform::kRank;
  double staleness_coef = 0.1, staleness_temperature = 1.0;
  PlrTransform staleness_transform = PlrTransform::kPower;
  bool proportionate = true;  ///< else the fixed schedule
  double replay_prob = 0.5, rho = 1.0, eps = 0.05;
};

/// One run's curriculum over n tasks. Not thread-safe: the learner's process owns it.
class Curriculum {
 public:
  /// Errors: kBadInput for no tasks, or an option out of range, by its name.
  static Expected<std::unique_ptr<Curriculum>> create(const CurriculumOptions& options,
                                                      std::vector<std::string> task_names);
  virtual ~Curriculum() = default;
  Curriculum(const Curriculum&) = delete;
  Curriculum& operator=(const Curriculum&) = delete;

  int task_count() const { return static_cast<int>(task_names_.size()); }
  const std::vector<std::string>& task_names() const { return task_names_; }
  const std::vector<int64_t>& episode_counts() const { return counts_; }

  /// The next task. Moves the counter on.
  int draw();
  /// An episode of `task` ended with `outcome`.
  void update(int task, double outcome);
  /// What the learner saw of `task` in one batch; only PLR listens.
  virtual void score(int task, int64_t steps, double mean, double maximum);
  /// Current weights: not negative, sum 1.
  const std::vector<double>& weights();
  /// Entropy of the weights, tasks with weight, tasks that were played, episodes, draws, largest weight, mean
  /// over played tasks of their smoothed score, and what the strategy adds.
  std::vector<std::pair<std::string, double>> metrics();

  /// Everything that the next draw depends on, as text for a checkpoint.
  std::string state() const;
  /// Errors: kBadFormat; kBadInput where kind or task list are others than this curriculum's.
  Status restore(const std::string& text);

 protected:
  Curriculum(const CurriculumOptions& options, std::vector<std::string> task_names);
  /// The best score of a task.
  double maximum(std::size_t task) const {
    return task < options_.task_scale.size() && options_.task_scale[task] > 0.0 ? options_.task_scale[task]
                                                                                : options_.max_return;
  }
  virtual int draw_from(uint64_t draw_seed);
  virtual void record(int task, double outcome) = 0;
  virtual void refresh() {}
  virtual void strategy_metrics(std::vector<std::pair<std::string, double>>&) const {}
  /// Arrays of the strategy's own, by name, written and read in this order.
  virtual std::vector<std::pair<std::string, std::vector<double>*>> arrays() = 0;

  CurriculumOptions options_;
  std::vector<std::string> task_names_;
  std::vector<double> weights_;
  std::vector<int64_t> counts_;
  std::vector<double> means_;  // smoothed outcome of each task; 0 before its first
  uint64_t counter_ = 0;
};

/// g(p) = p (1 - theta) / (p + theta (1 - 2 p)); 0 where the denominator is.
double learning_progress_reweight(double p, double theta);

/// Normalised weights of tasks by the transform (tasks with seen = 0 get none); `draw_seed` decides ties
/// of max.
std::vector<double> plr_weights(std::span<const double> value, std::span<const double> seen,
                                PlrTransform transform, double temperature, double eps, double staleness_coef,
                                uint64_t draw_seed);

}  // namespace comrad::learn
