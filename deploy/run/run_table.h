// Tables and lines about a run for terminals of any width, from the status that the run's control socket reports.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace comrad::deploy {

/// One column: `weight` decides which is dropped first where the terminal is narrow, the lightest.
struct TableColumn {
  std::string title;
  int weight = 0;
  bool is_number = true;
};

/// Rows under their titles, no line longer than `width`: columns are left out, the lightest first, and what still does not fit
/// is cut. Bytes that would drive a terminal become '?'. The first column always stays.
std::vector<std::string> table_lines(const std::vector<TableColumn>& columns,
                                     const std::vector<std::vector<std::string>>& rows, std::size_t width);
/// The text without bytes that would drive a terminal, cut at `width` letters.
std::string fitted(std::string_view text, std::size_t width);

/// What `comrad ctl RUN status` and the head of a run in `comrad top` say.
std::vector<std::string> run_lines(const nlohmann::json& run, std::size_t width);
std::vector<std::string> host_table(const nlohmann::json& run, std::size_t width);
std::vector<std::string> worker_table(const nlohmann::json& run, std::size_t width);

}  // namespace comrad::deploy
