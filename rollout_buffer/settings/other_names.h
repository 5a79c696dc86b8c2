// Names that users of Sample Factory type and that are no setting here, one row each: what COMRAD always does, the setting
// to use instead, or the one whose opposite it is. Names that mean the same as a setting are its old_names (setting.h).
// Stage: before a run.
#pragma once

#include <span>
#include <string>
#include <string_view>

#include "rollout_buffer/core/expected.h"

namespace comrad {

/// One name. Either `setting` names a boolean setting whose opposite it is, or the other members count.
struct OtherName {
  std::string_view name;
  bool is_boolean = false;        ///< may stand alone on the command line
  std::string_view setting = "";  ///< the boolean setting that is set to the opposite; empty: none
  std::string_view same = "";     ///< values that ask for what is done in any case, separated by blanks
  std::string_view instead = "";  ///< what to use instead, words that follow a colon

  /// Whether `text` asks for what is done in any case. Errors: kBadInput with `instead`.
  Status accept(const std::string& origin, std::string_view text) const;
};

std::span<const OtherName> other_names();
/// Null where nobody has that name.
const OtherName* find_other_name(std::string_view name);

}  // namespace comrad
