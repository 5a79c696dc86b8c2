// The few elementwise loops where torch has no fused operator or a slow one (its ELU takes 1 ns an
// element). Plain C++ that the compiler vectorises, built for AVX2 and for any x86-64 (the loader picks);
// no torch in here.
#pragma once

#include <cstdint>
#include <span>

namespace comrad::policy::kernels {

/// out[row][k] = clamp(rows[row][k] * factor[k] + offset[k], -clip, clip) for k < element_count.
void normalize_bytes(std::span<const uint8_t* const> rows, int64_t element_count, const float* factor,
                     const float* offset, float clip, float* out);

/// Sums and sums of squares of every column of bytes [row_count, element_count]; exact.
void sum_bytes(const uint8_t* rows, int64_t row_count, int64_t element_count, double* sum,
               double* square_sum);

/// ELU in place: y = x > 0 ? x : exp(x) - 1, to within 2e-7.
void elu(float* values, int64_t count);

/// Gradient through ELU in place, from its result y: grad *= y > 0 ? 1 : y + 1.
void elu_backward(const float* y, float* grad, int64_t count);

/// Sum of squares in double, in an order that depends on `count` alone.
double sum_of_squares(const float* values, int64_t count);

/// One step of Adam; the learner's adam_optimizer.h says what the numbers are.
struct AdamStep {
  float gradient_scale, beta1, beta2, one_less_beta1, one_less_beta2, step_size, root_scale, epsilon;
};
void adam_step(const AdamStep& step, int64_t count, const float* gradient, float* mean, float* square,
               float* parameter);

}  // namespace comrad::policy::kernels
