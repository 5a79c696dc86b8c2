// main() of every GoogleTest program. Exit codes: 0 all passed, 1 something failed, 77 nothing failed and
// something was skipped. 77 is ctest's SKIP_RETURN_CODE; a pattern of the output in its place would call a
// failed program skipped.
#include <gtest/gtest.h>

int main(int argc, char** argv) {
  constexpr int kSkipped = 77;
  testing::InitGoogleTest(&argc, argv);
  const int result = RUN_ALL_TESTS();
  return result == 0 && testing::UnitTest::GetInstance()->skipped_test_count() > 0 ? kSkipped : result;
}
