// On a CPU a device's queues do their work at once; what is the driver's alone is tested where there is one.
#include "policy_workers/device/queue.h"

#include <gtest/gtest.h>

#include <optional>

#include "policy_workers/device/readback.h"
#include "policy_workers/policy/torch_ops.h"

namespace comrad::device {
namespace {

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

TEST(Graph, DoesItsWorkOnReplayAndNotBefore) {
  Tensor from = torch::zeros({}), to = torch::zeros({});
  Graph graph;
  ASSERT_TRUE(graph.record(torch::kCPU, [&] { to.copy_(from + 1); }));
  EXPECT_EQ(to.item<float>(), 0);
  for (const float value : {2.0f, 5.0f}) {
    from.fill_(value);
    graph.replay();
    EXPECT_EQ(to.item<float>(), value + 1);
  }
}

TEST(Readback, IsThereAtOnceOnACpuUnlessATestWantsItLate) {
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

}  // namespace
}  // namespace comrad::device
