#include "learner/checkpoint/progress.h"

#include <spdlog/fmt/fmt.h>

#include <string>

namespace comrad::learn {

namespace {

constexpr const char* kStateKey = "algorithm/global_state_count";

std::string critic_words(int64_t global_state_count) {
  return global_state_count == 0 ? "critic_state features"
                                 : fmt::format("critic_state global ({} numbers)", global_state_count);
}

}  // namespace

void Progress::save(StateDict& state, const std::string& algorithm, int64_t global_state_count) const {
  state.put("algorithm/name", algorithm);
  state.put("algorithm/version", static_cast<int64_t>(version));
  state.put("algorithm/updates", updates);
  state.put(kStateKey, global_state_count);
}

Expected<Progress> Progress::load(const StateDict& state, const std::string& algorithm,
                                  int64_t global_state_count) {
  COMRAD_TRY_ASSIGN(const std::string maker, state.text("algorithm/name"));
  if (maker != algorithm)
    return Error{ErrorCode::kBadFormat,
                 "checkpoint was made by \"" + maker + "\", this run trains " + algorithm};
  int64_t seen = 0;  // a checkpoint without it is of the time when features were all that critics saw
  if (state.has(kStateKey)) {
    COMRAD_TRY_ASSIGN(seen, state.integer(kStateKey));
  }
  if (seen != global_state_count)
    return Error{ErrorCode::kBadFormat, "checkpoint was made with " + critic_words(seen) + ", this run has " +
                                            critic_words(global_state_count)};
  COMRAD_TRY_ASSIGN(const int64_t version, state.integer("algorithm/version"));
  COMRAD_TRY_ASSIGN(const int64_t updates, state.integer("algorithm/updates"));
  return Progress{static_cast<PolicyVersion>(version), updates};
}

}  // namespace comrad::learn
