// Reads ctest's words for what was skipped and why.
#pragma once

#include <optional>
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

/// The name and seconds of a test that has run, from a line of ctest's output ("3/9 Test #3: name ....   Passed    1.20 sec").
struct TestTime {
  std::string name;
  double seconds = 0;
};
std::optional<TestTime> test_time(std::string_view line);

/// The words that allow a skip: what is in backquotes in the last column of the table of tests/SKIPPED.md.
std::vector<std::string> allowed_words(std::string_view page);

/// Whether `reason` contains one of `words`.
bool is_allowed(std::string_view reason, const std::vector<std::string>& words);

}  // namespace comrad::deploy
