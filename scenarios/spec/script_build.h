// The one place where the frame meets the ACS compiler: script.acs and the layout's numbers in, BEHAVIOR out.
#pragma once

#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::scenarios {

struct BuiltScript {
  std::string behavior;  ///< empty where this build has no compiler
  std::string source;    ///< what goes into SCRIPTS: the layout's numbers, then script.acs
  std::vector<std::string> warnings;
};

/// Compiles `<folder>/script.acs`, which sees `layout_text` in front of it (messages keep the file's own
/// lines). It may include other files of its folder. Errors: kBadFormat with file, line and column; kSystem.
Expected<BuiltScript> build_script(const std::string& folder, const std::string& layout_text);

}  // namespace comrad::scenarios
