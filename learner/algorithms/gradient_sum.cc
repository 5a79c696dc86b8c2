#include "learner/algorithms/gradient_sum.h"

#include "policy_workers/device/operator_path.h"
#include "policy_workers/policy/kernels.h"
#include "policy_workers/policy/torch_ops.h"

namespace comrad::learn {
namespace {

/// 64 KB: a sum stays in the second-level cache while all terms are added.
constexpr int64_t kElementsOfAPiece = 1 << 14;

/// A stretch of one parameter's gradient and what is added to it.
struct Piece {
  float* sum;
  std::size_t first_term, term_count;
  int64_t begin, count;
};

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
  std::vector<const float*> terms;  // of each parameter that has pieces, one after the other
  std::vector<Piece> pieces;
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
    if (!is_dense_float(sum) || !std::ranges::all_of(added, is_dense_float)) {
      for (const torch::Tensor& gradient : added) sum.add_(gradient);
      continue;
    }
    for (int64_t begin = 0; begin < sum.numel(); begin += kElementsOfAPiece)
      pieces.push_back({.sum = sum.data_ptr<float>(),
                        .first_term = terms.size(),
                        .term_count = added.size(),
                        .begin = begin,
                        .count = std::min(kElementsOfAPiece, sum.numel() - begin)});
    for (const torch::Tensor& gradient : added) terms.push_back(gradient.data_ptr<float>());
    sum.unsafeGetTensorImpl()->bump_version();
  }
  at::parallel_for(0, static_cast<int64_t>(pieces.size()), 1, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      const Piece& piece = pieces[static_cast<std::size_t>(i)];
      for (const float* term : std::span(terms).subspan(piece.first_term, piece.term_count))
        policy::kernels::add(term + piece.begin, piece.count, piece.sum + piece.begin);
    }
  });
}

}  // namespace comrad::learn
