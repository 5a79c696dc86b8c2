#include "deploy/evaluation/statistics.h"

#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <numbers>

namespace comrad::deploy {
namespace {

Eigen::Map<const Eigen::ArrayXd> array(std::span<const double> values) {
  return {values.data(), static_cast<Eigen::Index>(values.size())};
}

/// P(|T| <= t) for whole degrees of freedom nu.
double two_sided(double t, int nu) {
  const double theta = std::atan(t / std::sqrt(static_cast<double>(nu)));
  const double cosine = std::cos(theta), sine = std::sin(theta);
  if (nu % 2 == 1) {
    if (nu == 1) return 2 * theta / std::numbers::pi;
    double term = cosine, sum = cosine;
    for (int k = 2; k <= nu - 3; k += 2) sum += term *= cosine * cosine * k / (k + 1);
    return 2 / std::numbers::pi * (theta + sine * sum);
  }
  double term = 1, sum = 1;
  for (int k = 1; k <= nu - 3; k += 2) sum += term *= cosine * cosine * k / (k + 1);
  return sine * sum;
}

}  // namespace

double mean(std::span<const double> values) {
  return values.empty() ? std::numeric_limits<double>::quiet_NaN() : array(values).mean();
}

double student_t_975(int degrees) {
  double low = 0, high = 13;  // t(0.975, 1) = 12.706
  for (int i = 0; i < 60; ++i) {
    const double middle = (low + high) / 2;
    (two_sided(middle, degrees) < 0.95 ? low : high) = middle;
  }
  return (low + high) / 2;
}

double confidence_95(std::span<const double> values) {
  const auto count = static_cast<double>(values.size());
  if (values.size() < 2) return std::numeric_limits<double>::quiet_NaN();
  const double squares = (array(values) - mean(values)).square().sum();
  return student_t_975(static_cast<int>(values.size()) - 1) * std::sqrt(squares / (count - 1) / count);
}

}  // namespace comrad::deploy
