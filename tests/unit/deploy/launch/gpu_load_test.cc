#include "deploy/launch/gpu_load.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>

#include "tests/support/patience.h"
#include "tests/support/scratch_folder.h"

namespace comrad::deploy {
namespace gpu_load_test {

/// A program in the driver's place, which prints `lines` and then waits to be killed.
std::string driver_that_prints(const test::ScratchFolder& folder, const std::string& lines) {
  const std::string path = folder / "nvidia-smi", printed = folder / "printed";
  std::ofstream(path) << "#!/bin/sh\n[ \"$1\" = --query-gpu=index,utilization.gpu ] || exit 1\nprintf '"
                      << lines << "'\n: >'" << printed << "'\nexec sleep 1000\n";
  chmod(path.c_str(), 0700);
  return path;
}

std::optional<double> busy_of(const std::string& lines) {
  const test::ScratchFolder folder;
  GpuLoad load(driver_that_prints(folder, lines));
  EXPECT_TRUE(test::wait_until([&] { return access((folder / "printed").c_str(), F_OK) == 0; }));
  return load.busy();
}

TEST(GpuLoad, IsTheMeanOfTheBusiestGpu) {
  EXPECT_DOUBLE_EQ(*busy_of("0, 40\\n1, 90\\n0, 60\\n1, 100\\n"), 0.95);
  EXPECT_DOUBLE_EQ(*busy_of("0, 0\\n"), 0);
}

TEST(GpuLoad, IsUnknownWithoutReports) {
  EXPECT_EQ(busy_of(""), std::nullopt);
  EXPECT_EQ(busy_of("No devices were found\\n0, [N/A]\\n0, 101\\n, 5\\n0, -3\\n"), std::nullopt);
  EXPECT_EQ(GpuLoad("comrad-has-no-such-program").busy(), std::nullopt);
}

}  // namespace gpu_load_test
}  // namespace comrad::deploy
