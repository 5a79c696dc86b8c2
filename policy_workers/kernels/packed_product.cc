#include "policy_workers/kernels/packed_product.h"

#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/kernels/packed_kernel.h"
#include "policy_workers/kernels/weight_cache.h"
#include "rollout_buffer/core/check.h"

namespace comrad::policy {
namespace {

using torch::Tensor;

/// A BLAS is as fast with more rows, and has its own threads.
constexpr int64_t kMostRows = 128;
constexpr int64_t kFewestWeights = 32 * 32;

const kernels::PanelMath* math_of(Precision precision) {
  return precision == Precision::kFp32 ? kernels::f32_panels() : kernels::bf16_panels();
}

uint32_t* units_of(const Tensor& tensor) { return reinterpret_cast<uint32_t*>(tensor.data_ptr<int32_t>()); }

Tensor panels_of(const Tensor& weight, WeightSide side, Precision precision) {
  thread_local WeightCache caches[2][2];
  WeightCache& cache = caches[side == WeightSide::kPlain][precision == Precision::kBf16];
  return cache.get(weight, [&](const Tensor& detached) {
    const Tensor dense = detached.contiguous();
    const Tensor matrix = side == WeightSide::kTransposed ? dense.t() : dense;
    const kernels::MatrixView view{.values = matrix.data_ptr<float>(),
                                   .row_count = matrix.size(0),
                                   .column_count = matrix.size(1),
                                   .row_stride = matrix.stride(0),
                                   .column_stride = matrix.stride(1)};
    const kernels::PanelMath& math = *math_of(precision);
    const Tensor panels = torch::empty({kernels::panel_units(math, view)}, torch::kInt32);
    kernels::make_panels(math, view, units_of(panels));
    return panels;
  });
}

}  // namespace

bool packs(const Tensor& x, const Tensor& weight, Precision precision) {
  return device::has_own_kernels(x.device()) && x.dim() == 2 && x.scalar_type() == torch::kFloat32 &&
         weight.scalar_type() == torch::kFloat32 && x.size(0) <= kMostRows &&
         weight.numel() >= kFewestWeights && math_of(precision) != nullptr && at::get_num_threads() == 1;
}

void packed_product_out(Tensor& out, const Tensor& base, const Tensor& x, const Tensor& weight,
                        WeightSide side, Precision precision) {
  torch::NoGradGuard no_grad;
  COMRAD_CHECK(packs(x, weight, precision) && out.is_contiguous(), "these tensors are multiplied otherwise");
  const kernels::PanelMath& math = *math_of(precision);
  const Tensor dense = x.contiguous();
  const int64_t row_count = x.size(0), units = kernels::row_units(math, x.size(1));
  const bool rounds = precision == Precision::kBf16;
  const Tensor rows = rounds ? torch::empty({row_count, units}, torch::kInt32) : dense.view(torch::kInt32);
  if (rounds) kernels::round_rows(dense.data_ptr<float>(), row_count, x.size(1), units_of(rows));
  if (rounds)
    out.zero_();
  else
    out.copy_(base);  // one row is repeated
  kernels::add_product(math, units_of(rows), row_count, units, units_of(panels_of(weight, side, precision)),
                       out.size(1), out.data_ptr<float>());
  if (!rounds) return;
  kernels::round_to_bf16(out.data_ptr<float>(), out.numel());
  out.add_(base);
}

}  // namespace comrad::policy
