#include "sim_workers/trace/trace_actions.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/core/text.h"
#include "sim_workers/env/button_press.h"

namespace comrad::trace {
namespace {

constexpr std::size_t kFileBytesMax = std::size_t{1} << 30;
constexpr int kHoldTicsMax = 12;

std::vector<ActionColumn> make_standard_columns() {
  constexpr std::pair<const char*, const char*> kNames[] = {
      {"fwd", "MOVE_FORWARD"},
      {"back", "MOVE_BACKWARD"},
      {"left", "MOVE_LEFT"},
      {"right", "MOVE_RIGHT"},
      {"turnl", "TURN_LEFT"},
      {"turnr", "TURN_RIGHT"},
      {"attack", "ATTACK"},
      {"speed", "SPEED"},
      {"use", "USE"},
      {"jump", "JUMP"},
      {"crouch", "CROUCH"},
      {"turn180", "TURN180"},
      {"dyaw", "TURN_LEFT_RIGHT_DELTA"},
      {"dpitch", "LOOK_UP_DOWN_DELTA"},
      {"dfwd", "MOVE_FORWARD_BACKWARD_DELTA"},
      {"dside", "MOVE_LEFT_RIGHT_DELTA"},
  };
  std::vector<ActionColumn> columns;
  for (const auto& [name, button] : kNames) columns.push_back({name, scenarios::find_button(button).value()});
  return columns;
}

std::string shown(std::string_view text) {
  std::string result;
  for (const char c : text.substr(0, 40)) result += c >= ' ' && c <= '~' ? c : '?';
  return result;
}

Expected<std::string> read_file(const std::string& path) {
  std::error_code failure;
  const auto size = std::filesystem::file_size(path, failure);
  if (failure) return Error{ErrorCode::kNotFound, path + ": " + failure.message()};
  if (size > kFileBytesMax) return Error{ErrorCode::kBadFormat, path + ": larger than a gigabyte"};
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  if (!file) return Error{ErrorCode::kNotFound, path + ": cannot be read"};
  return text.str();
}

/// Lines of a CSV without comments and empty ones, cut into cells.
class CsvReader {
 public:
  CsvReader(std::string_view text, std::string label) : text_(text), label_(std::move(label)) {}

  /// False at the end.
  bool next() {
    while (!text_.empty()) {
      const std::size_t end = text_.find('\n');
      std::string_view line = trimmed(text_.substr(0, end));
      text_ = end == std::string_view::npos ? std::string_view() : text_.substr(end + 1);
      ++line_number_;
      if (line.empty() || line.front() == '#') continue;
      cells_.clear();
      for (std::size_t comma = 0; comma != std::string_view::npos;) {
        comma = line.find(',');
        cells_.push_back(trimmed(line.substr(0, comma)));
        if (comma != std::string_view::npos) line.remove_prefix(comma + 1);
      }
      return true;
    }
    return false;
  }
  const std::vector<std::string_view>& cells() const { return cells_; }
  Error error(const std::string& what) const {
    return Error{ErrorCode::kBadFormat, fmt::format("{}:{}: {}", label_, line_number_, what)};
  }
  Expected<double> number(std::size_t cell, std::string_view column) const {
    double value = 0;
    if (cell < cells_.size()) {
      const std::string_view text = cells_[cell];
      const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
      if (code == std::errc() && end == text.data() + text.size() && std::isfinite(value)) return value;
      return error("'" + shown(text) + "' in column " + std::string(column) + " is no number");
    }
    return error("there is no cell for column " + std::string(column));
  }

 private:
  std::string_view text_;
  std::string label_;
  std::vector<std::string_view> cells_;
  int line_number_ = 0;
};

}  // namespace

std::span<const ActionColumn> standard_columns() {
  static const std::vector<ActionColumn> columns = make_standard_columns();
  return columns;
}

ActionTable::ActionTable() : columns_(standard_columns().begin(), standard_columns().end()) {}

std::span<const double> ActionTable::values(int64_t row) const {
  static constexpr std::array<double, 64> kNothing{};  // there are fewer buttons
  if (row < 0 || row >= size()) return std::span(kNothing).first(std::min(columns_.size(), kNothing.size()));
  return std::span(values_).subspan(static_cast<std::size_t>(row) * columns_.size(), columns_.size());
}

doom::Buttons ActionTable::buttons(int64_t row) const {
  doom::Buttons pressed;
  const std::span<const double> cells = values(row);
  for (std::size_t i = 0; i < cells.size(); ++i) sim::press(pressed, columns_[i].button, cells[i]);
  return pressed;
}

std::size_t ActionTable::column_of(const scenarios::Button& button, const std::string& name) {
  for (std::size_t i = 0; i < columns_.size(); ++i)
    if (columns_[i].button.kind == button.kind && columns_[i].button.slot == button.slot) return i;
  columns_.push_back({name, button});
  return columns_.size() - 1;
}

Expected<ActionTable> ActionTable::parse(std::string_view text, const std::string& label) {
  CsvReader csv(text, label);
  if (!csv.next()) return Error{ErrorCode::kBadFormat, label + ": no header line; it names the columns"};
  const bool is_trace = std::any_of(csv.cells().begin(), csv.cells().end(),
                                    [](std::string_view cell) { return cell.starts_with("a_"); });
  ActionTable table;
  struct Source {
    std::size_t cell, column;
    std::string name;
  };
  std::vector<Source> sources;
  std::size_t tic_cell = csv.cells().size();
  for (std::size_t cell = 0; cell < csv.cells().size(); ++cell) {
    std::string_view name = csv.cells()[cell];
    if (name == "t") {
      tic_cell = cell;
      continue;
    }
    if (is_trace && !name.starts_with("a_")) continue;  // state, which the game makes anew
    if (is_trace) name.remove_prefix(2);
    const auto standard = std::find_if(standard_columns().begin(), standard_columns().end(),
                                       [&](const ActionColumn& column) { return column.name == name; });
    const auto button = standard != standard_columns().end() ? std::optional(standard->button)
                                                             : scenarios::find_button(upper_case(name));
    if (!button)
      return csv.error("column '" + shown(name) +
                       "' is no button; columns are t, fwd, back, left, right, turnl, "
                       "turnr, attack, speed, use, jump, crouch, turn180, dyaw, dpitch, dfwd, dside and "
                       "ViZDoom's names");
    sources.push_back({cell, table.column_of(*button, std::string(name)), std::string(name)});
  }
  if (sources.empty()) return csv.error("no column names a button");
  while (csv.next()) {
    if (is_trace && tic_cell < csv.cells().size() && csv.cells()[tic_cell] == "0") continue;
    const std::size_t row = table.values_.size();
    table.values_.resize(row + table.columns_.size());
    for (const Source& source : sources) {
      COMRAD_TRY_ASSIGN(const double value, csv.number(source.cell, source.name));
      table.values_[row + source.column] = value;
    }
  }
  return table;
}

Expected<ActionTable> ActionTable::load(const std::string& path) {
  COMRAD_TRY_ASSIGN(const std::string text, read_file(path));
  return parse(text, path);
}

ActionTable ActionTable::random(std::span<const scenarios::Button> buttons,
                                std::span<const std::string> names, int64_t tics, uint64_t seed) {
  ActionTable table;
  std::vector<std::size_t> target;
  for (std::size_t i = 0; i < buttons.size(); ++i)
    target.push_back(table.column_of(buttons[i], lower_case(names[i])));
  Rng rng(RngKey(seed).split("trace actions"));
  std::vector<int> tics_left(buttons.size(), 0);
  std::vector<double> held(buttons.size(), 0);
  table.values_.resize(static_cast<std::size_t>(tics) * table.columns_.size());
  for (int64_t tic = 0; tic < tics; ++tic)
    for (std::size_t i = 0; i < buttons.size(); ++i) {
      if (tics_left[i]-- <= 0) {
        tics_left[i] = rng.between(0, kHoldTicsMax - 1);
        // Weapons and the like are keys that are tapped, moves are keys that are held.
        const bool is_rare = buttons[i].kind >= scenarios::ButtonKind::kSelectWeapon &&
                             buttons[i].kind <= scenarios::ButtonKind::kDropItem;
        if (buttons[i].is_delta()) {
          held[i] = rng.below(2) == 0 ? 0.0 : rng.between(-40, 40) * 0.25;
        } else {
          held[i] = rng.below(is_rare ? 16 : 2) == 0 ? 1.0 : 0.0;
        }
      }
      table.values_[static_cast<std::size_t>(tic) * table.columns_.size() + target[i]] = held[i];
    }
  return table;
}

Expected<Pose> load_pose(const std::string& path) {
  COMRAD_TRY_ASSIGN(const std::string text, read_file(path));
  CsvReader csv(text, path);
  if (!csv.next()) return Error{ErrorCode::kBadFormat, path + ": no header line; it names the columns"};
  std::vector<std::string> header(csv.cells().begin(), csv.cells().end());
  if (!csv.next()) return Error{ErrorCode::kBadFormat, path + ": no row to start from"};
  Pose pose;
  int found = 0;
  const auto fixed = [&](std::size_t cell, doom::Fixed* target) -> Status {
    COMRAD_TRY_ASSIGN(const double value, csv.number(cell, header[cell]));
    if (std::abs(value) >= 32768.0) return csv.error(header[cell] + " lies outside -32768..32767");
    *target = static_cast<doom::Fixed>(std::llround(value * 65536.0));
    ++found;
    return {};
  };
  const auto angle = [&](std::size_t cell, doom::Angle* target) -> Status {
    COMRAD_TRY_ASSIGN(const double value, csv.number(cell, header[cell]));
    if (std::abs(value) > 3600.0) return csv.error(header[cell] + " lies outside -3600..3600");
    *target = static_cast<doom::Angle>(static_cast<uint64_t>(std::llround(value / 360.0 * 4294967296.0)));
    ++found;
    return {};
  };
  for (std::size_t cell = 0; cell < header.size(); ++cell) {
    const std::string& name = header[cell];
    if (name == "POSITION_X") COMRAD_TRY(fixed(cell, &pose.x));
    if (name == "POSITION_Y") COMRAD_TRY(fixed(cell, &pose.y));
    if (name == "POSITION_Z") COMRAD_TRY(fixed(cell, &pose.z));
    if (name == "VELOCITY_X") COMRAD_TRY(fixed(cell, &pose.velocity_x));
    if (name == "VELOCITY_Y") COMRAD_TRY(fixed(cell, &pose.velocity_y));
    if (name == "VELOCITY_Z") COMRAD_TRY(fixed(cell, &pose.velocity_z));
    if (name == "ANGLE") COMRAD_TRY(angle(cell, &pose.angle));
    if (name == "PITCH") COMRAD_TRY(angle(cell, &pose.pitch));
  }
  if (found < 8)
    return Error{ErrorCode::kBadFormat,
                 path +
                     ": columns POSITION_X, _Y, _Z, ANGLE, PITCH, VELOCITY_X, _Y and _Z "
                     "are all needed to start from"};
  return pose;
}

}  // namespace comrad::trace
