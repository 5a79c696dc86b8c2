// Every number that a run reports, with its unit and meaning: what `comrad help metrics` prints and learner/METRICS.md shows.
// Stage: reports.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace comrad {

/// A row of metrics.jsonl. `name` may hold <part> (of the network) or <i> (a head or an agent).
struct Metric {
  std::string_view name, unit, meaning;
};

struct MetricGroup {
  std::string_view title, note;
  std::span<const Metric> metrics;
};

/// In the order in which they are shown.
const std::vector<MetricGroup>& metric_groups();

/// For a terminal.
std::string metrics_text();
/// Headings and tables; tests hold learner/METRICS.md to them.
std::string metrics_markdown();

}  // namespace comrad
