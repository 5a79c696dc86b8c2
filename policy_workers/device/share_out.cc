#include "policy_workers/device/share_out.h"

#include <ATen/Parallel.h>

#include <algorithm>

namespace comrad::device {

void share_out(std::size_t pieces, const std::function<void(std::size_t)>& work) {
  at::parallel_for(0, static_cast<int64_t>(pieces), 1, [&work](int64_t begin, int64_t end) {
    for (int64_t piece = begin; piece < end; ++piece) work(static_cast<std::size_t>(piece));
  });
}

std::vector<Piece> pieces_of(const std::vector<torch::Tensor>& tensors) {
  constexpr int64_t kElementsOfAPiece = 1 << 16;
  std::vector<Piece> pieces;
  for (std::size_t i = 0; i < tensors.size(); ++i)
    for (int64_t begin = 0; begin < tensors[i].numel(); begin += kElementsOfAPiece)
      pieces.push_back({i, begin, std::min(begin + kElementsOfAPiece, tensors[i].numel())});
  return pieces;
}

}  // namespace comrad::device
