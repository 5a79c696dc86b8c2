// Scores that a scenario's J is compared with: those of random play and of the scripted team, as
// scenarios/reference_scores.toml holds them for every scenario's default map and team. Stage: reports.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "rollout_buffer/core/expected.h"

namespace comrad {

/// The map of those scores: this layout_seed, generated.
constexpr int64_t kReferenceLayoutSeed = 42;

struct ReferenceScores {
  double random = 0;    ///< J of random play
  double scripted = 0;  ///< J of the scripted team, above `random`

  /// 0 for random play, 1 for the scripted team.
  double normalised(double score) const { return (score - random) / (scripted - random); }
};

/// The scores of `scenario` with a team of `num_agents` in a document of that kind; nothing where it has none.
/// Errors: kBadFormat as "label:line:column: what".
Expected<std::optional<ReferenceScores>> find_reference_scores(std::string_view text,
                                                               const std::string& label,
                                                               const std::string& scenario,
                                                               int64_t num_agents);

/// The same of `<data_dir>/scenarios/reference_scores.toml`; nothing where that file is not there.
Expected<std::optional<ReferenceScores>> read_reference_scores(const std::string& scenario,
                                                               int64_t num_agents);

}  // namespace comrad
