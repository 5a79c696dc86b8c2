// Names that are no setting, one row each. Most are Sample Factory's: what COMRAD always does, the setting to use instead, or
// the one whose opposite it is; `core` stands for several settings, `epsilon_end` for a part of one,
// `qmix_batch_sequences` for replay_batch_size where that counts sequences. Names that mean the same as a setting are its old_names (setting.h).
// Stage: before a run.
#pragma once

#include <array>
#include <span>
#include <string>
#include <string_view>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/applies_when.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad {

/// One name. Either `setting` names a boolean setting whose opposite it is, `assign` sets what it stands for, or the other members
/// count.
struct OtherName {
  std::string_view name;
  bool is_boolean = false;        ///< may stand alone on the command line
  std::string_view setting = "";  ///< the boolean setting that is set to the opposite; empty: none
  std::string_view same = "";     ///< values that request what is done in any case, separated by blanks
  std::string_view instead = "";  ///< what to use instead, words that follow a colon

  Status (*assign)(RunConfig&, const std::string& origin, std::string_view text) = nullptr;
  std::array<std::string_view, 4> sets = {};  ///< what `assign` sets
  /// Where the name is another one for sets[0] in some runs only. Elsewhere nothing is set. Null: in all.
  AppliesWhen applies_when = {};

  bool applies(const RunConfig& config) const {
    return applies_when.holds == nullptr || applies_when.holds(config);
  }
  /// Whether `text` requests what is done in any case. Errors: kBadInput with `instead`.
  Status accept(const std::string& origin, std::string_view text) const;
};

std::span<const OtherName> other_names();
/// Null where no setting has that name.
const OtherName* find_other_name(std::string_view name);

}  // namespace comrad
