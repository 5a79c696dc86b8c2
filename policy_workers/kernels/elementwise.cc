#include "policy_workers/kernels/elementwise.h"

#include <algorithm>
#include <cstring>

#include "policy_workers/kernels/vectorised.h"
#include "rollout_buffer/core/bfloat16.h"

namespace comrad::policy::kernels {
namespace {

/// Columns that are worked on together: their factors and offsets stay in the first-level cache over
/// all rows.
constexpr int64_t kTileColumns = 1024;

COMRAD_VECTORISED void normalize_tile(const uint8_t* __restrict in, int64_t count,
                                      const float* __restrict factor, const float* __restrict offset,
                                      float clip, float* __restrict out) {
  for (int64_t k = 0; k < count; ++k) {
    float y = static_cast<float>(in[k]) * factor[k] + offset[k];
    y = y < -clip ? -clip : y;
    out[k] = y > clip ? clip : y;
  }
}

COMRAD_VECTORISED void elu_backward_loop(const float* __restrict y, float* __restrict grad, int64_t count) {
  for (int64_t k = 0; k < count; ++k) {
    const float slope = y[k] > 0.0f ? 1.0f : y[k] + 1.0f;
    grad[k] *= slope;
  }
}

COMRAD_VECTORISED void normalize_tile_bf16(const uint8_t* __restrict in, int64_t count,
                                           const float* __restrict factor, const float* __restrict offset,
                                           float clip, uint16_t* __restrict out) {
  for (int64_t k = 0; k < count; ++k) {
    float y = static_cast<float>(in[k]) * factor[k] + offset[k];
    y = y < -clip ? -clip : y;
    y = y > clip ? clip : y;
    out[k] = rounded(y);
  }
}

COMRAD_VECTORISED void elu_backward_loop_bf16(const uint16_t* __restrict y, uint16_t* __restrict grad,
                                              int64_t count) {
  for (int64_t k = 0; k < count; ++k) {
    const float value = widened(y[k]);
    const float slope = value > 0.0f ? 1.0f : value + 1.0f;
    grad[k] = rounded(widened(grad[k]) * slope);
  }
}

COMRAD_VECTORISED void add_row(const uint8_t* __restrict in, int64_t count, uint32_t* __restrict sum,
                               uint32_t* __restrict square_sum) {
  for (int64_t k = 0; k < count; ++k) {
    const uint32_t byte = in[k];
    sum[k] += byte;
    square_sum[k] += byte * byte;
  }
}

COMRAD_VECTORISED void add_loop(const float* __restrict values, int64_t count, float* __restrict sum) {
  for (int64_t k = 0; k < count; ++k) sum[k] += values[k];
}

constexpr int64_t kLanes = 16;

COMRAD_VECTORISED void add_squares(const float* __restrict values, int64_t count, double* __restrict lanes) {
  double sum[kLanes] = {};
  for (int64_t k = 0; k + kLanes <= count; k += kLanes)
    for (int64_t lane = 0; lane < kLanes; ++lane) {
      const double value = values[k + lane];
      sum[lane] += value * value;
    }
  for (int64_t lane = 0; lane < kLanes; ++lane) lanes[lane] = sum[lane];
}

COMRAD_VECTORISED void adam_loop(const AdamStep step, int64_t count, const float* __restrict gradient,
                                 float* __restrict mean, float* __restrict square,
                                 float* __restrict parameter) {
  for (int64_t k = 0; k < count; ++k) {
    const float g = gradient[k] * step.gradient_scale;
    mean[k] = step.beta1 * mean[k] + step.one_less_beta1 * g;
    square[k] = step.beta2 * square[k] + step.one_less_beta2 * g * g;
    parameter[k] -= step.step_size * mean[k] / (__builtin_sqrtf(square[k]) * step.root_scale + step.epsilon);
  }
}

}  // namespace

void normalize_bytes(std::span<const uint8_t* const> rows, int64_t element_count, const float* factor,
                     const float* offset, float clip, float* out) {
  for (int64_t first = 0; first < element_count; first += kTileColumns) {
    const int64_t count = std::min(kTileColumns, element_count - first);
    for (size_t row = 0; row < rows.size(); ++row)
      normalize_tile(rows[row] + first, count, factor + first, offset + first, clip,
                     out + static_cast<int64_t>(row) * element_count + first);
  }
}

void normalize_bytes_bf16(std::span<const uint8_t* const> rows, int64_t element_count, const float* factor,
                          const float* offset, float clip, uint16_t* out) {
  for (int64_t first = 0; first < element_count; first += kTileColumns) {
    const int64_t count = std::min(kTileColumns, element_count - first);
    for (size_t row = 0; row < rows.size(); ++row)
      normalize_tile_bf16(rows[row] + first, count, factor + first, offset + first, clip,
                          out + static_cast<int64_t>(row) * element_count + first);
  }
}

void elu_backward_bf16(const uint16_t* y, uint16_t* grad, int64_t count) {
  elu_backward_loop_bf16(y, grad, count);
}

void gather_patches(const uint8_t* planes, int64_t channels, int64_t height, int64_t width,
                    int64_t patch_rows, int64_t patch_columns, uint8_t* out) {
  for (int64_t channel = 0; channel < channels; ++channel, planes += height * width)
    for (int64_t row = 0; row < patch_rows; ++row, out += patch_columns * kPatch * kPatch)
      for (int64_t line = 0; line < kPatch; ++line) {
        const uint8_t* in = planes + (row * kPatch + line) * width;
        uint8_t* to = out + line * kPatch;
        for (int64_t column = 0; column < patch_columns; ++column, in += kPatch, to += kPatch * kPatch)
          std::memcpy(to, in, kPatch);
      }
}

void sum_bytes(const uint8_t* rows, int64_t row_count, int64_t element_count, int64_t first, int64_t last,
               double* sum, double* square_sum) {
  constexpr int64_t kRowsPerPass = 60'000;  // 60 000 x 255^2 < 2^32
  uint32_t tile_sum[kTileColumns], tile_square_sum[kTileColumns];
  std::fill(sum + first, sum + last, 0.0);
  std::fill(square_sum + first, square_sum + last, 0.0);
  for (; first < last; first += kTileColumns) {
    const int64_t count = std::min(kTileColumns, last - first);
    for (int64_t pass = 0; pass < row_count; pass += kRowsPerPass) {
      std::memset(tile_sum, 0, sizeof(tile_sum));
      std::memset(tile_square_sum, 0, sizeof(tile_square_sum));
      for (int64_t row = pass; row < std::min(row_count, pass + kRowsPerPass); ++row)
        add_row(rows + row * element_count + first, count, tile_sum, tile_square_sum);
      for (int64_t k = 0; k < count; ++k) {
        sum[first + k] += tile_sum[k];
        square_sum[first + k] += tile_square_sum[k];
      }
    }
  }
}

void elu_backward(const float* y, float* grad, int64_t count) { elu_backward_loop(y, grad, count); }

void add(const float* values, int64_t count, float* sum) { add_loop(values, count, sum); }

double sum_of_squares(const float* values, int64_t count) {
  double lanes[kLanes], sum = 0;
  add_squares(values, count, lanes);
  for (const double lane : lanes) sum += lane;
  for (int64_t k = count / kLanes * kLanes; k < count; ++k) sum += double{values[k]} * double{values[k]};
  return sum;
}

void adam_step(const AdamStep& step, int64_t count, const float* gradient, float* mean, float* square,
               float* parameter) {
  adam_loop(step, count, gradient, mean, square, parameter);
}

}  // namespace comrad::policy::kernels
