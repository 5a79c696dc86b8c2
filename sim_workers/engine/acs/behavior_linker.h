// Joins the lumps of a map and of its libraries into one Behavior: tables behind each other, and what one imports from another
// resolved by name. Stage: loading.
#pragma once

#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/engine/acs/behavior.h"
#include "sim_workers/engine/acs/behavior_reader.h"

namespace comrad::doom::acs {

class BehaviorLinker {
 public:
  /// `map` is what the others are added to.
  BehaviorLinker(Behavior& map, const BehaviorLinks& links) : all_(map), links_{links} {}

  /// Appends a library. Of scripts with the same number or name the first stays.
  void add(const Behavior& library, const BehaviorLinks& links);
  /// Finds the functions and variables that each module imports.
  void resolve();

 private:
  Behavior& all_;
  std::vector<BehaviorLinks> links_;  // by module
};

}  // namespace comrad::doom::acs
