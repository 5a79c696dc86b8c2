#include "sim_workers/trace/trace_table.h"

#include <spdlog/fmt/fmt.h>

#include <charconv>
#include <cstdio>

namespace comrad::trace {
namespace {

/// How a column is written.
enum class Style { kInteger, kSixDecimals, kNineDecimals };
struct StateColumn {
  const char* name;
  Style style;
};
constexpr StateColumn kStateColumns[] = {
    {"POSITION_X", Style::kSixDecimals},
    {"POSITION_Y", Style::kSixDecimals},
    {"POSITION_Z", Style::kSixDecimals},
    {"ANGLE", Style::kNineDecimals},
    {"PITCH", Style::kNineDecimals},
    {"VELOCITY_X", Style::kSixDecimals},
    {"VELOCITY_Y", Style::kSixDecimals},
    {"VELOCITY_Z", Style::kSixDecimals},
    {"VIEW_HEIGHT", Style::kSixDecimals},
    {"ON_GROUND", Style::kInteger},
    {"HEALTH", Style::kInteger},
    {"ARMOR", Style::kInteger},
    {"SELECTED_WEAPON", Style::kInteger},
    {"ATTACK_READY", Style::kInteger},
    {"AMMO2", Style::kInteger},
    {"KILLCOUNT", Style::kInteger},
    {"HITCOUNT", Style::kInteger},
    {"HITS_TAKEN", Style::kInteger},
    {"DAMAGECOUNT", Style::kInteger},
    {"DAMAGE_TAKEN", Style::kInteger},
    {"DEAD", Style::kInteger},
};

void append(std::string* text, const char* format, double value) {
  char buffer[400];  // holds any double with %.9f
  std::snprintf(buffer, sizeof buffer, format, value);
  *text += buffer;
}

/// The shortest text that reads back as the same number.
void append_shortest(std::string* text, double value) {
  char buffer[64];
  const auto [end, code] = std::to_chars(buffer, buffer + sizeof buffer, value);
  text->append(buffer, code == std::errc() ? end : buffer);
}

void append_state(std::string* text, Style style, double value) {
  switch (style) {
    case Style::kInteger:
      append(text, "%.0f", value);
      break;
    case Style::kSixDecimals:
      append(text, "%.6f", value);
      break;
    case Style::kNineDecimals:
      append(text, "%.9f", value);
      break;
  }
}

}  // namespace

Expected<TraceTable> TraceTable::create(const ActionTable& actions, const std::vector<std::string>& variables,
                                        bool with_hash) {
  TraceTable table(actions, with_hash);
  for (const std::string& name : variables) {
    const auto variable = scenarios::find_variable(name);
    if (!variable) return Error{ErrorCode::kBadInput, "--variables: " + name + " is no game variable"};
    table.variable_names_.push_back(name);
    table.variables_.push_back(*variable);
  }
  return table;
}

std::string TraceTable::header() const {
  std::string line = "t,map_tic";
  const std::size_t standard_count = standard_columns().size();
  for (const ActionColumn& column : standard_columns()) line += ",a_" + column.name;
  for (const StateColumn& column : kStateColumns) line += std::string(",") + column.name;
  line += ",reward,total_reward,finished";
  for (std::size_t i = standard_count; i < actions_.columns().size(); ++i)
    line += ",a_" + actions_.columns()[i].name;
  for (const std::string& name : variable_names_) line += "," + name;
  if (with_hash_) line += ",hash";
  return line;
}

std::string TraceTable::row(TraceGame& game, int64_t t, double reward, double total_reward) const {
  const std::size_t standard_count = standard_columns().size();
  std::string line = fmt::format("{},{}", t, game.world().tic_count());
  const auto values = actions_.values(t - 1);  // zeros in row 0
  for (std::size_t i = 0; i < standard_count; ++i) line += ",", append_shortest(&line, values[i]);
  for (const StateColumn& column : kStateColumns) {
    line += ",";
    append_state(&line, column.style, game.variable(scenarios::find_variable(column.name).value()));
  }
  line += ",", append_state(&line, Style::kSixDecimals, reward);
  line += ",", append_state(&line, Style::kSixDecimals, total_reward);
  line += game.finished() ? ",1" : ",0";
  for (std::size_t i = standard_count; i < values.size(); ++i) line += ",", append_shortest(&line, values[i]);
  for (const scenarios::GameVariable& variable : variables_)
    line += ",", append_shortest(&line, game.variable(variable));
  if (with_hash_) {
    char buffer[32];
    std::snprintf(buffer, sizeof buffer, ",%016llx", static_cast<unsigned long long>(game.world().hash()));
    line += buffer;
  }
  return line;
}

}  // namespace comrad::trace
