// A loss's terms, by name: the shares that are added to it, and means, sums and extremes that a report shows. A minibatch
// is cut into micro-batches; each computes its part of every number on the device, and the parts come together on the host:
//
//   LossTerms terms;                                   // of one micro-batch
//   terms.add("policy_loss", -(objective * weight).sum());
//   terms.mean("kl_divergence", kl, weight);           // one line is a metric: train/kl_divergence
//
// Means are over a minibatch: `weight` is 1 / count where a sample counts and 0 elsewhere, so that the parts add up. Stage: update.
#pragma once

#include <torch/types.h>

#include <string>
#include <string_view>
#include <vector>

namespace comrad::learn {

using torch::Tensor;

/// How the parts of a number come together.
enum class Join { kSum, kMax, kMin };

struct TermName {
  std::string name;
  Join join = Join::kSum;
  bool is_loss = false;  ///< a share of the loss
};

/// Of one micro-batch. All micro-batches of a minibatch say the same names in the same order.
class LossTerms {
 public:
  /// Adds `share`, f32 [] with gradient, to the loss.
  void add(std::string name, const Tensor& share);
  /// This part of a sum, f32 [].
  void sum(std::string name, const Tensor& part);
  /// Samples f32 [T, S] and the weight of each.
  void mean(std::string name, const Tensor& of_samples, const Tensor& weight);
  /// Over the samples that `counts` (bool [T, S]); `otherwise` where there is none.
  void max(std::string name, const Tensor& of_samples, const Tensor& counts, double otherwise);
  void min(std::string name, const Tensor& of_samples, const Tensor& counts, double otherwise);

  const Tensor& loss() const { return loss_; }  ///< f32 [], with gradient
  const std::vector<TermName>& names() const { return names_; }
  Tensor numbers() const;  ///< f32 [K], in the order of names()

  /// A number of each sample that an algorithm requests besides: log pi(a|o), |TD error|. Without gradient; may be undefined.
  Tensor kept;

 private:
  void say(std::string name, Join join, bool is_loss, const Tensor& number);

  Tensor loss_;
  std::vector<TermName> names_;
  std::vector<Tensor> numbers_;
};

/// Of a minibatch, on the host.
class TermValues {
 public:
  TermValues() = default;
  explicit TermValues(std::vector<TermName> names);

  /// 0 where nothing has the name.
  double operator[](std::string_view name) const;
  void set(std::string name, double value);
  /// Joins one micro-batch's numbers, in the order of the names.
  void join(const double* numbers);
  /// Adds what another minibatch, of other networks perhaps, said in the proportion `share`; extremes are merged.
  void add(const TermValues& other, double share);
  double loss() const;  ///< all of its shares

  const std::vector<TermName>& names() const { return names_; }
  const std::vector<double>& values() const { return values_; }

 private:
  std::vector<TermName> names_;
  std::vector<double> values_;
};

}  // namespace comrad::learn
