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

/// Sums and sums of squares of columns [first, last) of bytes [row_count, element_count]; exact.
void sum_bytes(const uint8_t* rows, int64_t row_count, int64_t element_count, int64_t first, int64_t last,
               double* sum, double* square_sum);

/// ELU in place: y = x > 0 ? x : exp(x) - 1, to within 2e-7.
void elu(float* values, int64_t count);

/// Gradient through ELU in place, from its result y: grad *= y > 0 ? 1 : y + 1.
void elu_backward(const float* y, float* grad, int64_t count);

// The same with bfloat16 numbers (as their 16 bits) on one side or both, computed in f32 and rounded to the nearest even
// once, at the end: factors of the next product are made where its input is made.

/// As normalize_bytes().
void normalize_bytes_bf16(std::span<const uint8_t* const> rows, int64_t element_count, const float* factor,
                          const float* offset, float clip, uint16_t* out);

/// In place: y = ELU(x + bias[channel]) of maps [row_count, channel_count, plane].
void bias_elu_bf16(uint16_t* maps, int64_t row_count, int64_t channel_count, int64_t plane,
                   const float* bias);

/// As elu_backward().
void elu_backward_bf16(const uint16_t* y, uint16_t* grad, int64_t count);

/// sum[k] += values[k].
void add(const float* values, int64_t count, float* sum);

/// Sum of squares in double, in an order that depends on `count` alone.
double sum_of_squares(const float* values, int64_t count);

/// One step of Adam; the learner's adam_optimizer.h says what the numbers are.
struct AdamStep {
  float gradient_scale, beta1, beta2, one_less_beta1, one_less_beta2, step_size, root_scale, epsilon;
};
void adam_step(const AdamStep& step, int64_t count, const float* gradient, float* mean, float* square,
               float* parameter);

}  // namespace comrad::policy::kernels
