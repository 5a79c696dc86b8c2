// Means and confidence intervals of evaluation scores.
#pragma once

#include <span>

namespace comrad::deploy {

/// Arithmetic mean; NaN of nothing.
double mean(std::span<const double> values);

/// Quantile t(0.975, degrees) of Student's distribution; degrees >= 1. Source: Abramowitz and Stegun 1964,
/// 26.7.3 and 26.7.4 (the distribution for whole degrees), inverted by bisection.
double student_t_975(int degrees);

/// Half-width of the two-sided 95% confidence interval of the mean: t(0.975, n-1) * s / sqrt(n), s with n-1
/// below. NaN for fewer than two values.
double confidence_95(std::span<const double> values);

}  // namespace comrad::deploy
