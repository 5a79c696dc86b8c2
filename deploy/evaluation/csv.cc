#include "deploy/evaluation/csv.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace comrad::deploy {
namespace {

using Json = nlohmann::ordered_json;

std::string field(const Json& value) {
  if (value.is_null() || (value.is_number_float() && !std::isfinite(value.get<double>()))) return "";
  std::string text = value.is_string() ? value.get<std::string>() : value.dump();
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char letter : text) quoted += letter == '"' ? std::string("\"\"") : std::string(1, letter);
  return quoted + "\"";
}

std::string line_of(const std::vector<std::string>& fields) {
  std::string line;
  for (const std::string& one : fields) line += (&one == fields.data() ? "" : ",") + one;
  return line + "\n";
}

}  // namespace

std::string csv_text(const std::vector<Json>& rows) {
  if (rows.empty()) return "";
  struct Column {
    std::string key;
    int index;  // in the list; -1: the value is none
  };
  std::vector<Column> columns;
  std::vector<std::string> names;
  for (const auto& [key, value] : rows.front().items()) {
    std::size_t length = 0;
    for (const Json& row : rows)
      if (row[key].is_array()) length = std::max(length, row[key].size());
    if (!value.is_array()) {
      columns.push_back({key, -1});
      names.push_back(key);
    }
    for (std::size_t index = 0; value.is_array() && index < length; ++index) {
      columns.push_back({key, static_cast<int>(index)});
      names.push_back(fmt::format("{}_{}", key, index));
    }
  }
  std::string text = line_of(names);
  for (const Json& row : rows) {
    std::vector<std::string> fields;
    for (const Column& column : columns) {
      const Json& value = row[column.key];
      const auto index = static_cast<std::size_t>(std::max(column.index, 0));
      fields.push_back(field(column.index < 0 ? value : index < value.size() ? value[index] : Json()));
    }
    text += line_of(fields);
  }
  return text;
}

std::string json_lines(const std::vector<Json>& rows) {
  std::string text;
  for (const Json& row : rows) text += row.dump() + "\n";
  return text;
}

}  // namespace comrad::deploy
