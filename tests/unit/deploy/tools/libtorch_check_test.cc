#include "deploy/tools/libtorch_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace comrad::deploy {
namespace libtorch_check_test {

using ::testing::AllOf;
using ::testing::HasSubstr;

LibtorchSeen with_cuda(const std::string& cuda) {
  LibtorchSeen seen;
  seen.version = "2.14.1";
  seen.library = "/venv/libtorch_cpu.so";
  seen.cuda = cuda;
  return seen;
}

TEST(LibtorchCheck, FindsTheDriverInBothOfNvidiasLines) {
  EXPECT_EQ(driver_version_in(
                "NVRM version: NVIDIA UNIX x86_64 Kernel Module  535.183.01  Sun May 12 2024\nGCC 12.2.0"),
            "535.183.01");
  EXPECT_EQ(
      driver_version_in("NVRM version: NVIDIA UNIX Open Kernel Module for x86_64  580.65.06  Release Build"),
      "580.65.06");
  for (const char* none : {"", "\n", "NVRM version:", "NVRM version: .. 4", "x.5 v1.2"})
    EXPECT_EQ(driver_version_in(none), "") << none;
}

TEST(LibtorchCheck, ReadsWhatAPolicyWorkerPrints) {
  const auto seen = parse_libtorch(
      R"({"weights_bytes": 1, "libtorch": {"version": "2.14.1", "library": "/l.so", "cuda": "13.0", "cudnn": 92400,
          "has_nccl": true, "error": "", "devices": [{"name": "NVIDIA H100", "memory_bytes": 85000000000, "capability": "9.0"}]}})");
  ASSERT_TRUE(seen) << seen.error().message;
  EXPECT_EQ(judge_libtorch(*seen).found, "2.14.1 with CUDA 13.0, cuDNN 9.24, NCCL: /l.so");
  EXPECT_EQ(judge_cuda(*seen, "580.65.06", nullptr).found,
            "driver 580.65.06, NVIDIA H100 (85 GB, compute 9.0); --device auto and cuda use the first");
  for (const char* bad :
       {"", "{}", "[]", R"({"libtorch": 1})", R"({"libtorch": {"version": 2}})",
        R"({"libtorch": {"version": "2", "library": "", "cuda": "", "cudnn": 0, "has_nccl": 1, "error": "",
                              "devices": []}})",
        R"({"libtorch": {"version": "2", "library": "", "cuda": "", "cudnn": 0, "has_nccl": true,
                              "error": "", "devices": [{"name": "x"}]}})"})
    EXPECT_FALSE(parse_libtorch(bad)) << bad;
}

TEST(LibtorchCheck, ReportsWhatIsWrongBetweenDriverAndLibtorch) {
  EXPECT_EQ(judge_cuda(with_cuda(""), "", nullptr).level, CheckLevel::kOk);
  const CheckResult no_driver = judge_cuda(with_cuda("13.0"), "", nullptr);
  EXPECT_EQ(no_driver.level, CheckLevel::kOk);
  EXPECT_THAT(no_driver.found, HasSubstr("there is no NVIDIA driver"));

  const CheckResult no_cuda = judge_cuda(with_cuda(""), "580.65.06", nullptr);
  EXPECT_EQ(no_cuda.level, CheckLevel::kWarn);
  EXPECT_THAT(no_cuda.action, HasSubstr("COMRAD_TORCH=pip"));

  const CheckResult old_driver = judge_cuda(with_cuda("13.0"), "570.133.20", nullptr);
  EXPECT_EQ(old_driver.level, CheckLevel::kWarn);
  EXPECT_THAT(old_driver.found, HasSubstr("570.133.20 is too old for the CUDA 13.0"));
  EXPECT_THAT(old_driver.action, AllOf(HasSubstr("580"), HasSubstr("COMRAD_TORCH=FOLDER")));
  EXPECT_THAT(judge_cuda(with_cuda("12.8"), "570.133.20", nullptr).found, HasSubstr("no GPU is seen"))
      << "not too old for that one";

  LibtorchSeen blind = with_cuda("13.0");
  blind.error = "no CUDA-capable device is detected";
  const CheckResult hidden = judge_cuda(blind, "580.65.06", "7");
  EXPECT_EQ(hidden.level, CheckLevel::kWarn);
  EXPECT_THAT(hidden.found, HasSubstr("no CUDA-capable device"));
  EXPECT_THAT(hidden.action, HasSubstr("CUDA_VISIBLE_DEVICES is '7'"));
  EXPECT_THAT(judge_cuda(blind, "580.65.06", nullptr).action, HasSubstr("nvidia-smi"));
}

}  // namespace libtorch_check_test
}  // namespace comrad::deploy
