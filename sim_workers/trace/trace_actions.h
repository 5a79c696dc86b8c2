// What one player presses, tic by tic: read from a CSV, or drawn. Columns are those of a trace (a_fwd ..
// a_dside) and of a script (fwd .. dside); further columns are named by ViZDoom's buttons. Stage: step.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "scenarios/spec/game_names.h"
#include "sim_workers/engine/world/player.h"

namespace comrad::trace {

struct ActionColumn {
  std::string name;  ///< of the CSV, without "a_"
  scenarios::Button button;
};

/// The sixteen columns that every trace has, in their order.
std::span<const ActionColumn> standard_columns();

/// One action a tic.
class ActionTable {
 public:
  ActionTable();  ///< the standard columns, no rows

  const std::vector<ActionColumn>& columns() const { return columns_; }
  int64_t size() const { return static_cast<int64_t>(values_.size() / columns_.size()); }
  /// Values of tic `row` [columns]; zeros beyond the end.
  std::span<const double> values(int64_t row) const;
  doom::Buttons buttons(int64_t row) const;

  /// Reads a script or a trace; of a trace the row t = 0, which comes before the first action, is left out.
  /// `label` begins the messages. Errors: kBadFormat with line and column.
  static Expected<ActionTable> parse(std::string_view text, const std::string& label);
  static Expected<ActionTable> load(const std::string& path);

  /// `tics` actions drawn from `seed`: each button of `buttons` is held for 1 to 12 tics at a time, deltas
  /// are quarter steps.
  static ActionTable random(std::span<const scenarios::Button> buttons, std::span<const std::string> names,
                            int64_t tics, uint64_t seed);

 private:
  std::size_t column_of(const scenarios::Button& button, const std::string& name);

  std::vector<ActionColumn> columns_;
  std::vector<double> values_;  // [row, column]
};

/// Where a player stands: columns POSITION_X .. VELOCITY_Z of a trace's row t = 0.
struct Pose {
  doom::Fixed x = 0, y = 0, z = 0;
  doom::Angle angle = 0, pitch = 0;
  doom::Fixed velocity_x = 0, velocity_y = 0, velocity_z = 0;
};

/// Reads the pose of a trace's first row. Errors: kNotFound, kBadFormat.
Expected<Pose> load_pose(const std::string& path);

}  // namespace comrad::trace
