#include "deploy/tools/machine_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

#include "tests/support/scratch_folder.h"
#include "tests/support/test_python.h"

namespace comrad::deploy {
namespace machine_check_test {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

/// Lists of a made-up project, and a dpkg-query and a Python that know some of what they name.
class MachineCheck : public testing::Test {
 protected:
  void SetUp() override {
    keep("COMRAD_HOME", home_.string());
    keep("PATH", (home_ / "bin").string() + ":" + std::getenv("PATH"));
    keep("COMRAD_TEST_PYTHON", (home_ / "bin/python").string());
    tool("dpkg-query", "printf 'cmake installed\\nclang installed\\nzdbsp not-installed\\n'");
    tool("python", "shift 2; for one; do [ \"$one\" = numpy==1 ] || echo \"$one\"; done");
    home_.write("deploy/packages.txt", "# Tools\ncmake  program cmake  # builds\n");
    home_.write("deploy/packages_test.txt", "clang\n\n# nodes\nzdbsp\n");
    home_.write("deploy/requirements_test.txt", "numpy==1\ntorch==2  # big\n");
  }
  void TearDown() override {
    for (const auto& [name, value] : before_) value.empty() ? unsetenv(name) : setenv(name, value.c_str(), 1);
  }
  void keep(const char* name, const std::string& value) {
    const char* before = std::getenv(name);
    before_.emplace_back(name, before != nullptr ? before : "");
    setenv(name, value.c_str(), 1);
  }
  void tool(const std::string& name, const std::string& script) {
    std::filesystem::permissions(home_.write("bin/" + name, "#!/bin/sh\n" + script + "\n"),
                                 std::filesystem::perms::owner_all);
  }
  const test::ScratchFolder home_;
  std::vector<std::pair<const char*, std::string>> before_;
};

TEST_F(MachineCheck, NamesEachListAndWhatIsMissingOfIt) {
  const CheckResult packages = check_packages();
  EXPECT_EQ(packages.level, CheckLevel::kOk);
  EXPECT_EQ(packages.found, "deploy/packages.txt: all 1");

  const CheckResult tests = check_test_packages();
  EXPECT_EQ(tests.level, CheckLevel::kWarn);
  EXPECT_EQ(tests.found, "deploy/packages_test.txt, missing: zdbsp");
  EXPECT_EQ(tests.action, "./comrad test installs them: apt-get install --no-install-recommends zdbsp");

  home_.write("deploy/packages_report.txt", "zdbsp\n");
  EXPECT_EQ(check_report_packages().level, CheckLevel::kWarn);
  EXPECT_EQ(check_report_packages().action,
            "./comrad report installs them: apt-get install --no-install-recommends zdbsp");

  const CheckResult python = check_test_python();
  EXPECT_EQ(python.level, CheckLevel::kWarn);
  EXPECT_EQ(python.found,
            "deploy/requirements_test.txt, missing in " + (home_ / "bin/python").string() + ": torch==2");
  EXPECT_THAT(python.action, AllOf(HasSubstr("./comrad test"), HasSubstr("COMRAD_TEST_PYTHON")));

  home_.write("deploy/requirements_test.txt", "numpy==1\n");
  EXPECT_EQ(check_test_python().level, CheckLevel::kOk);
}

TEST_F(MachineCheck, RunsARealPythonForVersions) {
  if (!test::runs_well("python3 --version"))
    GTEST_SKIP() << "python3 is not installed (deploy/packages_test.txt)";
  setenv("COMRAD_TEST_PYTHON", "python3", 1);
  home_.write("deploy/requirements_test.txt", "no-such-package-anywhere==1\n");
  EXPECT_THAT(check_test_python().found, HasSubstr("missing in python3: no-such-package-anywhere==1"));
  setenv("COMRAD_TEST_PYTHON", "/no/such/python", 1);
  EXPECT_THAT(check_test_python().found, HasSubstr("/no/such/python"));
}

TEST_F(MachineCheck, AListThatIsNotThereIsAWarning) {
  std::filesystem::remove(home_ / "deploy/packages_test.txt");
  const CheckResult tests = check_test_packages();
  EXPECT_EQ(tests.level, CheckLevel::kWarn);
  EXPECT_THAT(tests.found, AllOf(HasSubstr("packages_test.txt"), Not(HasSubstr("missing"))));
  EXPECT_THAT(tests.action, HasSubstr("COMRAD_HOME"));
}

}  // namespace machine_check_test
}  // namespace comrad::deploy
