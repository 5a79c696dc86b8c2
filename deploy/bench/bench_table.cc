#include "deploy/bench/bench_table.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <vector>

namespace comrad::deploy {
namespace {

using nlohmann::ordered_json;

bool is_table(const ordered_json& value) {
  return value.is_array() && !value.empty() &&
         std::ranges::all_of(value, [](const ordered_json& row) { return row.is_object(); });
}

void append_padded(std::string& line, const std::string& text, std::size_t width, bool is_number) {
  const std::string padding(width > text.size() ? width - text.size() : 0, ' ');
  line += is_number ? padding + text : text + padding;
}

std::string rows_of(const std::string& name, const ordered_json& table) {
  std::vector<std::string> heads;
  for (const auto& [key, value] : table.front().items())
    if (!value.is_structured()) heads.push_back(key);
  std::vector<std::vector<std::string>> cells = {heads};
  for (const ordered_json& row : table) {
    cells.emplace_back();
    for (const std::string& head : heads)
      cells.back().push_back(row.contains(head) ? bench_cell(row[head]) : "");
  }
  std::string text = "\n" + name + "\n";
  for (const std::vector<std::string>& row : cells) {
    std::string line = " ";
    for (std::size_t column = 0; column < heads.size(); ++column) {
      std::size_t width = 0;
      for (const std::vector<std::string>& each : cells) width = std::max(width, each[column].size());
      line += " ";
      append_padded(line, row[column], width, table.front()[heads[column]].is_number());
    }
    while (line.ends_with(' ')) line.pop_back();
    text += line + "\n";
  }
  return text;
}

void append_lines(const std::string& prefix, const ordered_json& object, std::string& lines,
                  std::string& tables) {
  for (const auto& [key, value] : object.items()) {
    const std::string name = prefix + key;
    if (is_table(value)) {
      tables += rows_of(name, value);
    } else if (value.is_object()) {
      append_lines(name + ".", value, lines, tables);
    } else {
      append_padded(lines, name, 40, false);
      lines += " " + bench_cell(value) + "\n";
    }
  }
}

}  // namespace

std::string bench_cell(const ordered_json& value) {
  if (value.is_string()) return value.get<std::string>();
  if (value.is_array()) {
    std::string text;
    for (const ordered_json& each : value) text += (text.empty() ? "" : ", ") + bench_cell(each);
    return text;
  }
  if (!value.is_number_float()) return value.dump();
  const double number = value.get<double>(), size = std::abs(number);
  char text[40];
  std::snprintf(text, sizeof text, "%.*f", size >= 100 ? 0 : size >= 10 ? 1 : size >= 0.1 ? 2 : 4, number);
  return text;
}

std::string bench_table(const ordered_json& summary) {
  std::string lines, tables;
  append_lines("", summary, lines, tables);
  return lines + tables;
}

}  // namespace comrad::deploy
