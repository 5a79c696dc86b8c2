// The Python that draws: plots and reports are Python programs in deploy/report.
#pragma once

#include <string>

#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// A Python that can import `modules` ("matplotlib, scipy"): Debian's, whose packages ./comrad installs
/// (deploy/packages_report.txt), else the one of PATH. Errors: kNotFound, saying what to do.
Expected<std::string> python_that_imports(const std::string& modules);

}  // namespace comrad::deploy
