#include "policy_workers/device/share_out.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <stdexcept>
#include <thread>

#include "policy_workers/device/cpu_tuning.h"
#include "policy_workers/device/part_pool.h"
#include "policy_workers/device/torch_ops.h"
#include "tests/support/patience.h"

namespace comrad::device {
namespace share_out_test {

class ShareOut : public ::testing::Test {
 protected:
  ShareOut() { set_math_threads(2); }
  ~ShareOut() override { set_math_threads(before_); }

 private:
  int before_ = at::get_num_threads();
};

/// Whether the first of two pieces sees the second one begin before it gives up.
bool two_at_once(double patience_s) {
  std::atomic<int> begun = 0;
  std::atomic<int> met = 0;
  share_out(2, [&](std::size_t) {
    const bool is_first = ++begun == 1;
    if (test::wait_until([&] { return begun == 2; }, patience_s) && is_first) ++met;
  });
  return met == 1;
}

TEST_F(ShareOut, DoesEveryPieceOnce) {
  for (const std::size_t pieces : {0u, 1u, 2u, 17u}) {
    std::vector<std::atomic<int>> times(pieces);
    share_out(pieces, [&](std::size_t piece) { ++times[piece]; });
    for (const auto& count : times) EXPECT_EQ(count, 1);
  }
}

TEST_F(ShareOut, TwoThreadsWorkAtTheSameTime) { EXPECT_TRUE(two_at_once(test::kPatienceSeconds)); }

TEST_F(ShareOut, APartOfAPoolKeepsToItsThread) {
  PartPool pool(2);
  std::atomic<int> shared = 0;
  (void)pool.run(
      2,
      [&](int64_t) {
        if (two_at_once(0.05)) ++shared;
      },
      nullptr);
  EXPECT_EQ(shared, 0);
}

TEST_F(ShareOut, AFailureIsThrownAgain) {
  EXPECT_THROW(share_out(100,
                         [](std::size_t piece) {
                           if (piece == 5) throw std::runtime_error("piece 5");
                         }),
               std::runtime_error);
}

TEST(PiecesOf, CoverEveryElementInOrder) {
  const std::vector<torch::Tensor> tensors = {torch::zeros({3, 5}), torch::zeros({0}), torch::zeros({}),
                                              torch::zeros({1000, 200})};
  std::vector<int64_t> covered(tensors.size());
  std::size_t last = 0;
  for (const Piece& piece : pieces_of(tensors)) {
    EXPECT_GE(piece.tensor, last);
    last = piece.tensor;
    EXPECT_EQ(piece.begin, covered[piece.tensor]);
    EXPECT_GT(piece.size(), 0);
    covered[piece.tensor] = piece.end;
  }
  for (std::size_t i = 0; i < tensors.size(); ++i) EXPECT_EQ(covered[i], tensors[i].numel());
  EXPECT_GT(pieces_of(tensors).size(), 4u) << "what is large is cut";
}

}  // namespace share_out_test
}  // namespace comrad::device
