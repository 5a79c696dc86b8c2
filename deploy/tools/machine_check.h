// What `comrad doctor` looks at, one function per subject. Each one finds out by trying where it can (a
// message is sent, a frame is rendered) rather than by reading version numbers.
#pragma once

#include <string>
#include <vector>

namespace comrad::deploy {

enum class CheckLevel { kOk, kWarn, kFail };

struct CheckResult {
  std::string name;
  CheckLevel level = CheckLevel::kOk;
  std::string found;   ///< what was seen
  std::string action;  ///< what to do; empty when nothing
};

/// Debian packages of deploy/packages.txt; without libtorch-dev where the build has another PyTorch.
CheckResult check_packages();
/// What `comrad plot` needs: Debian packages of deploy/packages_report.txt. Never kFail.
CheckResult check_report_packages();
/// What the tests alone need: Debian packages of deploy/packages_test.txt, and packages of deploy/requirements_test.txt in the
/// Python that the tests ask (COMRAD_TEST_PYTHON, the build folder's test-python, python3). Never kFail.
CheckResult check_test_packages();
CheckResult check_test_python();
CheckResult check_iwad();
CheckResult check_blas();
/// Memory that is free against what a default run takes.
CheckResult check_memory();
CheckResult check_disk();
/// /proc/sys and resource limits that runs have met: open files, receive buffers, overcommit, memfd.
std::vector<CheckResult> check_limits();
/// Two participants of one made-up link pass a message over the loopback interface. Never kFail: runs of one host do
/// without.
CheckResult check_dds();
/// A simulator renders for a second.
CheckResult check_rendering();
/// A policy worker runs its network for a second.
CheckResult check_inference();
/// Two lines: which libtorch this is, and whether it and the NVIDIA driver fit (libtorch_check.h).
std::vector<CheckResult> check_libtorch();

}  // namespace comrad::deploy
