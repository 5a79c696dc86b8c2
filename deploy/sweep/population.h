// Population-based training: what a member does between two generations, decided from what all members have done so far, and
// the files that say so. Each is written by the member's own element alone, beside its place and renamed:
//
//   <sweep>/search/<run>.json      the member's generations, the last one maybe under way
//   <sweep>/search/<run>/<n>/      the checkpoint that its generation n left; stays
//   <run>/checkpoint_<n>/          its checkpoints before generation n, which began with another member's
//
// No member waits for another: it is compared with those that have finished as many generations.
// Source: Jaderberg et al. 2017, Population Based Training of Neural Networks, arXiv:1711.09846, sections 3 and 4.1
// (truncation selection; perturb or resample).
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "deploy/sweep/search_space.h"
#include "deploy/sweep/sweep_folder.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// A stretch of a member's training with one set of searched settings.
struct Generation {
  SettingValues settings;
  std::string parent =
      {};  ///< the member whose checkpoint of the generation before it began with; empty: its own
  double env_frames = 0;        ///< where it ended; 0: it is under way
  double score = std::nan("");  ///< J there; NaN where no episode had ended
  bool is_over() const { return env_frames > 0; }
};

struct Member {
  std::string name;  ///< its run's
  std::vector<Generation> generations;
};

/// What member `index` does next; its last generation is over, or it has none. A member in the bottom quantile of the scores
/// of its generation takes checkpoint and settings of one in the top quantile, and changes the settings: each is drawn anew
/// with a probability, else a number is multiplied by one of the factors. Depends on the seed and the members alone. Pure.
Generation next_generation(const SweepSearch& search, const std::vector<Member>& members, std::size_t index);

/// The members of the run's study, in the order of their numbers. One whose file cannot be used counts as one that has done
/// nothing, but for the run's own. Errors: kBadFormat with what to do.
Expected<std::vector<Member>> read_members(const SweepFolder& folder, const SweepRun& run);

/// Errors: kNoSpace, kSystem.
Status write_member(const SweepFolder& folder, const Member& member);

/// Keeps the run's newest checkpoint, with its replay, as what generation `number` left. Errors: kNotFound, kNoSpace, kSystem.
Status keep_checkpoint(const SweepFolder& folder, const SweepRun& run, std::size_t number);

/// Puts what `parent` kept of the generation before `number` in the place of the run's checkpoints, which move to
/// checkpoint_<number>. Nothing where that was done. Errors: kNotFound, kNoSpace, kSystem.
Status take_checkpoint(const SweepFolder& folder, const SweepRun& run, std::size_t number,
                       const std::string& parent);

}  // namespace comrad::deploy
