// Compares values of checkpoints: NaN equals nothing, tensors must have the same shape, type and numbers.
#pragma once

#include <torch/torch.h>

#include <string>
#include <variant>

#include "learner/checkpoint/checkpoint.h"

namespace comrad::test {

inline bool same_value(const learn::StateDict::Value& one, const learn::StateDict::Value& other) {
  if (one.index() != other.index()) return false;
  if (const auto* tensor = std::get_if<torch::Tensor>(&one))
    return torch::equal(*tensor, std::get<torch::Tensor>(other));
  if (const auto* integer = std::get_if<int64_t>(&one)) return *integer == std::get<int64_t>(other);
  if (const auto* number = std::get_if<double>(&one)) return *number == std::get<double>(other);
  return std::get<std::string>(one) == std::get<std::string>(other);
}

}  // namespace comrad::test
