#include "policy_workers/kernels/packed_kernel.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "policy_workers/kernels/vectorised.h"
#include "rollout_buffer/core/bfloat16.h"

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define COMRAD_HAS_PANELS 1
#include <immintrin.h>
#endif

namespace comrad::policy::kernels {

/// Some rows of x with one panel, which is two vectors wide: what is read of x serves two multiply-adds. Sums stay in registers.
using PanelLoop = void (*)(const uint32_t* rows, int64_t units, const uint32_t* panel, float* out,
                           int64_t out_stride);

struct PanelMath {
  int64_t columns;          ///< of a panel
  int64_t numbers_of_unit;  ///< 1: f32, 2: bfloat16
  struct Loop {
    int64_t rows;
    PanelLoop run;
  };
  std::array<Loop, 3> loops;  ///< the one with most rows first, the last one with one
};

namespace {

constexpr int64_t kMostColumns = 32, kMostRows = 8;

#ifdef COMRAD_HAS_PANELS
template <int kFloats>
using Vector [[gnu::vector_size(kFloats * sizeof(float)), gnu::aligned(alignof(float)), gnu::may_alias]] =
    float;

template <int kFloats, int kRows>
[[gnu::always_inline]] inline void multiply_f32(const uint32_t* rows, int64_t units, const uint32_t* panel,
                                                float* out, int64_t out_stride) {
  using Lanes = Vector<kFloats>;
  Lanes left[kRows], right[kRows];
  for (int row = 0; row < kRows; ++row) {
    left[row] = *reinterpret_cast<const Lanes*>(out + row * out_stride);
    right[row] = *reinterpret_cast<const Lanes*>(out + row * out_stride + kFloats);
  }
  for (int64_t k = 0; k < units; ++k) {
    const Lanes left_factor = *reinterpret_cast<const Lanes*>(panel + k * 2 * kFloats);
    const Lanes right_factor = *reinterpret_cast<const Lanes*>(panel + k * 2 * kFloats + kFloats);
    for (int row = 0; row < kRows; ++row) {
      const float x = std::bit_cast<float>(rows[row * units + k]);
      left[row] += left_factor * x;
      right[row] += right_factor * x;
    }
  }
  for (int row = 0; row < kRows; ++row) {
    *reinterpret_cast<Lanes*>(out + row * out_stride) = left[row];
    *reinterpret_cast<Lanes*>(out + row * out_stride + kFloats) = right[row];
  }
}

template <int kRows>
[[gnu::target("avx512f,fma"), gnu::optimize("O3")]] void avx512_f32(const uint32_t* rows, int64_t units,
                                                                    const uint32_t* panel, float* out,
                                                                    int64_t out_stride) {
  multiply_f32<16, kRows>(rows, units, panel, out, out_stride);
}

template <int kRows>
[[gnu::target("avx2,fma"), gnu::optimize("O3")]] void avx2_f32(const uint32_t* rows, int64_t units,
                                                               const uint32_t* panel, float* out,
                                                               int64_t out_stride) {
  multiply_f32<8, kRows>(rows, units, panel, out, out_stride);
}

template <int kRows>
[[gnu::target("avx512f,avx512bf16"), gnu::optimize("O3")]] void avx512_bf16(const uint32_t* rows,
                                                                            int64_t units,
                                                                            const uint32_t* panel, float* out,
                                                                            int64_t out_stride) {
  constexpr int kFloats = 16;
  __m512 left[kRows], right[kRows];
  for (int row = 0; row < kRows; ++row) {
    left[row] = _mm512_loadu_ps(out + row * out_stride);
    right[row] = _mm512_loadu_ps(out + row * out_stride + kFloats);
  }
  for (int64_t k = 0; k < units; ++k) {
    const auto left_factor = reinterpret_cast<__m512bh>(_mm512_loadu_si512(panel + k * 2 * kFloats));
    const auto right_factor =
        reinterpret_cast<__m512bh>(_mm512_loadu_si512(panel + k * 2 * kFloats + kFloats));
    for (int row = 0; row < kRows; ++row) {
      const auto x = reinterpret_cast<__m512bh>(_mm512_set1_epi32(static_cast<int>(rows[row * units + k])));
      left[row] = _mm512_dpbf16_ps(left[row], left_factor, x);
      right[row] = _mm512_dpbf16_ps(right[row], right_factor, x);
    }
  }
  for (int row = 0; row < kRows; ++row) {
    _mm512_storeu_ps(out + row * out_stride, left[row]);
    _mm512_storeu_ps(out + row * out_stride + kFloats, right[row]);
  }
}

constexpr PanelMath kAvx512F32 = {32, 1, {{{8, avx512_f32<8>}, {2, avx512_f32<2>}, {1, avx512_f32<1>}}}};
constexpr PanelMath kAvx2F32 = {16, 1, {{{4, avx2_f32<4>}, {2, avx2_f32<2>}, {1, avx2_f32<1>}}}};
constexpr PanelMath kAvx512Bf16 = {32, 2, {{{8, avx512_bf16<8>}, {2, avx512_bf16<2>}, {1, avx512_bf16<1>}}}};
#endif

[[gnu::always_inline]] inline uint32_t pair_of(float first, float second) {
  return rounded(first) | static_cast<uint32_t>(rounded(second)) << 16;
}

COMRAD_VECTORISED void pair_neighbours(const float* __restrict numbers, int64_t pairs,
                                       uint32_t* __restrict units) {
  for (int64_t k = 0; k < pairs; ++k) units[k] = pair_of(numbers[2 * k], numbers[2 * k + 1]);
}

COMRAD_VECTORISED void pair_rows(const float* __restrict upper, const float* __restrict lower, int64_t pairs,
                                 uint32_t* __restrict units) {
  for (int64_t k = 0; k < pairs; ++k) units[k] = pair_of(upper[k], lower[k]);
}

/// Of a matrix whose columns lie without gaps.
void panel_of_columns(const PanelMath& math, const float* values, int64_t row_count, int64_t columns,
                      int64_t column_stride, uint32_t* panel) {
  constexpr int64_t kUnits = 64;
  uint32_t units[kMostColumns][kUnits];  // stays in the first-level cache
  for (int64_t row = 0; row < row_count; row += kUnits * math.numbers_of_unit) {
    const int64_t rows = std::min(kUnits * math.numbers_of_unit, row_count - row);
    for (int64_t column = 0; column < columns; ++column) {
      const float* const numbers = values + column * column_stride + row;
      if (math.numbers_of_unit == 2)
        round_rows(numbers, 1, rows, units[column]);
      else
        std::memcpy(units[column], numbers, static_cast<size_t>(rows) * sizeof(float));
    }
    for (int64_t unit = 0; unit < row_units(math, rows); ++unit, panel += math.columns)
      for (int64_t column = 0; column < columns; ++column) panel[column] = units[column][unit];
  }
}

/// Of a matrix whose rows lie without gaps.
void panel_of_rows(const PanelMath& math, const float* values, int64_t row_count, int64_t columns,
                   int64_t row_stride, uint32_t* panel) {
  constexpr float kZeros[kMostColumns] = {};
  for (int64_t row = 0; row < row_count; row += math.numbers_of_unit, panel += math.columns) {
    const float* const upper = values + row * row_stride;
    if (math.numbers_of_unit == 2)
      pair_rows(upper, row + 1 < row_count ? upper + row_stride : kZeros, columns, panel);
    else
      std::memcpy(panel, upper, static_cast<size_t>(columns) * sizeof(float));
  }
}

}  // namespace

const PanelMath* f32_panels(int fused_floats) {
#ifdef COMRAD_HAS_PANELS
  return fused_floats == 16 ? &kAvx512F32 : fused_floats == 8 ? &kAvx2F32 : nullptr;
#else
  (void)fused_floats;
  return nullptr;
#endif
}

const PanelMath* bf16_panels() {
#ifdef COMRAD_HAS_PANELS
  static const PanelMath* const math =
      cpu_multiplies_bf16() && !cpu_features().has_amx ? &kAvx512Bf16 : nullptr;
  return math;
#else
  return nullptr;
#endif
}

int64_t row_units(const PanelMath& math, int64_t number_count) {
  return (number_count + math.numbers_of_unit - 1) / math.numbers_of_unit;
}

int64_t panel_units(const PanelMath& math, const MatrixView& matrix) {
  return (matrix.column_count + math.columns - 1) / math.columns * math.columns *
         row_units(math, matrix.row_count);
}

void make_panels(const PanelMath& math, const MatrixView& matrix, uint32_t* panels) {
  const int64_t panel_size = row_units(math, matrix.row_count) * math.columns;
  for (int64_t first = 0; first < matrix.column_count; first += math.columns, panels += panel_size) {
    const int64_t columns = std::min(math.columns, matrix.column_count - first);
    const float* const values = matrix.values + first * matrix.column_stride;
    if (columns < math.columns) std::fill_n(panels, panel_size, 0u);
    if (matrix.row_stride == 1)
      panel_of_columns(math, values, matrix.row_count, columns, matrix.column_stride, panels);
    else
      panel_of_rows(math, values, matrix.row_count, columns, matrix.row_stride, panels);
  }
}

void round_rows(const float* x, int64_t row_count, int64_t number_count, uint32_t* rows) {
  for (int64_t row = 0; row < row_count; ++row, x += number_count) {
    pair_neighbours(x, number_count / 2, rows);
    rows += number_count / 2;
    if (number_count % 2 == 1) *rows++ = pair_of(x[number_count - 1], 0.0f);
  }
}

void add_product(const PanelMath& math, const uint32_t* rows, int64_t row_count, int64_t units,
                 const uint32_t* panels, int64_t column_count, float* out) {
  for (int64_t first = 0; first < column_count; first += math.columns, panels += units * math.columns) {
    const int64_t columns = std::min(math.columns, column_count - first);
    int64_t row = 0;
    for (const PanelMath::Loop& loop : math.loops)
      for (; row + loop.rows <= row_count; row += loop.rows) {
        float* const into = out + row * column_count + first;
        if (columns == math.columns) {
          loop.run(rows + row * units, units, panels, into, column_count);
          continue;
        }
        // The matrix ends within the panel.
        float whole[kMostRows * kMostColumns] = {};
        const auto bytes = static_cast<size_t>(columns) * sizeof(float);
        for (int64_t i = 0; i < loop.rows; ++i)
          std::memcpy(whole + i * math.columns, into + i * column_count, bytes);
        loop.run(rows + row * units, units, panels, whole, math.columns);
        for (int64_t i = 0; i < loop.rows; ++i)
          std::memcpy(into + i * column_count, whole + i * math.columns, bytes);
      }
  }
}

void round_to_bf16(float* values, int64_t count) {
  for (int64_t k = 0; k < count; ++k) values[k] = widened(rounded(values[k]));
}

}  // namespace comrad::policy::kernels
