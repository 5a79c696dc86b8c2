// main() of every GoogleTest program. A program holds the tests of a folder; --source=unit/a/b_test.cc, which may stand more than
// once, runs those of one source but for the long ones, and with --long the long ones alone: those whose suite, or the instantiation
// of their suite, has a name that ends in Long. Exit codes: 0 all passed, 1 something failed, 77 nothing failed and something was skipped. 77 is
// ctest's SKIP_RETURN_CODE; a pattern of the output in its place would call a failed program skipped.
#include <gtest/gtest.h>

#include <cstdio>
#include <string>
#include <string_view>
#include <vector>

namespace {

constexpr std::string_view kSourceFlag = "--source=", kLongFlag = "--long";

bool is_long(std::string_view suite) { return suite.ends_with("Long") || suite.find("Long/") != suite.npos; }

/// GoogleTest's filter for the cases of `source`, the long ones or the others, with a colon behind each.
std::string filter_of(const std::string& source, bool wants_long) {
  std::string filter;
  const testing::UnitTest& all = *testing::UnitTest::GetInstance();
  for (int s = 0; s < all.total_test_suite_count(); ++s) {
    const testing::TestSuite& suite = *all.GetTestSuite(s);
    if (is_long(suite.name()) != wants_long) continue;
    for (int t = 0; t < suite.total_test_count(); ++t) {
      const testing::TestInfo& test = *suite.GetTestInfo(t);
      if (std::string_view(test.file()).ends_with("/" + source))
        filter += std::string(suite.name()) + "." + test.name() + ":";
    }
  }
  return filter;
}

int refuse(const std::string& source, const char* kind) {
  std::fprintf(stderr, "this program has no %stest of %s\n", kind, source.c_str());
  return 1;
}

}  // namespace

int main(int argc, char** argv) {
  constexpr int kSkipped = 77;
  testing::InitGoogleTest(&argc, argv);
  std::vector<std::string> sources;
  bool wants_long = false;
  for (int i = 1; i < argc; ++i) {
    const std::string_view word = argv[i];
    if (word.starts_with(kSourceFlag)) sources.emplace_back(word.substr(kSourceFlag.size()));
    wants_long |= word == kLongFlag;
  }
  if (!sources.empty() &&
      testing::GTEST_FLAG(filter) == "*") {  // the child of a death test names its case itself
    std::string filter;
    for (const std::string& source : sources) {
      const std::string cases = filter_of(source, wants_long);
      if (cases.empty() && !wants_long) return refuse(source, "");
      filter += cases;
    }
    if (filter.empty()) return refuse(sources[0], "long ");
    testing::GTEST_FLAG(filter) = filter;
  }
  const int result = RUN_ALL_TESTS();
  return result == 0 && testing::UnitTest::GetInstance()->skipped_test_count() > 0 ? kSkipped : result;
}
