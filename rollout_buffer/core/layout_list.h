// The layouts that a run draws from, in order: written into the run directory by the launcher when the run
// starts, read by simulators (files) and the learner (names). The index in this list is what travels in slabs
// and mailboxes. Stage: reset.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad {

/// Where the list lies in a run directory.
constexpr const char* kLayoutListFile = "layouts/pool.toml";

/// One layout of a pool.
struct LayoutEntry {
  std::string id;           ///< task name
  std::string path;         ///< of the WAD, absolute
  double metric_scale = 0;  ///< what scores of this layout are divided by to be compared; 0: nothing
  double ceiling = 0;       ///< the best J that it allows the run's team; 0: not known
};

struct LayoutList {
  std::vector<LayoutEntry> layouts;
  std::string interestingness_graph;  ///< file that came with the pool, absolute; empty: none
};

/// The list as a TOML document that parse_layout_list() reads back without loss.
std::string layout_list_text(const LayoutList& list);

/// Errors: kBadFormat as "label:line:column: what", or naming the layout; also for an empty list and for two
/// layouts of one id.
Expected<LayoutList> parse_layout_list(std::string_view text, const std::string& label);

/// Reads `<run_dir>/layouts/pool.toml`. Errors: kNotFound, and those of parse_layout_list().
Expected<LayoutList> read_layout_list(const std::string& run_dir);

}  // namespace comrad
