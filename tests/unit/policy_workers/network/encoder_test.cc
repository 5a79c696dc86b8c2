#include "policy_workers/network/encoder.h"

#include <gtest/gtest.h>

#include <cmath>

#include "policy_workers/device/cpu_tuning.h"
#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/queue.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/kernels/elementwise.h"
#include "policy_workers/kernels/precision.h"
#include "tests/unit/policy_workers/network/made_encoder.h"

namespace comrad::policy {
namespace encoder_test {

at::Generator generator(uint64_t seed) { return at::make_generator<at::CPUGeneratorImpl>(seed); }

void expect_near(const Tensor& tensor, std::vector<double> expected, double tolerance) {
  const Tensor flat = tensor.to(torch::kFloat64).flatten();
  ASSERT_EQ(flat.numel(), static_cast<int64_t>(expected.size()));
  for (size_t index = 0; index < expected.size(); ++index)
    EXPECT_NEAR(flat[static_cast<int64_t>(index)].item<double>(), expected[index], tolerance)
        << "entry " << index;
}

TEST(InputNormalizer, MatchesTheKnownAnswer) {
  for (const torch::ScalarType dtype : {torch::kFloat32, torch::kUInt8}) {
    InputNormalizer normalizer = InputNormalizer::create(1, 1.0, true, torch::kCPU);
    const Tensor batch = torch::tensor({1, 2, 4, 7}, dtype).view({4, 1});
    normalizer.update(batch);
    const NamedTensors buffers = normalizer.named_buffers("n");
    ASSERT_EQ(buffers.size(), 3u);
    EXPECT_NEAR(buffers[0].second.item<double>(), 2.8, 1e-12);
    EXPECT_NEAR(buffers[1].second.item<double>(), 7.76, 1e-12);
    EXPECT_EQ(buffers[2].second.item<double>(), 5.0);
    expect_near(normalizer.normalize(batch), {-0.646162, -0.287183, 0.430775, 1.507711}, 1e-6);
  }
}

// On a device statistics come from integers, as on a CPU, and pixels are rounded where they are normalised.
TEST(InputNormalizer, OperatorsGiveWhatTheKernelsGive) {
  constexpr int64_t kElements = 300;
  InputNormalizer kernels = InputNormalizer::create(kElements, 255.0, true, torch::kCPU),
                  operators = InputNormalizer::create(kElements, 255.0, true, torch::kCPU);
  for (const int64_t rows : {1, 7, 1100}) {  // the last in three slices
    const Tensor history = torch::randint(0, 256, {rows, kElements}, torch::kUInt8);
    history.slice(1, 0, 10).fill_(255);
    kernels.update(history);
    const device::OperatorPath as_on_a_device;
    operators.update(history);
  }
  for (size_t i = 0; i < 3; ++i)
    EXPECT_TRUE(torch::equal(kernels.named_buffers("n")[i].second, operators.named_buffers("n")[i].second))
        << i;
  const Tensor rows = torch::randint(0, 256, {9, kElements}, torch::kUInt8);
  const Tensor expected = kernels.normalize(rows);
  const device::OperatorPath as_on_a_device;
  const Tensor normal = operators.normalize(rows);
  EXPECT_LT((normal - expected).abs().max().item<double>(), 2e-6);
  const Tensor rounded = operators.normalize(rows, torch::kBFloat16);
  EXPECT_EQ(rounded.scalar_type(), torch::kBFloat16);
  EXPECT_TRUE(torch::equal(rounded, normal.to(torch::kBFloat16)));
}

TEST(InputNormalizer, FusedNormalisationEqualsThePlainFormula) {
  constexpr int64_t kElements = 2500;  // no multiple of the kernel's tile
  InputNormalizer normalizer = InputNormalizer::create(kElements, 255.0, true, torch::kCPU);
  Tensor history = torch::randint(0, 256, {40, kElements}, torch::kUInt8);
  history.slice(1, 0, 100).fill_(17);  // elements that never change have hardly any variance: the clip acts
  for (int update = 0; update < 50; ++update) normalizer.update(history);
  const NamedTensors buffers = normalizer.named_buffers("n");
  const Tensor rows = torch::randint(0, 256, {9, kElements}, torch::kUInt8);
  const Tensor plain =
      ((rows.to(torch::kFloat64) / 255 - buffers[0].second) / (buffers[1].second + 1e-5).sqrt()).clamp(-5, 5);
  const Tensor fused = normalizer.normalize(rows);
  EXPECT_LT((fused - plain).abs().max().item<double>(), 2e-5);
  EXPECT_EQ(fused.max().item<float>(), 5.0f);
  std::vector<const uint8_t*> pointers;
  for (int64_t row = 8; row >= 0; --row) pointers.push_back(rows[row].data_ptr<uint8_t>());
  Tensor scattered = torch::empty({9, kElements});
  normalizer.normalize_rows(pointers, scattered.data_ptr<float>());
  EXPECT_TRUE(torch::equal(scattered.flip(0), fused));
}

TEST(InputNormalizer, BytesAndFloatsGiveTheSameStatistics) {
  InputNormalizer bytes = InputNormalizer::create(1500, 255.0, true, torch::kCPU);
  InputNormalizer floats = InputNormalizer::create(1500, 255.0, true, torch::kCPU);
  for (const int64_t rows : {1, 7, 300}) {
    const Tensor batch = torch::randint(0, 256, {rows, 1500}, torch::kUInt8);
    bytes.update(batch);
    floats.update(batch.to(torch::kFloat32));
  }
  for (size_t buffer = 0; buffer < 3; ++buffer)
    EXPECT_TRUE(torch::allclose(bytes.named_buffers("n")[buffer].second,
                                floats.named_buffers("n")[buffer].second, 1e-12, 1e-12));
}

TEST(InputNormalizer, TwoBatchesMergeLikeTheParallelVarianceFormula) {
  InputNormalizer normalizer = InputNormalizer::create(1, 1.0, true, torch::kCPU);
  double mean = 0, variance = 1, count = 1;
  for (const std::vector<double>& batch : {std::vector<double>{3, -1, 4}, std::vector<double>{1, 5}}) {
    normalizer.update(torch::tensor(batch).view({-1, 1}).to(torch::kFloat32));
    double batch_mean = 0, spread = 0;
    const double n = static_cast<double>(batch.size());
    for (double x : batch) batch_mean += x / n;
    for (double x : batch) spread += (x - batch_mean) * (x - batch_mean);
    const double delta = batch_mean - mean, total = count + n;
    variance = (variance * count + spread / (n - 1) * n + delta * delta * count * n / total) / total;
    mean += delta * n / total;
    count = total;
  }
  EXPECT_NEAR(normalizer.named_buffers("n")[0].second.item<double>(), mean, 1e-12);
  EXPECT_NEAR(normalizer.named_buffers("n")[1].second.item<double>(), variance, 1e-12);
  EXPECT_EQ(normalizer.named_buffers("n")[2].second.item<double>(), 6.0);
}

TEST(InputNormalizer, AnEmptyBatchChangesNothingAndOneRowStaysFinite) {
  InputNormalizer normalizer = InputNormalizer::create(4, 255.0, true, torch::kCPU);
  normalizer.update(torch::empty({0, 4}, torch::kUInt8));
  EXPECT_EQ(normalizer.named_buffers("n")[2].second.item<double>(), 1.0);
  normalizer.update(torch::full({1, 4}, 200, torch::kUInt8));
  EXPECT_TRUE(torch::isfinite(normalizer.normalize(torch::zeros({1, 4}, torch::kUInt8))).all().item<bool>());
}

TEST(InputNormalizer, SwitchedOffItOnlyScales) {
  InputNormalizer normalizer = InputNormalizer::create(3, 255.0, false, torch::kCPU);
  normalizer.update(torch::full({5, 3}, 99, torch::kUInt8));
  expect_near(normalizer.normalize(torch::tensor({{0, 51, 255}}, torch::kUInt8)), {0.0, 0.2, 1.0}, 1e-7);
  EXPECT_TRUE(normalizer.named_buffers("n").empty());
}

TEST(Kernels, SumsOfBytesAreExactPast32Bits) {
  // 70 000 rows of 255: the squares pass 2^32.
  const std::vector<uint8_t> rows(70'000, 255);
  double sum = 0, square_sum = 0;
  kernels::sum_bytes(rows.data(), 70'000, 1, 0, 1, &sum, &square_sum);
  EXPECT_EQ(sum, 70'000.0 * 255);
  EXPECT_EQ(square_sum, 70'000.0 * 255 * 255);
}

TEST(Orthogonal, RowsOrColumnsAreOrthonormalTimesGain) {
  for (const std::vector<int64_t>& sizes : {std::vector<int64_t>{5, 12}, {12, 5}, {8, 3, 2, 2}}) {
    const Tensor weight = orthogonal(sizes, 1.5, generator(3));
    Tensor matrix = weight.view({sizes[0], -1});
    if (matrix.size(0) > matrix.size(1)) matrix = matrix.t();
    const Tensor product = matrix.mm(matrix.t());
    EXPECT_LT((product - 2.25 * torch::eye(product.size(0))).abs().max().item<double>(), 1e-5);
  }
  EXPECT_TRUE(torch::equal(orthogonal({6, 4}, 1.0, generator(3)), orthogonal({6, 4}, 1.0, generator(3))));
  EXPECT_FALSE(torch::equal(orthogonal({6, 4}, 1.0, generator(3)), orthogonal({6, 4}, 1.0, generator(4))));
  const int before = at::get_num_threads();
  device::set_math_threads(1);
  const Tensor alone = orthogonal({1536, 512}, 1.0, generator(3));
  device::set_math_threads(2);
  EXPECT_TRUE(torch::equal(orthogonal({1536, 512}, 1.0, generator(3)), alone));
  EXPECT_EQ(at::get_num_threads(), 2);
  device::set_math_threads(before);
}

TEST(Encoder, HasTheParameterCountOfTheSpecification) {
  torch::NoGradGuard no_grad;
  const std::shared_ptr<const Encoder> encoder = made_encoder().encoder;
  int64_t count = 0;
  for (auto& [name, parameter] : encoder->named_parameters()) count += parameter.numel();
  EXPECT_EQ(count, 1'293'024);
  EXPECT_EQ(encoder->feature_count(), 512);
}

TEST(Encoder, EqualsTheLayersWrittenOut) {
  torch::NoGradGuard no_grad;
  const std::shared_ptr<const Encoder> encoder = made_encoder().encoder;
  const Tensor frame = torch::randint(0, 256, {3, 3, 72, 128}, torch::kUInt8);
  std::vector<Tensor> p;
  for (auto& [name, parameter] : encoder->named_parameters()) p.push_back(parameter.to(torch::kFloat64));
  // Fresh statistics: mean 0, var 1.
  Tensor x = (frame.to(torch::kFloat64) / 255 / std::sqrt(1 + 1e-5)).clamp(-5, 5);
  const int64_t strides[] = {4, 2, 2}, heights[] = {17, 7, 3}, widths[] = {31, 14, 6};
  for (size_t layer = 0; layer < 3; ++layer) {
    x = at::elu(at::conv2d(x, p[2 * layer], p[2 * layer + 1], strides[layer]));
    EXPECT_EQ(x.size(2), heights[layer]);
    EXPECT_EQ(x.size(3), widths[layer]);
  }
  x = at::elu(at::linear(x.flatten(1), p[6], p[7]));
  EXPECT_LT((encoder->forward(frame, {}) - x).abs().max().item<double>(), 1e-5);
}

TEST(Encoder, HasTheGradientsOfTheLayersWrittenOut) {
  // 70 rows: more than one chunk of the CPU path. The reference is autograd in double precision.
  EnvShape env;
  env.height = 40;
  env.width = 44;
  torch::manual_seed(1);
  const MadeEncoder made = made_encoder(env);
  const std::shared_ptr<const Encoder> encoder = made.encoder;
  const Tensor frame = torch::randint(0, 256, {70, 3, 40, 44}, torch::kUInt8),
               weights = torch::randn({70, 512});
  made.update_statistics(frame, {});
  const NamedTensors buffers = made.normalizer->named_buffers();
  const Tensor flat = frame.flatten(1).to(torch::kFloat64) / 255;
  Tensor x =
      ((flat - buffers[0].second) / (buffers[1].second + 1e-5).sqrt()).clamp(-5, 5).view({70, 3, 40, 44});
  std::vector<Tensor> p;
  for (auto& [name, parameter] : encoder->named_parameters())
    p.push_back(parameter.detach().to(torch::kFloat64).requires_grad_());
  const int64_t strides[] = {4, 2, 2};
  for (size_t layer = 0; layer < 3; ++layer)
    x = at::elu(at::conv2d(x, p[2 * layer], p[2 * layer + 1], strides[layer]));
  x = at::elu(at::linear(x.flatten(1), p[6], p[7]));
  (x * weights).sum().backward();
  const Tensor features = encoder->forward(frame, {});
  made.update_statistics(frame.slice(0, 0, 5), {});  // what comes between must not reach the graph
  (features * weights).sum().backward();
  EXPECT_LT((features - x).abs().max().item<double>(), 1e-5);
  for (size_t index = 0; index < p.size(); ++index) {
    const auto [name, parameter] = encoder->named_parameters()[index];
    EXPECT_LT((parameter.grad() - p[index].grad()).abs().max().item<double>(),
              1e-5 * p[index].grad().abs().max().item<double>())
        << name;
  }
}

TEST(Kernels, TheGradientThroughEluFollowsFromItsResult) {
  const Tensor y = at::elu(torch::randn({20'000}) * 3), gradient = torch::full({20'000}, 2.0f);
  kernels::elu_backward(y.data_ptr<float>(), gradient.data_ptr<float>(), y.numel());
  EXPECT_TRUE(torch::equal(gradient, torch::where(y > 0, torch::full_like(y, 2.0f), 2 * (y + 1))));
}

uint16_t* bits_of(const Tensor& x) { return reinterpret_cast<uint16_t*>(x.data_ptr<at::BFloat16>()); }

TEST(Kernels, Bf16LoopsAreTheF32LoopsRoundedOnce) {
  constexpr int64_t kRows = 3, kElements = 1100;
  torch::manual_seed(4);
  const Tensor bytes = torch::randint(0, 256, {kRows, kElements}, torch::kUInt8);
  const Tensor factor = torch::rand({kElements}), offset = torch::randn({kElements}) * 5;
  std::vector<const uint8_t*> rows;
  for (int64_t row = 0; row < kRows; ++row) rows.push_back(bytes[row].data_ptr<uint8_t>());
  const Tensor wide = torch::empty({kRows, kElements}),
               narrow = torch::empty({kRows, kElements}, torch::kBFloat16);
  kernels::normalize_bytes(rows, kElements, factor.data_ptr<float>(), offset.data_ptr<float>(), 5,
                           wide.data_ptr<float>());
  kernels::normalize_bytes_bf16(rows, kElements, factor.data_ptr<float>(), offset.data_ptr<float>(), 5,
                                bits_of(narrow));
  EXPECT_TRUE(torch::equal(narrow, wide.to(torch::kBFloat16)));

  const Tensor gradient = torch::randn({kRows, kElements}).to(torch::kBFloat16);
  const Tensor y = at::elu(torch::randn({kRows, kElements}) * 3).to(torch::kBFloat16).to(torch::kFloat32);
  Tensor expected = gradient.to(torch::kFloat32).contiguous();
  kernels::elu_backward(y.data_ptr<float>(), expected.data_ptr<float>(), expected.numel());
  const Tensor through = gradient.clone(), y_bits = y.to(torch::kBFloat16);
  kernels::elu_backward_bf16(bits_of(y_bits), bits_of(through), through.numel());
  EXPECT_TRUE(torch::equal(through, expected.to(torch::kBFloat16)));
}

TEST(Precision, AWeightIsRoundedOnceAVersion) {
  torch::Tensor weight = torch::full({4, 4}, 1.0f).requires_grad_();
  EXPECT_TRUE(weight_factor(weight, Precision::kBf16).requires_grad())
      << "autograd follows the weight itself";
  torch::NoGradGuard no_grad;
  const Tensor first = weight_factor(weight, Precision::kBf16);
  EXPECT_EQ(weight_factor(weight, Precision::kBf16).data_ptr(), first.data_ptr());
  weight.mul_(3);
  EXPECT_EQ(weight_factor(weight, Precision::kBf16)[0][0].item<float>(), 3);
  weight.data_ptr<float>()[0] = 5;  // past torch's operators
  weight.unsafeGetTensorImpl()->bump_version();
  EXPECT_EQ(weight_factor(weight, Precision::kBf16)[0][0].item<float>(), 5);
  EXPECT_EQ(first[0][0].item<float>(), 1) << "holders of the older one keep it";
}

TEST(Precision, ARecordedPassRoundsItsWeightsEachTime) {
  const torch::Tensor weight = torch::full({4, 4}, 1.0f);
  const Tensor before = weight_factor(weight, Precision::kBf16);
  std::vector<Tensor> made;
  device::Graph graph;
  ASSERT_TRUE(graph.record(torch::kCPU, [&] { made.push_back(weight_factor(weight, Precision::kBf16)); }));
  for (int replay = 0; replay < 2; ++replay) graph.replay();
  ASSERT_EQ(made.size(), 2u);
  EXPECT_NE(made[0].data_ptr(), before.data_ptr()) << "a GPU's replay would read the old rounding for ever";
  EXPECT_NE(made[0].data_ptr(), made[1].data_ptr());
  EXPECT_EQ(weight_factor(weight, Precision::kBf16).data_ptr(), before.data_ptr()) << "kept outside of it";
}

TEST(Encoder, MeasurementsAddTheirOwnBranch) {
  EnvShape env;
  env.measurement_count = 6;
  torch::NoGradGuard no_grad;
  const MadeEncoder made = made_encoder(env);
  const std::shared_ptr<const Encoder> encoder = made.encoder;
  EXPECT_EQ(encoder->feature_count(), 640);
  const Tensor frame = torch::randint(0, 256, {3, 3, 72, 128}, torch::kUInt8),
               measurement = torch::randn({3, 6});
  made.update_statistics(frame, measurement);
  EXPECT_EQ(made.normalizer->named_buffers().size(), 6u);
  const Tensor features = encoder->forward(frame, measurement);
  ASSERT_EQ(features.size(1), 640);
  Tensor moved = measurement.clone();
  moved[1][2] += 1.0f;
  const Tensor after = encoder->forward(frame, moved);
  EXPECT_TRUE(torch::equal(after.slice(1, 0, 512), features.slice(1, 0, 512)));
  EXPECT_FALSE(torch::equal(after[1].slice(0, 512), features[1].slice(0, 512)));
  EXPECT_TRUE(torch::equal(after[0], features[0]));
}

}  // namespace encoder_test
}  // namespace comrad::policy
