// Products of few rows with a matrix that lies in panels, as the inner loop reads it: the loop alone, without torch. Its numbers
// come in units of 32 bits: one float, or a pair of bfloat16 numbers of two successive rows of the matrix.
#pragma once

#include <cstdint>

#include "rollout_buffer/core/cpu_features.h"

namespace comrad::policy::kernels {

/// What a processor multiplies in panels, or nothing: f32 with AVX-512 or with AVX2 and FMA, bfloat16 with AVX-512 BF16 where there is
/// no AMX, which is left to a BLAS. `fused_floats` is this processor's, or fewer that it has, too.
struct PanelMath;
const PanelMath* f32_panels(int fused_floats = cpu_features().fused_floats);
const PanelMath* bf16_panels();

/// A matrix [row_count, column_count] of floats, whose rows or columns lie without gaps: one of the strides is 1.
struct MatrixView {
  const float* values;
  int64_t row_count, column_count;
  int64_t row_stride, column_stride;  ///< in floats
};

/// Units of a matrix in panels, and of one row of x [row_count, matrix.row_count]. Both are filled up with zeros.
int64_t panel_units(const PanelMath& math, const MatrixView& matrix);
int64_t row_units(const PanelMath& math, int64_t number_count);

void make_panels(const PanelMath& math, const MatrixView& matrix, uint32_t* panels);
/// Rows of x as factors of bf16_panels(), rounded to the nearest even. Of f32_panels() they are the floats themselves.
void round_rows(const float* x, int64_t row_count, int64_t number_count, uint32_t* rows);

/// out[row][c] += sum over k of x[row][k] * matrix[k][c], summed in the order of k with fused multiply-adds (of pairs with bfloat16): the same
/// bits for any number of rows, and of f32 on every processor. `out` [row_count, column_count] is dense.
void add_product(const PanelMath& math, const uint32_t* rows, int64_t row_count, int64_t units,
                 const uint32_t* panels, int64_t column_count, float* out);

/// Rounds floats to bfloat16 numbers in place.
void round_to_bf16(float* values, int64_t count);

}  // namespace comrad::policy::kernels
