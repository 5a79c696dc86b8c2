// Files that a command is to write, checked before anything starts.
#pragma once

#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// What is wrong with the value of a flag, as "--flag=value: what". kBadInput.
Error bad_value(const std::string& flag, const std::string& value, const std::string& what);

/// Files can be made in `folder`. Errors: kBadInput.
Status check_output_folder(const std::string& flag, const std::string& value, const std::string& folder);

/// The absolute path of a folder to fill: it is not there yet or is empty, else "the folder holds files already" and `why_not` behind it are said. Errors: kBadInput.
Expected<std::string> check_new_folder(const std::string& flag, const std::string& value,
                                       const std::string& why_not);

/// The absolute path of a file to write: its name ends in one of `extensions` (".png"), and its folder is there.
/// Errors: kBadInput.
Expected<std::string> check_output_file(const std::string& flag, const std::string& value,
                                        const std::vector<std::string>& extensions);

}  // namespace comrad::deploy
