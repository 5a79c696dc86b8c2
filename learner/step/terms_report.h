// From what a loss said to a report's numbers. Stage: update > report.
#pragma once

#include "learner/losses/loss_terms.h"
#include "learner/step/update_stats.h"

namespace comrad::learn {

/// Each term as "train/<name>", in the loss's order (METRICS.md explains them).
inline void append_terms(const TermValues& terms, NamedNumbers& values) {
  for (std::size_t i = 0; i < terms.names().size(); ++i)
    values.emplace_back("train/" + terms.names()[i].name, terms.values()[i]);
}

}  // namespace comrad::learn
