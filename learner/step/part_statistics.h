// Which part of the networks learns: gradient norm and Adam's step multiplier of encoder, core, heads, critic and
// mixer. A part whose multiplier is near 0 hardly trains, however long the run. Stage: beside update.
#pragma once

#include <torch/types.h>

#include <array>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "learner/step/adam_optimizer.h"
#include "learner/step/update_stats.h"

namespace comrad::learn {

/// The part that a network's parameter belongs to, by its name in checkpoints: "encoder", "core", "heads" (with
/// the layers before them) or "critic" (value heads, central critics and all networks of a joint one).
const char* part_of_parameter(std::string_view name);

/// Collects the parameters' numbers by part.
///
///   train/grad_norm_<part>  norm of the last step's gradient over the part, before clipping
///   train/adam_gain_<part>  mean over the part's elements of s / (s + epsilon), s = sqrt(v_hat): what Adam's
///                           epsilon leaves of a step. Near 1 Adam normalises the gradient, near 0 epsilon
///                           swallows it
///
/// Parts without a step are left out. Costs a pass over all second moments. Source: Kingma and Ba 2015,
/// arXiv:1412.6980, algorithm 1.
class PartStatistics {
 public:
  /// Adds those of `optimizer`'s parameters that are in `named`, under `part` or, where that is null, under
  /// part_of_parameter(). Parameters of several agents in one part count together.
  void add(const AdamOptimizer& optimizer, const std::vector<std::pair<std::string, torch::Tensor>>& named,
           const char* part = nullptr);
  void append_to(NamedNumbers& values) const;

 private:
  struct Sums {
    const char* part;
    double squares = 0, gain = 0, elements = 0;
  };
  std::array<Sums, 5> sums_ = {
      {{.part = "encoder"}, {.part = "core"}, {.part = "heads"}, {.part = "critic"}, {.part = "mixer"}}};
};

}  // namespace comrad::learn
