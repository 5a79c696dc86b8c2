// Loops over memory that one core cannot keep busy: Adam, sums of gradients and of frames, copies of weights. Stages: update, publish.
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

namespace comrad::device {

/// Calls work(piece) once for every piece in [0, pieces), in any order, by as many threads as libtorch's operators have here: one
/// inside a part of a PartPool. An exception of a piece is thrown again here.
void share_out(std::size_t pieces, const std::function<void(std::size_t)>& work);

/// A range of a tensor's elements.
struct Piece {
  std::size_t tensor = 0;
  int64_t begin = 0;
  int64_t end = 0;

  int64_t size() const { return end - begin; }
};

/// All elements of `tensors` in order, cut alike whatever the number of threads.
std::vector<Piece> pieces_of(const std::vector<torch::Tensor>& tensors);

}  // namespace comrad::device
