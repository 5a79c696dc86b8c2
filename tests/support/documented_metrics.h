// The names that learner/METRICS.md documents, for tests of what writes them.
#pragma once

#include <algorithm>
#include <fstream>
#include <regex>
#include <string>
#include <vector>

#include "rollout_buffer/core/files.h"

namespace comrad::test {

/// One row of a table there: `text` as it stands, which may hold <i> (an agent, a head) or <part>.
struct DocumentedMetric {
  std::string text;
  std::regex names;
  bool covers(const std::string& name) const { return std::regex_match(name, names); }
};

/// The rows whose names begin with one of `sections` ("train/"), in their order.
inline std::vector<DocumentedMetric> documented_metrics(const std::vector<std::string>& sections) {
  std::ifstream file(data_dir() + "/learner/METRICS.md");
  static const std::regex row(R"(\| `([a-z_]+/[A-Za-z0-9_<>]+)` \|.*)");
  std::vector<DocumentedMetric> found;
  std::smatch match;
  for (std::string line; std::getline(file, line);) {
    if (!std::regex_match(line, match, row)) continue;
    const std::string text = match[1];
    if (std::ranges::none_of(sections, [&](const std::string& section) { return text.starts_with(section); }))
      continue;
    const std::string pattern = std::regex_replace(std::regex_replace(text, std::regex("<i>"), "[0-9]+"),
                                                   std::regex("<part>"), "(encoder|core|heads|critic|mixer)");
    found.push_back({text, std::regex(pattern)});
  }
  return found;
}

/// Those of `names` that no row covers.
inline std::vector<std::string> undocumented(const std::vector<DocumentedMetric>& documented,
                                             const std::vector<std::string>& names) {
  std::vector<std::string> missing;
  for (const std::string& name : names)
    if (std::ranges::none_of(documented, [&](const DocumentedMetric& row) { return row.covers(name); }))
      missing.push_back(name);
  return missing;
}

/// The rows that none of `names` has.
inline std::vector<std::string> unwritten(const std::vector<DocumentedMetric>& documented,
                                          const std::vector<std::string>& names) {
  std::vector<std::string> rows;
  for (const DocumentedMetric& row : documented)
    if (std::ranges::none_of(names, [&](const std::string& name) { return row.covers(name); }))
      rows.push_back(row.text);
  return rows;
}

}  // namespace comrad::test
