// A Python with ViZDoom's pip package, for tests that compare with it.
#pragma once

#include "tests/support/test_python.h"

namespace comrad::test {

/// As python_with("vizdoom").
inline Expected<std::string> vizdoom_python() { return python_with("vizdoom"); }

}  // namespace comrad::test
