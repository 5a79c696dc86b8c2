// The device of tests that can run on a GPU. COMRAD_TEST_DEVICE names it (deploy/gpu/check.sh: cuda); without it, the CPU.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>

#include "policy_workers/device/choose_device.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/actor_critic.h"

namespace comrad::test {

inline torch::Device test_device() {
  const char* word = std::getenv("COMRAD_TEST_DEVICE");
  const auto device = policy::choose_device(word == nullptr ? "cpu" : word);
  EXPECT_TRUE(device) << (device ? "" : device.error().message);
  return device ? *device : torch::Device(torch::kCPU);
}

/// While one lives, a GPU multiplies f32 numbers in full, so that it differs from a CPU by rounding alone.
class FullPrecision {
 public:
  FullPrecision()
      : convolutions_(at::globalContext().allowTF32CuDNN()),
        products_(at::globalContext().allowTF32CuBLAS()) {
    set(false, false);
  }
  ~FullPrecision() { set(convolutions_, products_); }
  FullPrecision(const FullPrecision&) = delete;
  FullPrecision& operator=(const FullPrecision&) = delete;

 private:
  static void set(bool convolutions, bool products) {
    at::globalContext().setAllowTF32CuDNN(convolutions);
    at::globalContext().setAllowTF32CuBLAS(products);
  }
  const bool convolutions_, products_;
};

}  // namespace comrad::test
