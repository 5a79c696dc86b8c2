// The few elementwise loops where torch has no fused operator or a slow one. Plain C++ that the compiler vectorises, built
// for AVX2 and for any x86-64 (the loader picks); no torch in here.
#pragma once

#include <cstdint>
#include <span>

namespace comrad::policy::kernels {

/// out[row][k] = clamp(rows[row][k] * factor[k] + offset[k], -clip, clip) for k < element_count.
void normalize_bytes(std::span<const uint8_t* const> rows, int64_t element_count, const float* factor,
                     const float* offset, float clip, float* out);

/// The patches of kPatch x kPatch bytes of planes [channels, height, width] one after another: out [channels, patch_rows,
/// patch_columns, kPatch, kPatch]. What lies beyond them is left out.
constexpr int64_t kPatch = 4;
void gather_patches(const uint8_t* planes, int64_t channels, int64_t height, int64_t width,
                    int64_t patch_rows, int64_t patch_columns, uint8_t* out);

/// Sums and sums of squares of columns [first, last) of bytes [row_count, element_count]; exact.
void sum_bytes(const uint8_t* rows, int64_t row_count, int64_t element_count, int64_t first, int64_t last,
               double* sum, double* square_sum);

/// Gradient through ELU in place, from its result y: grad *= y > 0 ? 1 : y + 1.
void elu_backward(const float* y, float* grad, int64_t count);

// The same with bfloat16 numbers (as their 16 bits) on one side or both, computed in f32 and rounded to the nearest even
// once, at the end: factors of the next product are made where its input is made.

/// As normalize_bytes().
void normalize_bytes_bf16(std::span<const uint8_t* const> rows, int64_t element_count, const float* factor,
                          const float* offset, float clip, uint16_t* out);

/// As elu_backward().
void elu_backward_bf16(const uint16_t* y, uint16_t* grad, int64_t count);

/// sum[k] += values[k].
void add(const float* values, int64_t count, float* sum);

/// Sum of squares in double, in an order that depends on `count` alone.
double sum_of_squares(const float* values, int64_t count);

/// One step of Adam; the learner's adam_optimizer.h states what the numbers are.
struct AdamStep {
  float gradient_scale, beta1, beta2, one_less_beta1, one_less_beta2, step_size, root_scale, epsilon;
};
void adam_step(const AdamStep& step, int64_t count, const float* gradient, float* mean, float* square,
               float* parameter);

}  // namespace comrad::policy::kernels
