#include "sim_workers/worker/position_log.h"

#include <cerrno>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "rollout_buffer/core/files.h"
#include "sim_workers/env/game_variables.h"

namespace comrad::sim {
namespace {

std::string hex(uint64_t number) {
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(number));
  return text;
}

int32_t whole(doom::Fixed units) { return static_cast<int32_t>(std::lround(doom::to_double(units))); }

}  // namespace

Expected<std::unique_ptr<PositionLog>> PositionLog::create(const std::string& path) {
  std::FILE* const file = std::fopen(path.c_str(), "we");
  if (file == nullptr) return file_error(path, errno);
  return std::unique_ptr<PositionLog>(new PositionLog(file, path));
}

void PositionLog::watch(DoomEnvironmentSet& environments) {
  for (int index = 0; index < environments.size(); ++index) {
    traces_.push_back(std::make_unique<Trace>(*this));
    environments.at(index).show_to(traces_.back().get());
  }
}

Status PositionLog::finish() {
  if (std::fflush(file_.get()) != 0 && status_) status_ = file_error(path_, errno);
  return status_;
}

void PositionLog::Trace::began(const DoomEnvironment& environment) {
  tics_ = 0;
  positions_.assign(static_cast<std::size_t>(environment.game().num_agents), {});
  log_.write_map(environment.game());
  note(environment);
}

void PositionLog::Trace::ticked(const DoomEnvironment& environment) {
  const bool is_over = environment.last_step().episode_over();
  if (++tics_ < environment.game().frame_skip && !is_over) return;
  tics_ = 0;
  note(environment);
  if (!is_over) return;
  log_.write_line(nlohmann::ordered_json{
      {"layout", hex(environment.game().layout_id)},
      {"decisions", positions_.empty() ? 0 : positions_[0].size() / 2 - 1},
      {"positions",
       positions_}}.dump());
}

void PositionLog::Trace::note(const DoomEnvironment& environment) {
  for (std::size_t agent = 0; agent < positions_.size(); ++agent)
    for (const scenarios::VariableKind axis :
         {scenarios::VariableKind::kPositionX, scenarios::VariableKind::kPositionY})
      positions_[agent].push_back(static_cast<int32_t>(
          std::lround(read_variable(environment.world(), static_cast<int>(agent), {.kind = axis}))));
}

void PositionLog::write_map(const DoomGame& game) {
  if (!maps_.insert(game.layout_id).second) return;
  const doom::Level& level = *game.level;
  nlohmann::ordered_json lines = nlohmann::ordered_json::array();
  for (const doom::Linedef& line : level.linedefs) {
    const doom::Vertex &start = level.vertices[line.start], &end = level.vertices[line.end];
    const bool blocks = !line.back || (line.flags & (doom::kLineBlocking | doom::kLineBlockEverything)) != 0;
    lines.push_back({whole(start.x), whole(start.y), whole(end.x), whole(end.y), blocks ? 1 : 0});
  }
  write_line(nlohmann::ordered_json{{"layout", hex(game.layout_id)}, {"lines", lines}}.dump());
}

void PositionLog::write_line(const std::string& line) {
  if (!status_) return;  // the first error is the one to tell
  if (std::fputs((line + "\n").c_str(), file_.get()) < 0) status_ = file_error(path_, errno);
}

}  // namespace comrad::sim
