#include "deploy/sweep/sweep_table.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>

#include "deploy/launch/progress.h"
#include "rollout_buffer/core/score_text.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

constexpr std::array kStates = {RunState::kFinished,    RunState::kRunning, RunState::kQueued,
                                RunState::kInterrupted, RunState::kWaiting, RunState::kFailed};

int64_t count_of(const std::vector<RunView>& views, RunState state) {
  return std::ranges::count(views, state, &RunView::state);
}

double left_of(const RunView& view) {
  return view.state == RunState::kFinished ? 0 : std::max(0.0, view.goal_env_frames - view.env_frames);
}

std::string eta_text(double frames, double frames_per_s) {
  return frames > 0 && frames_per_s > 0 ? duration_text(frames / frames_per_s) : "";
}

std::string per_cent(const RunView& view) {
  if (!(view.goal_env_frames > 0)) return "";
  char text[32];
  std::snprintf(text, sizeof text, " (%.0f%%)",
                std::min(100.0, 100 * view.env_frames / view.goal_env_frames));
  return text;
}

/// "learning_rate=0.0003 rollout=32": long numbers with three digits.
std::string searched_text(const RunView& view) {
  std::string text;
  for (const auto& [setting, value] : view.record.settings) {
    const std::optional<double> number = read_real(value);
    char rounded[32] = "";
    if (number && value.size() > 6) std::snprintf(rounded, sizeof rounded, "%.3g", *number);
    text += (text.empty() ? "" : " ") + setting + "=" + (*rounded == '\0' ? value : rounded);
  }
  return text;
}

/// The run with the highest J of each study, among those that reported one: finished trials, all members.
std::vector<const RunView*> best_of_studies(const std::vector<RunView>& views) {
  std::vector<const RunView*> best;
  for (const RunView& view : views) {
    const bool is_reported =
        view.state == RunState::kFinished || (view.record.trial < 0 && view.record.steps > 0);
    if (view.study.empty() || !std::isfinite(view.score_mean) || !is_reported) continue;
    const auto known = std::ranges::find(best, view.study, &RunView::study);
    if (known == best.end())
      best.push_back(&view);
    else if (view.score_mean > (*known)->score_mean)
      *known = &view;
  }
  return best;
}

std::vector<std::string> cells_of(const RunView& view) {
  const bool is_running = view.state == RunState::kRunning;
  return {view.name,
          word_of(view.state) + std::string(view.stale.empty() ? "" : ", stale") +
              (view.record.pruned_at_env_frames > 0 ? ", pruned" : ""),
          count_text(view.env_frames) + "/" + count_text(view.goal_env_frames) + per_cent(view),
          is_running ? count_text(view.env_frames_per_s) : "",
          std::isfinite(view.score_mean) ? score_text(view.score_mean) : "",
          is_running ? eta_text(left_of(view), view.env_frames_per_s) : "",
          view.record.host + (view.record.job.empty() ? "" : " (job " + view.record.job + ")"),
          view.record.attempts > 0 ? std::to_string(view.record.attempts) : "",
          searched_text(view)};
}

}  // namespace

std::string sweep_line(const std::vector<RunView>& views) {
  std::string text = fmt::format("{} of {} finished", count_of(views, RunState::kFinished), views.size());
  for (const RunState state : kStates)
    if (const int64_t count = count_of(views, state); count > 0 && state != RunState::kFinished)
      text += fmt::format(", {} {}", count, word_of(state));
  double rate = 0, left = 0;
  for (const RunView& view : views) {
    rate += view.env_frames_per_s;
    if (view.state != RunState::kFailed) left += left_of(view);
  }
  if (rate > 0) text += " | " + count_text(rate) + " env frames/s";
  if (const std::string eta = eta_text(left, rate); !eta.empty()) text += " | ETA " + eta;
  return text;
}

std::string sweep_table(const std::vector<RunView>& views) {
  std::vector<std::vector<std::string>> rows = {
      {"run", "state", "env frames", "frames/s", "J", "ETA", "host", "attempts", "searched"}};
  if (std::ranges::all_of(views, [](const RunView& view) { return view.study.empty(); }))
    rows[0].back().clear();
  for (const RunView& view : views) rows.push_back(cells_of(view));
  std::vector<std::size_t> widths(rows[0].size());
  for (const auto& row : rows)
    for (std::size_t column = 0; column < row.size(); ++column)
      widths[column] = std::max(widths[column], row[column].size());
  std::string text;
  for (const auto& row : rows) {
    std::string line;
    for (std::size_t column = 0; column < row.size(); ++column) {
      line += row[column];
      line.append(widths[column] - row[column].size() + 2, ' ');
    }
    while (line.ends_with(' ')) line.pop_back();
    text += line + "\n";
  }
  text += "\n" + sweep_line(views) + "\n";
  for (const RunView* best : best_of_studies(views))
    text += "best of " + best->study + ": " + best->name + ", J " + score_text(best->score_mean) + " with " +
            searched_text(*best) + "\n";
  for (const RunView& view : views)
    if (view.state == RunState::kFailed ||
        (view.state == RunState::kInterrupted && !view.record.error.empty()))
      text += view.name + " " + word_of(view.state) + ": " + view.record.error + "\n";
  for (const RunView& view : views)
    if (!view.stale.empty()) text += view.name + " is stale: " + view.stale + "\n";
  return text;
}

std::string sweep_json(const std::string& name, const std::string& folder,
                       const std::vector<RunView>& views) {
  using nlohmann::ordered_json;
  ordered_json json = {{"name", name}, {"folder", folder}};
  for (const RunState state : kStates) json[word_of(state)] = count_of(views, state);
  json["runs"] = ordered_json::array();
  for (const RunView& view : views)
    json["runs"].push_back(
        {{"name", view.name},
         {"state", word_of(view.state)},
         {"env_frames", view.env_frames},
         {"train_for_env_frames", view.goal_env_frames},
         {"env_frames_per_s", view.env_frames_per_s},
         {"J_mean", std::isfinite(view.score_mean) ? ordered_json(view.score_mean) : ordered_json(nullptr)},
         {"host", view.record.host},
         {"job", view.record.job},
         {"attempts", view.record.attempts},
         {"searched", to_json(view.record.settings)},
         {"pruned_at_env_frames", view.record.pruned_at_env_frames},
         {"kept", view.is_kept},
         {"stale", view.stale},
         {"error", view.record.error}});
  return json.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
}

}  // namespace comrad::deploy
