// `comrad bench report`: the tables of BENCHMARKS.md that no hand typed.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "deploy/bench/bench_parts.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// Where and of what the numbers are.
struct BenchOrigin {
  std::string
      commit;  ///< short hash, with "+changes" where files differ from it; "unknown" outside of a checkout
  std::string machine;  ///< "Intel Xeon, 2 of 16 cores, AVX-512 BF16"
  std::string date;     ///< 2026-11-24
};

/// Of this machine, now. `model_text`: /proc/cpuinfo.
BenchOrigin bench_origin();
std::string machine_text(const std::string& cpuinfo, int usable_cores);

/// Measures every bench once, `request.seconds` each. Errors: those of measure_bench() and measure_with_program().
Expected<std::vector<nlohmann::ordered_json>> measure_everything(const BenchRequest& request);

/// Markdown of the objects that measure_everything() gave: one row for each bench, then batch sizes, algorithms, processor
/// seconds by stage, and the bottleneck.
std::string report_tables(const std::vector<nlohmann::ordered_json>& benches, const BenchOrigin& origin);

inline const std::string kReportBegin = "<!-- comrad bench report: begin -->",
                         kReportEnd = "<!-- comrad bench report: end -->";

/// `text` with `tables` between the two marks, and all else as it was. Errors: kBadFormat where a mark is missing, stands twice,
/// or the end stands first.
Expected<std::string> with_tables(const std::string& text, const std::string& tables);

}  // namespace comrad::deploy
