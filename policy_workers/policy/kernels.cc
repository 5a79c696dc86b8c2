#include "policy_workers/policy/kernels.h"

#include <algorithm>
#include <cstring>

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define COMRAD_VECTORISED __attribute__((target_clones("arch=haswell", "default"), optimize("O3")))
#else
#define COMRAD_VECTORISED
#endif

namespace comrad::policy::kernels {
namespace {

/// Columns that are worked on together: their factors and offsets stay in the first-level cache over all rows.
constexpr int64_t kTileColumns = 1024;

COMRAD_VECTORISED void normalize_tile(const uint8_t* __restrict in, int64_t count, const float* __restrict factor,
                                      const float* __restrict offset, float clip, float* __restrict out) {
  for (int64_t k = 0; k < count; ++k) {
    float y = static_cast<float>(in[k]) * factor[k] + offset[k];
    y = y < -clip ? -clip : y;
    out[k] = y > clip ? clip : y;
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

void sum_bytes(const uint8_t* rows, int64_t row_count, int64_t element_count, double* sum, double* square_sum) {
  constexpr int64_t kRowsPerPass = 60'000;  // 60 000 x 255^2 < 2^32
  uint32_t tile_sum[kTileColumns], tile_square_sum[kTileColumns];
  std::fill_n(sum, element_count, 0.0);
  std::fill_n(square_sum, element_count, 0.0);
  for (int64_t first = 0; first < element_count; first += kTileColumns) {
    const int64_t count = std::min(kTileColumns, element_count - first);
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

}  // namespace comrad::policy::kernels
