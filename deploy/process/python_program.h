// The Python that draws and exports: plots, reports and exports are Python programs in deploy/report.
#pragma once

#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// What reports and plots import.
constexpr const char* kReportModules = "numpy, scipy, matplotlib";

/// A Python that can import `modules` ("matplotlib, scipy"): Debian's, whose packages ./comrad installs
/// (deploy/packages_report.txt), else the one of PATH. Errors: kNotFound, with `what_to_do`.
Expected<std::string> python_that_imports(
    const std::string& modules,
    const std::string& what_to_do =
        "install python3-matplotlib, python3-numpy and python3-scipy, as ./comrad report does on Debian");

/// The Python of an environment that ./comrad makes: the one that `variable` names ("COMRAD_SEARCH_PYTHON") and no other, else
/// <build folder>/<environment>, Debian's, or the one of PATH; the first that runs `imports`. Errors: kNotFound with `what_to_do`.
Expected<std::string> python_of_environment(const char* variable, const std::string& environment,
                                            const std::string& imports, const std::string& what_to_do);

/// The command that runs `script`, a path below data_dir() ("deploy/report/export.py"), with `words`.
std::vector<std::string> python_command(const std::string& python, const std::string& script,
                                        const std::vector<std::string>& words);

/// Errors: kNotFound where `script` is not below data_dir(): what is installed lacks it.
Status check_checkout_has(const std::string& script);

}  // namespace comrad::deploy
