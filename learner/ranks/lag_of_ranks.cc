#include "learner/ranks/lag_of_ranks.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "policy_workers/device/torch_ops.h"

namespace comrad::learn {

LagStats lag_of_ranks(const LagStats& mine, int64_t places, RankGroup& ranks) {
  if (ranks.is_alone()) return mine;
  const double valid = std::round(mine.valid_fraction * static_cast<double>(places)),
               heard = valid + static_cast<double>(mine.dropped);
  const torch::Tensor table = ranks.gather(
      torch::tensor({mine.mean * heard, heard, static_cast<double>(mine.min), static_cast<double>(mine.max),
                     static_cast<double>(mine.dropped), valid, static_cast<double>(places)},
                    torch::kFloat64)
          .unsqueeze(0),
      0);
  LagStats all;
  double sum = 0, count = 0, valid_count = 0, place_count = 0;
  bool is_first = true;
  for (int64_t rank = 0; rank < table.size(0); ++rank) {
    const double* row = table.data_ptr<double>() + rank * table.size(1);
    sum += row[0];
    count += row[1];
    valid_count += row[5];
    place_count += row[6];
    all.dropped += static_cast<int64_t>(row[4]);
    if (row[1] == 0) continue;
    all.min = std::exchange(is_first, false) ? static_cast<int64_t>(row[2])
                                             : std::min(all.min, static_cast<int64_t>(row[2]));
    all.max = std::max(all.max, static_cast<int64_t>(row[3]));
  }
  all.mean = count > 0 ? sum / count : 0;
  all.valid_fraction = valid_count / std::max(1.0, place_count);
  return all;
}

}  // namespace comrad::learn
