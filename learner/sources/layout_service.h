// The one curriculum of a run at work: reads from the arena's episode stream how episodes ended, assigns every
// environment its next layout, and reports to PLR what training saw of each layout. Lives in the learner's
// training thread. Stage: reset, from the learner's side.
//
//   simulator ── episode stream ──▶ serve ──▶ curriculum.update
//   simulator ◀─ layout mailbox ── serve ◀── curriculum.draw
//   batch ── score ──▶ curriculum.score (PLR)
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "learner/batch/collate.h"
#include "learner/checkpoint/checkpoint.h"
#include "learner/curriculum/curriculum.h"
#include "learner/ranks/rank_group.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/core/layout_list.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::learn {

/// The curriculum's options as the run's settings and the pool's list have them. Errors: kNotFound and
/// kBadFormat of the interestingness graph, kBadInput where it names a layout that is not in the pool.
Expected<CurriculumOptions> curriculum_options(const RunConfig& config, const LayoutList& list);

/// Reads an interestingness graph: a JSON object, layout -> (other layout -> is it still interesting?).
/// Errors: kNotFound; kBadFormat with line and column, or naming the entry.
Expected<std::map<std::string, std::set<std::string>>> read_interestingness_graph(const std::string& path);

/// What a batch shows about one layout, over its decisions of living agents (RolloutBatch::acting).
struct LayoutSignal {
  int layout_index = 0;
  int64_t decisions = 0;
  double mean = 0, maximum = 0;
};

/// The signal `score_key` of every layout that is present in a trained batch, by rising index.
///   mean_value_l1 |advantage|   mean_advantage advantage   mean_entropy entropy of the behaviour policy
/// Advantages are raw ones: ten times the reward scores ten times as much, whatever the algorithm.
/// Decisions of layouts outside 0..layout_count-1 are left out.
std::vector<LayoutSignal> layout_signals(const RolloutBatch& batch, PlrScore score_key, int layout_count);
/// What the batches of all learners say together, by rising index.
std::vector<LayoutSignal> of_all_ranks(const std::vector<LayoutSignal>& signals, RankGroup& ranks);

class LayoutService {
 public:
  /// Reads the pool's list from the run directory. Null where the run plays one map.
  /// Errors: those of read_layout_list(), curriculum_options() and Curriculum::create().
  static Expected<std::unique_ptr<LayoutService>> open(const RunConfig& config, const std::string& run_dir);

  /// Takes in the episodes that have ended, in the order of the environments, then draws for every environment that
  /// took its last assignment. Never blocks.
  void serve(const shm::Arena& arena);

  /// A trained batch of this learner and those of all others: masks and advantages are the algorithm's.
  void score(const RolloutBatch& batch, RankGroup& ranks);

  /// "curriculum/entropy", ... for the run's metrics.
  void append_to(std::vector<std::pair<std::string, double>>& metrics);

  /// Remembers the mailboxes as they are between two rollouts, for exact resume; `exact` false forgets them.
  void capture_mailboxes(const shm::Arena& arena, bool exact);
  /// Writes remembered mailboxes into a fresh arena before simulators begin. Errors: kBadFormat where they are
  /// those of another number of environments.
  Status restore_mailboxes(const shm::Arena& arena) const;

  /// Section "curriculum" of a checkpoint.
  void save(StateDict& state) const;
  /// Errors: kBadInput where the checkpoint has no curriculum, or one of other layouts; kBadFormat.
  Status load(const StateDict& state);
  static bool is_in(const StateDict& state) { return state.has("curriculum/state"); }

  /// Leaves `<run_dir>/curriculum_state.json` for eyes and scripts. Errors: kNoSpace, kSystem.
  Status write_file(const std::string& run_dir) const;

  Curriculum& curriculum() { return *curriculum_; }

 private:
  LayoutService(std::unique_ptr<Curriculum> curriculum, std::optional<PlrScore> score_key)
      : curriculum_(std::move(curriculum)), score_key_(score_key) {}

  std::unique_ptr<Curriculum> curriculum_;
  std::optional<PlrScore> score_key_;  // none: the strategy does not listen to training
  std::vector<int64_t> mailboxes_;     // [env, kMailboxFields]; empty: none remembered
  uint64_t lost_outcomes_ = 0;         // that it came too late for
  uint64_t late_draws_ = 0;
};

}  // namespace comrad::learn
