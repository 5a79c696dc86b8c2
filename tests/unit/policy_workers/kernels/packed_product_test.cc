#include "policy_workers/kernels/packed_product.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/kernels/packed_kernel.h"

namespace comrad::policy {
namespace packed_product_test {

using torch::Tensor;

constexpr WeightSide kSides[] = {WeightSide::kTransposed, WeightSide::kPlain};

Tensor product(const Tensor& base, const Tensor& x, const Tensor& weight, WeightSide side,
               Precision precision) {
  Tensor out = torch::empty({x.size(0), weight.size(side == WeightSide::kTransposed ? 0 : 1)});
  packed_product_out(out, base, x, weight, side, precision);
  return out;
}

/// The largest distance from the definition (in double, of rounded factors with kBf16), as a share of what rounding may do.
double error(const Tensor& out, const Tensor& base, const Tensor& x, const Tensor& weight, WeightSide side,
             Precision precision) {
  const auto factor = [&](const Tensor& of) {
    return (precision == Precision::kBf16 ? of.to(torch::kBFloat16) : of).to(torch::kFloat64);
  };
  const Tensor exact = factor(x).matmul(factor(side == WeightSide::kTransposed ? weight.t() : weight));
  const Tensor distance = (out.to(torch::kFloat64) - base.to(torch::kFloat64) - exact).abs();
  const double last_bit = precision == Precision::kBf16 ? 1.0 / 256 : 0;
  return (distance / (exact.abs() * last_bit + 1e-4)).max().item<double>();
}

struct PackedProduct : ::testing::TestWithParam<Precision> {
  void SetUp() override {
    torch::manual_seed(1);
    if (!packs(torch::zeros({1, 64}), torch::zeros({64, 64}), GetParam()))
      GTEST_SKIP() << "this processor multiplies such numbers with a BLAS";
  }
};

TEST_P(PackedProduct, IsTheProductForAnyNumberOfRowsAndColumns) {
  // Whole panels, panels with an end, less than one panel, an odd number of factors.
  for (const auto& [outputs, inputs] : {std::pair{96, 64}, {70, 33}, {31, 47}}) {
    const Tensor weight = torch::randn({outputs, inputs});
    for (const int64_t rows : {1, 2, 3, 7, 8, 9, 21, 128}) {
      for (const WeightSide side : kSides) {
        const int64_t from = side == WeightSide::kTransposed ? inputs : outputs, to = outputs + inputs - from;
        const Tensor x = torch::randn({rows, from});
        ASSERT_TRUE(packs(x, weight, GetParam()));
        for (const Tensor& base : {torch::randn({rows, to}), torch::randn({to})})
          EXPECT_LT(error(product(base, x, weight, side, GetParam()), base, x, weight, side, GetParam()), 1)
              << outputs << " x " << inputs << ", " << rows << " rows";
      }
    }
  }
}

TEST_P(PackedProduct, IsNotMadeOfManyRowsSmallWeightsOrOtherNumbers) {
  const Tensor weight = torch::zeros({64, 64});
  EXPECT_FALSE(packs(torch::zeros({129, 64}), weight, GetParam()));
  EXPECT_FALSE(packs(torch::zeros({1, 5}), torch::zeros({3, 5}), GetParam()));
  EXPECT_FALSE(packs(torch::zeros({64}), weight, GetParam()));
  EXPECT_FALSE(packs(torch::zeros({1, 64}, torch::kFloat64), weight.to(torch::kFloat64), GetParam()));
}

TEST_P(PackedProduct, IsNotMadeOnAGpusPath) {
  const device::OperatorPath path;
  EXPECT_FALSE(packs(torch::zeros({1, 64}), torch::zeros({64, 64}), GetParam()));
}

TEST_P(PackedProduct, RowsDoNotDependOnTheRowsBesideThem) {
  const Tensor weight = torch::randn({70, 90}), bias = torch::randn({70}), x = torch::randn({21, 90});
  const Tensor all = product(bias, x, weight, WeightSide::kTransposed, GetParam());
  for (int64_t row = 0; row < x.size(0); ++row)
    EXPECT_TRUE(torch::equal(
        product(bias, x.narrow(0, row, 1), weight, WeightSide::kTransposed, GetParam())[0], all[row]));
}

TEST_P(PackedProduct, ReadsPartsOfTensors) {
  const Tensor weight = torch::randn({100, 2, 40}).select(1, 1), bias = torch::randn({100});
  const Tensor x = torch::randn({2, 40, 9})[1].t();
  for (const WeightSide side : kSides) {
    const Tensor rows = side == WeightSide::kTransposed ? x : torch::randn({100, 9}).t();
    const Tensor base = side == WeightSide::kTransposed ? bias : torch::zeros({40});
    EXPECT_LT(error(product(base, rows, weight, side, GetParam()), base, rows, weight, side, GetParam()), 1);
  }
}

TEST_P(PackedProduct, SeesEveryNewVersionOfAWeight) {
  Tensor weight = torch::randn({64, 64});
  const Tensor x = torch::randn({4, 64}), zero = torch::zeros({64});
  const auto largest_error = [&] {
    double largest = 0;
    for (const WeightSide side : kSides)
      largest = std::max(
          largest, error(product(zero, x, weight, side, GetParam()), zero, x, weight, side, GetParam()));
    return largest;
  };
  EXPECT_LT(largest_error(), 1);
  weight.copy_(torch::randn({64, 64}));  // as new weights come to a policy worker
  EXPECT_LT(largest_error(), 1);
  weight.data_ptr<float>()[0] += 100;  // as the learner's Adam writes them
  EXPECT_GT(largest_error(), 1) << "bump_version() was not called";
  weight.unsafeGetTensorImpl()->bump_version();
  EXPECT_LT(largest_error(), 1);
}

TEST(PackedKernel, GivesTheSameBitsWithAnyInstructions) {
  if (kernels::f32_panels() == nullptr) GTEST_SKIP() << "this processor multiplies with a BLAS";
  torch::manual_seed(2);
  const Tensor weight = torch::randn({90, 70}), x = torch::randn({13, 90});
  const kernels::MatrixView matrix{weight.data_ptr<float>(), 90, 70, 70, 1};
  // In the order of k, a fused multiply-add each.
  Tensor expected = torch::empty({13, 70});
  for (int64_t row = 0; row < 13; ++row)
    for (int64_t column = 0; column < 70; ++column) {
      float sum = 0;
      for (int64_t k = 0; k < 90; ++k)
        sum = std::fma(x[row][k].item<float>(), weight[k][column].item<float>(), sum);
      expected[row][column] = sum;
    }
  for (const int floats : {8, 16}) {
    if (floats > cpu_features().fused_floats) continue;
    const kernels::PanelMath& math = *kernels::f32_panels(floats);
    std::vector<uint32_t> panels(static_cast<std::size_t>(kernels::panel_units(math, matrix)));
    kernels::make_panels(math, matrix, panels.data());
    const Tensor out = torch::zeros({13, 70});
    kernels::add_product(math, reinterpret_cast<const uint32_t*>(x.data_ptr<float>()), 13,
                         kernels::row_units(math, 90), panels.data(), 70, out.data_ptr<float>());
    EXPECT_TRUE(torch::equal(out, expected)) << floats << " floats";
  }
}

INSTANTIATE_TEST_SUITE_P(Precisions, PackedProduct, ::testing::Values(Precision::kFp32, Precision::kBf16),
                         [](const auto& one) { return one.param == Precision::kFp32 ? "fp32" : "bf16"; });

}  // namespace packed_product_test
}  // namespace comrad::policy
