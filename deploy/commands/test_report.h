// Reads ctest's words for what was skipped and why.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace comrad::deploy {

/// The name in a line of ctest's output that reports a skipped test ("3/9 Test #3: name ...***Skipped  0.0
/// sec"); empty for every other line.
std::string_view skipped_test(std::string_view line);

/// Whether a line of ctest's output begins its closing summary ("90% tests passed, 1 tests failed out
/// of 10").
bool is_closing_line(std::string_view line);

/// Why `test` skipped, from ctest's log (Testing/Temporary/LastTest.log). Each GoogleTest case that skipped
/// gives one "Suite.Case: text of GTEST_SKIP()"; other programs give the last line they printed.
std::vector<std::string> skip_reasons(std::string_view log, std::string_view test);

}  // namespace comrad::deploy
