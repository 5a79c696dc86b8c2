#include "learner/losses/loss_terms.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/csrc/autograd/autograd.h>

#include "learner/step/terms_report.h"
#include "policy_workers/device/torch_ops.h"

namespace comrad::learn {
namespace loss_terms_test {

/// The terms of one half of a minibatch of four samples, of which the last does not count.
LossTerms half(const Tensor& parameter, int64_t first) {
  const Tensor x = torch::tensor({1.0f, -2.0f, 4.0f, 100.0f}).narrow(0, first, 2).view({1, 2});
  const Tensor counts = torch::tensor({true, true, true, false}).narrow(0, first, 2).view({1, 2});
  const Tensor weight = counts.to(torch::kFloat32) / 3;
  LossTerms terms;
  terms.add("square", (parameter * x * x * weight).sum());
  terms.add("line", (2 * parameter * x * weight).sum());
  terms.mean("mean", x, weight);
  terms.max("most", x, counts, -1e30);
  terms.min("least", x, counts, 1e30);
  return terms;
}

TermValues together(const Tensor& parameter) {
  TermValues values(half(parameter, 0).names());
  for (const int64_t first : {0, 2}) {
    const Tensor numbers = half(parameter, first).numbers().to(torch::kFloat64);
    values.join(numbers.data_ptr<double>());
  }
  return values;
}

TEST(LossTerms, AddUpOverMicroBatchesToTheNumbersOfTheMinibatch) {
  const TermValues values = together(torch::ones({}));
  EXPECT_NEAR(values["square"], 21.0 / 3, 1e-6);
  EXPECT_NEAR(values["line"], 2 * 3.0 / 3, 1e-6);
  EXPECT_NEAR(values.loss(), 21.0 / 3 + 2, 1e-6) << "what is only shown is no part of it";
  EXPECT_NEAR(values["mean"], 1, 1e-6);
  EXPECT_EQ(values["most"], 4);
  EXPECT_EQ(values["least"], -2);
  EXPECT_EQ(values["never said"], 0);
}

TEST(LossTerms, TheLossHasTheGradientOfItsSharesAndNumbersHaveNone) {
  const Tensor parameter = torch::ones({}).requires_grad_();
  const LossTerms terms = half(parameter, 0);
  EXPECT_FALSE(terms.numbers().requires_grad());
  const Tensor gradient = torch::autograd::grad({terms.loss()}, {parameter})[0];
  EXPECT_NEAR(gradient.item<double>(), (5.0 + 2 * -1.0) / 3, 1e-6);
}

TEST(TermValues, AreAddedInProportionAndExtremesAreMerged) {
  const TermValues one = together(torch::ones({})), two = together(2 * torch::ones({}));
  TermValues both;
  both.add(one, 0.5);
  both.add(two, 0.5);
  EXPECT_NEAR(both["square"], 1.5 * 7, 1e-6);
  EXPECT_NEAR(both.loss(), 1.5 * 9, 1e-6);
  EXPECT_EQ(both["most"], 4);
  EXPECT_EQ(both["least"], -2);
  both.set("first", 3);
  NamedNumbers values;
  append_terms(both, values);
  EXPECT_THAT(values.back(), ::testing::Pair("train/first", 3));
  EXPECT_EQ(values.front().first, "train/square");
}

}  // namespace loss_terms_test
}  // namespace comrad::learn
