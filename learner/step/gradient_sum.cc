#include "learner/step/gradient_sum.h"

#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/share_out.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/kernels/elementwise.h"

namespace comrad::learn {
namespace {

/// 64 KB: a sum stays in the second-level cache while all terms are added.
constexpr int64_t kElementsAtATime = 1 << 14;

bool is_dense_float(const torch::Tensor& tensor) {
  return device::has_own_kernels(tensor.device()) && tensor.scalar_type() == torch::kFloat32 &&
         tensor.is_contiguous();
}

}  // namespace

int64_t gradients_held(const std::vector<torch::Tensor>& parameters, int threads) {
  if (!parameters.empty() && !device::has_own_kernels(parameters.front().device())) return 1;
  return std::max(threads, 16);
}

void add_gradients(const std::vector<torch::Tensor>& parameters,
                   std::span<const std::vector<torch::Tensor>* const> gradients) {
  const torch::NoGradGuard no_grad;
  std::vector<torch::Tensor> sums;
  std::vector<std::vector<torch::Tensor>> terms;  // of each sum, in order
  for (std::size_t p = 0; p < parameters.size(); ++p) {
    torch::Tensor& sum = parameters[p].mutable_grad();
    std::vector<torch::Tensor> added;
    for (const std::vector<torch::Tensor>* of_part : gradients) {
      const torch::Tensor& gradient = (*of_part)[p];
      if (!gradient.defined()) continue;
      if (sum.defined())
        added.push_back(gradient);
      else
        sum = gradient.clone();
    }
    if (added.empty()) continue;
    if (is_dense_float(sum) && std::ranges::all_of(added, is_dense_float)) {
      sums.push_back(sum);
      terms.push_back(std::move(added));
    } else {
      for (const torch::Tensor& gradient : added) sum.add_(gradient);
    }
  }
  const std::vector<device::Piece> pieces = device::pieces_of(sums);
  device::share_out(pieces.size(), [&](std::size_t i) {
    const device::Piece& piece = pieces[i];
    float* const to = sums[piece.tensor].data_ptr<float>();
    for (int64_t begin = piece.begin; begin < piece.end; begin += kElementsAtATime)
      for (const torch::Tensor& term : terms[piece.tensor])
        policy::kernels::add(term.data_ptr<float>() + begin, std::min(kElementsAtATime, piece.end - begin),
                             to + begin);
  });
  for (const torch::Tensor& sum : sums) sum.unsafeGetTensorImpl()->bump_version();
}

}  // namespace comrad::learn
