// On a CPU a device's queues do their work at once; on a GPU (COMRAD_TEST_DEVICE) they keep the order of the calls.
#include "policy_workers/device/queue.h"

#include <gtest/gtest.h>
#include <torch/csrc/autograd/autograd.h>

#include <atomic>
#include <optional>
#include <thread>

#include "policy_workers/device/readback.h"
#include "policy_workers/device/torch_ops.h"
#include "tests/support/test_device.h"

namespace comrad::device {
namespace queue_test {

TEST(Queue, OfACpuHasDoneWhatItWasGiven) {
  const Stream work = Stream::current(torch::kCPU), copies = Stream::beside(torch::kCPU);
  Event done;
  EXPECT_TRUE(done.is_done());
  Tensor numbers = torch::zeros({3});
  {
    const StreamScope scope(copies);
    numbers.add_(1);
    done.record(copies);
  }
  EXPECT_TRUE(done.is_done());
  work.wait_for(done);
  done.wait();
  EXPECT_EQ(numbers.sum().item<float>(), 3);
  EXPECT_FALSE(host_memory({2}, torch::kFloat32, torch::kCPU).is_pinned());
  EXPECT_EQ(memory_of(torch::kCPU).total_bytes, 0);
}

TEST(Queue, WaitsForWhatAnotherQueueDid) {
  const torch::Device device = test::test_device();
  const Tensor factors = torch::full({1024, 1024}, 0.5, torch::TensorOptions().device(device));
  Tensor product = torch::ones({1024, 1024}, torch::TensorOptions().device(device));
  const Stream work = Stream::current(device), copies = Stream::beside(device);
  Event made, multiplied;
  made.record(work);
  copies.wait_for(made);
  {
    const StreamScope scope(copies);
    for (int i = 0; i < 20; ++i)
      product.copy_(torch::mm(product, factors) / 512);  // each leaves it as it was
    product.mul_(3);
    multiplied.record(copies);
  }
  work.wait_for(multiplied);
  const Tensor arrived = host_memory({1024, 1024}, torch::kFloat32, device);
  EXPECT_EQ(arrived.is_pinned(), device.is_cuda());
  arrived.copy_(product, /*non_blocking=*/true);
  multiplied.record(work);
  multiplied.wait();
  EXPECT_TRUE(multiplied.is_done());
  EXPECT_EQ(arrived.min().item<float>(), 3);
  EXPECT_EQ(arrived.max().item<float>(), 3);
  EXPECT_EQ(memory_of(device).total_bytes > 0, device.is_cuda());
  EXPECT_GE(gpu_count(), device.is_cuda() ? 1 : 0);
}

TEST(Graph, DoesItsWorkOnReplay) {
  const auto options = torch::TensorOptions().device(test::test_device());
  Tensor from = torch::zeros({}, options), to = torch::zeros({}, options);
  Graph graph;
  ASSERT_TRUE(graph.record(options.device(), [&] { to.copy_(from + 1); }));
  if (options.device().is_cpu()) {
    EXPECT_EQ(to.item<float>(), 0) << "nothing is done before the first replay";
  }
  for (const float value : {2.0f, 5.0f}) {
    from.fill_(value);
    graph.replay();
    EXPECT_EQ(to.item<float>(), value + 1);
  }
}

TEST(Graph, GivesWorkThatMattersOnceAReplay) {
  const auto options = torch::TensorOptions().device(test::test_device());
  Tensor sum = torch::zeros({3}, options), made;
  const Tensor added = torch::ones({3}, options);
  Graph graph;
  graph.record_at_second_replay(options.device(), [&] {
    sum.add_(added);
    made = sum * 2;
  });
  for (int replay = 1; replay <= 4; ++replay) {
    added.fill_(replay);
    graph.replay();
    EXPECT_EQ(sum[0].item<float>(), replay * (replay + 1) / 2);
    EXPECT_EQ(made[2].item<float>(), replay * (replay + 1));
    EXPECT_EQ(graph.is_recorded(), options.device().is_cuda() && replay >= 2);
  }
}

TEST(Graph, RecordsWorkOfAutogradWhileOtherThreadsAllocate) {
  const auto options = torch::TensorOptions().device(test::test_device());
  const Tensor weight = torch::full({8, 8}, 0.5, options).requires_grad_(),
               input = torch::ones({4, 8}, options);
  Tensor gradient;
  Graph graph;
  graph.record_at_second_replay(options.device(), [&] {
    const Tensor loss = input.mm(weight).square().sum();
    gradient = torch::autograd::grad({loss}, {weight}).front();
  });
  std::atomic<bool> stop = false;
  std::thread other([&] {
    for (int64_t size = 1; !stop; size = size % 1000 + 1)
      (void)host_memory({size * 1000}, torch::kUInt8, options.device());
  });
  for (int replay = 1; replay <= 3; ++replay) {
    input.fill_(replay);
    graph.replay();
    // d/dW sum((x W)^2) = 2 x^T x W: 4 rows of 8 equal inputs and weights of 0.5.
    EXPECT_EQ(gradient[3][5].item<float>(), 2 * 4 * 8 * 0.5f * static_cast<float>(replay * replay));
  }
  stop = true;
  other.join();
  EXPECT_EQ(graph.is_recorded(), options.device().is_cuda());
}

TEST(Graph, ThatCannotBeRecordedDoesItsWorkAllTheSame) {
  const auto options = torch::TensorOptions().device(test::test_device());
  Tensor sum = torch::zeros({}, options);
  Graph graph;
  graph.record_at_second_replay(options.device(), [&] {
    sum.add_(1);
    if (sum.item<float>() < 0) sum.zero_();  // the host waits, which no recording can
  });
  for (int replay = 1; replay <= 3; ++replay) graph.replay();
  EXPECT_EQ(sum.item<float>(), 3);
  EXPECT_FALSE(graph.is_recorded());
}

TEST(Readback, BringsWhatWasComputedBeforeIt) {
  const torch::Device device = test::test_device();
  Tensor numbers = torch::arange(3, torch::TensorOptions(torch::kFloat64).device(device));
  Readback read(numbers * 2);
  numbers.zero_();
  read.wait();
  ASSERT_TRUE(read.is_ready());
  EXPECT_EQ(read.values()[2], 4);
}

TEST(Readback, IsThereAtOnceOnACpuUnlessATestDelaysIt) {
  const int64_t before = host_waits();
  const Tensor numbers = torch::arange(3, torch::kFloat64);
  Readback at_once(numbers);
  ASSERT_TRUE(at_once.is_ready());
  EXPECT_EQ(at_once.values()[2], 2);
  EXPECT_EQ(host_waits(), before);
  const SlowReadbacks slow;
  Readback late(numbers);
  EXPECT_FALSE(late.is_ready());
  EXPECT_DEATH(late.values(), "once they are there");
  late.wait();
  EXPECT_EQ(late.values()[1], 1);
  EXPECT_EQ(host_waits(), before + 1);
}

}  // namespace queue_test
}  // namespace comrad::device
