#include "learner/losses/loss_terms.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "policy_workers/device/torch_ops.h"

namespace comrad::learn {
namespace {

double joined(Join join, double a, double b) {
  return join == Join::kSum ? a + b : join == Join::kMax ? std::max(a, b) : std::min(a, b);
}

double nothing_of(Join join) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  return join == Join::kSum ? 0 : join == Join::kMax ? -kInfinity : kInfinity;
}

Tensor where_counted(const Tensor& of_samples, const Tensor& counts, double otherwise) {
  return torch::where(counts, of_samples.detach(), torch::full({}, otherwise, of_samples.options()));
}

}  // namespace

void LossTerms::say(std::string name, Join join, bool is_loss, const Tensor& number) {
  names_.push_back({.name = std::move(name), .join = join, .is_loss = is_loss});
  numbers_.push_back(number.detach());
}

void LossTerms::add(std::string name, const Tensor& share) {
  loss_ = loss_.defined() ? loss_ + share : share;
  say(std::move(name), Join::kSum, /*is_loss=*/true, share);
}

void LossTerms::sum(std::string name, const Tensor& part) {
  say(std::move(name), Join::kSum, /*is_loss=*/false, part);
}

void LossTerms::mean(std::string name, const Tensor& of_samples, const Tensor& weight) {
  sum(std::move(name), (of_samples.detach() * weight).sum());
}

void LossTerms::max(std::string name, const Tensor& of_samples, const Tensor& counts, double otherwise) {
  say(std::move(name), Join::kMax, /*is_loss=*/false, where_counted(of_samples, counts, otherwise).max());
}

void LossTerms::min(std::string name, const Tensor& of_samples, const Tensor& counts, double otherwise) {
  say(std::move(name), Join::kMin, /*is_loss=*/false, where_counted(of_samples, counts, otherwise).min());
}

Tensor LossTerms::numbers() const { return torch::stack(numbers_); }

TermValues::TermValues(std::vector<TermName> names) : names_(std::move(names)) {
  for (const TermName& term : names_) values_.push_back(nothing_of(term.join));
}

double TermValues::operator[](std::string_view name) const {
  const auto found = std::ranges::find(names_, name, &TermName::name);
  return found == names_.end() ? 0 : values_[static_cast<std::size_t>(found - names_.begin())];
}

void TermValues::set(std::string name, double value) {
  const auto found = std::ranges::find(names_, name, &TermName::name);
  if (found != names_.end()) {
    values_[static_cast<std::size_t>(found - names_.begin())] = value;
    return;
  }
  names_.push_back({.name = std::move(name)});
  values_.push_back(value);
}

void TermValues::join(const double* numbers) {
  for (std::size_t i = 0; i < names_.size(); ++i) values_[i] = joined(names_[i].join, values_[i], numbers[i]);
}

void TermValues::add(const TermValues& other, double share) {
  for (std::size_t i = 0; i < other.names_.size(); ++i) {
    const TermName& term = other.names_[i];
    auto found = std::ranges::find(names_, term.name, &TermName::name);
    if (found == names_.end()) {
      names_.push_back(term);
      values_.push_back(nothing_of(term.join));
      found = names_.end() - 1;
    }
    double& value = values_[static_cast<std::size_t>(found - names_.begin())];
    value = joined(term.join, value, (term.join == Join::kSum ? share : 1) * other.values_[i]);
  }
}

double TermValues::loss() const {
  double sum = 0;
  for (std::size_t i = 0; i < names_.size(); ++i)
    if (names_[i].is_loss) sum += values_[i];
  return sum;
}

}  // namespace comrad::learn
