#include "learner/algorithms/progress.h"

#include <string>

namespace comrad::learn {

void Progress::save(StateDict& state, const std::string& algorithm) const {
  state.put("algorithm/name", algorithm);
  state.put("algorithm/version", static_cast<int64_t>(version));
  state.put("algorithm/updates", updates);
}

Expected<Progress> Progress::load(const StateDict& state, const std::string& algorithm) {
  COMRAD_TRY_ASSIGN(const std::string maker, state.text("algorithm/name"));
  if (maker != algorithm)
    return Error{ErrorCode::kBadFormat,
                 "checkpoint was made by \"" + maker + "\", this run trains " + algorithm};
  COMRAD_TRY_ASSIGN(const int64_t version, state.integer("algorithm/version"));
  COMRAD_TRY_ASSIGN(const int64_t updates, state.integer("algorithm/updates"));
  return Progress{static_cast<PolicyVersion>(version), updates};
}

}  // namespace comrad::learn
