// Products of few rows with a weight that serves many of them, on a CPU: a policy worker's batches, the steps of a recurrent
// core. A BLAS lays the whole weight out anew for each product, which takes as long as 16 rows of it; here that is done once a version.
#pragma once

#include <torch/types.h>

#include "rollout_buffer/settings/words.h"

namespace comrad::policy {

enum class WeightSide {
  kTransposed,  ///< x W^T, as a layer's output
  kPlain,       ///< x W, as the gradient of its input
};

/// Whether packed products are made of x [rows, numbers] here: f32 on a CPU that has the instructions, one thread, at most 128 rows, and
/// no weight so small that it does not matter.
bool packs(const torch::Tensor& x, const torch::Tensor& weight, Precision precision);

/// out = base + x W^T, or base + x W; of W [outputs, inputs] and x [rows, inputs or outputs]; `base` has out's shape or is one
/// row. With kBf16 the product is rounded before `base` is added, as one of torch's is. Records no gradient.
void packed_product_out(torch::Tensor& out, const torch::Tensor& base, const torch::Tensor& x,
                        const torch::Tensor& weight, WeightSide side, Precision precision);

}  // namespace comrad::policy
