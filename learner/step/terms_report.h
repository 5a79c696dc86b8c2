// From what a loss said to a report's numbers. Stage: update > report.
#pragma once

#include "learner/losses/loss_terms.h"
#include "learner/step/update_stats.h"

namespace comrad::learn {

/// Each term as "train/<name>", in the order in which the loss said them (METRICS.md says what they are).
inline void append_terms(const TermValues& terms, NamedNumbers& values) {
  for (std::size_t i = 0; i < terms.names().size(); ++i)
    values.emplace_back("train/" + terms.names()[i].name, terms.values()[i]);
}

}  // namespace comrad::learn
