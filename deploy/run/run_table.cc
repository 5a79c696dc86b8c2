#include "deploy/run/run_table.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "deploy/launch/progress.h"
#include "rollout_buffer/core/score_text.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

using nlohmann::json;

constexpr std::size_t kGap = 2;

double number(const json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_number() ? found->get<double>() : std::nan("");
}
double whole(const json& object, const char* key) {
  const double value = number(object, key);
  return std::isfinite(value) ? value : 0;
}
std::string text(const json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? found->get<std::string>() : "";
}
const json& part(const json& object, const char* key) {
  static const json nothing = json::object();
  const auto found = object.find(key);
  return found != object.end() ? *found : nothing;
}
std::string formatted(const char* format, double value) {
  char words[48];
  std::snprintf(words, sizeof words, format, value);
  return words;
}
std::string count(const json& object, const char* key) { return count_text(whole(object, key)); }

/// Letters of UTF-8 text: all bytes but continuations.
std::size_t letters(std::string_view word) {
  return static_cast<std::size_t>(std::ranges::count_if(
      word, [](char byte) { return (static_cast<unsigned char>(byte) & 0xC0) != 0x80; }));
}

}  // namespace

std::string fitted(std::string_view given, std::size_t width) {
  std::string line;
  std::size_t used = 0;
  const bool is_text = is_utf8(given);
  for (const char byte : given) {
    const auto bits = static_cast<unsigned char>(byte);
    const bool is_continuation = (bits & 0xC0) == 0x80;
    if (!is_continuation && used++ == width) break;
    line += bits < 0x20 || bits == 0x7F || (bits >= 0x80 && !is_text) ? '?' : byte;
  }
  // C1 control characters (U+0080 to U+009F) drive some terminals.
  for (std::size_t at = line.find('\xC2'); at != std::string::npos; at = line.find('\xC2', at + 1))
    if (at + 1 < line.size() && static_cast<unsigned char>(line[at + 1]) < 0xA0) line.replace(at, 2, "?");
  return line;
}

std::vector<std::string> table_lines(const std::vector<TableColumn>& columns,
                                     const std::vector<std::vector<std::string>>& rows, std::size_t width) {
  std::vector<std::vector<std::string>> cells(rows.size() + 1);
  for (const TableColumn& column : columns) cells[0].push_back(column.title);
  for (std::size_t row = 0; row < rows.size(); ++row)
    for (const std::string& word : rows[row]) cells[row + 1].push_back(fitted(word, 200));
  std::vector<std::size_t> widths(columns.size(), 0);
  for (const auto& row : cells)
    for (std::size_t column = 0; column < columns.size(); ++column)
      widths[column] = std::max(widths[column], letters(row[column]));
  std::vector<bool> is_shown(columns.size(), true);
  for (;;) {
    std::size_t sum = 0, lightest = 0;
    for (std::size_t column = 0; column < columns.size(); ++column) {
      if (!is_shown[column]) continue;
      sum += widths[column] + (sum > 0 ? kGap : 0);
      if (column > 0 && (lightest == 0 || columns[column].weight < columns[lightest].weight))
        lightest = column;
    }
    if (sum <= width || lightest == 0) break;
    is_shown[lightest] = false;
  }
  std::vector<std::string> lines;
  for (const auto& row : cells) {
    std::string line;
    for (std::size_t column = 0; column < columns.size(); ++column) {
      if (!is_shown[column]) continue;
      if (!line.empty()) line += std::string(kGap, ' ');
      const std::string padding(widths[column] - letters(row[column]), ' ');
      line += columns[column].is_number ? padding + row[column] : row[column] + padding;
    }
    line.erase(line.find_last_not_of(' ') + 1);
    lines.push_back(fitted(line, width));
  }
  return lines;
}

std::vector<std::string> run_lines(const json& run, std::size_t width) {
  std::vector<std::string> lines;
  const double goal = number(run, "env_frames_goal"), frames = whole(run, "env_frames");
  std::string head = fmt::format("{}: {} for {} on {} (pid {})", text(run, "run"), text(run, "state"),
                                 duration_text(whole(run, "elapsed_s")), text(run, "host"),
                                 static_cast<int64_t>(whole(run, "pid")));
  lines.push_back(head);
  std::string work = "  " + count_text(frames);
  if (goal > 0) work += "/" + count_text(goal) + formatted(" env frames (%.1f%%)", 100 * frames / goal);
  work += formatted(" | %.0f env frames/s", whole(run, "env_frames_per_s")) +
          formatted(", %.0f decisions/s", whole(run, "decisions_per_s"));
  if (const double score = number(run, "J_mean"); std::isfinite(score)) work += " | J " + score_text(score);
  if (const double lag = number(run, "policy_lag_mean"); std::isfinite(lag))
    work += formatted(" | lag %.1f", lag) + formatted(" (max %.0f)", whole(run, "policy_lag_max"));
  if (const double filled = number(run, "replay_filled"); filled < 1)
    work += formatted(" | replay %.0f%% filled", 100 * filled);
  lines.push_back(work);
  const json& slabs = part(run, "slabs");
  if (!slabs.empty())
    lines.push_back("  trajectories: " + count(slabs, "filling") + " being filled, " +
                    count(slabs, "sealed") + " wait for the learner, " + count(slabs, "learning") +
                    " in it, " + count(slabs, "free") + " free (credits) | restarts " +
                    count(run, "restarts"));
  const json& account = part(run, "decisions_account");
  std::string decisions =
      "  decisions: " + count(account, "made") + " made, " + count(account, "trained") + " trained on";
  for (const auto& [key, words] :
       {std::pair{"forgotten", "forgotten"}, std::pair{"lost_with_simulators", "lost with simulators"},
        std::pair{"lost_with_learners", "lost with the learner"},
        std::pair{"lost_in_restarts", "lost in restarts"}, std::pair{"lost_on_the_way", "lost on the way"}})
    if (whole(account, key) > 0)
      decisions += fmt::format(", {} {}", static_cast<int64_t>(whole(account, key)), words);
  if (!account.empty()) lines.push_back(decisions + ", " + count(account, "waiting") + " on their way");
  const json& checkpoint = part(run, "checkpoint");
  std::string saved =
      "  checkpoint: " + (text(checkpoint, "path").empty() ? "none yet" : text(checkpoint, "path"));
  if (const double failed = whole(checkpoint, "failed"); failed > 0)
    saved += formatted(", %.0f could not be written", failed);
  lines.push_back(saved);
  if (const json& episodes = part(run, "last_episodes"); !episodes.empty()) {
    const json& last = episodes.back();
    lines.push_back("  episodes: " + count(run, "episodes_heard") + " heard, the last with J " +
                    score_text(whole(last, "J")) + formatted(" in %.0f tics", whole(last, "length_tics")));
  }
  if (const std::string silence = text(run, "silence"); !silence.empty()) lines.push_back("  " + silence);
  for (std::string& line : lines) line = fitted(line, width);
  return lines;
}

std::vector<std::string> host_table(const json& run, std::size_t width) {
  const std::vector<TableColumn> columns = {{"HOST", 9, false},  {"WORKERS", 5}, {"DECISIONS/S", 8},
                                            {"ENV FRAMES/S", 4}, {"CREDITS", 6}, {"RESTARTS", 7}};
  const double frames_each = whole(run, "env_frameskip");
  std::vector<std::vector<std::string>> rows;
  for (const json& host : part(run, "hosts")) {
    const double rate = whole(host, "decisions_per_s");
    rows.push_back({text(host, "host"), count(host, "workers"), formatted("%.0f", rate),
                    formatted("%.0f", rate * frames_each),
                    host.contains("credits") ? count(host, "credits") : "-", count(host, "restarts")});
  }
  return table_lines(columns, rows, width);
}

std::vector<std::string> worker_table(const json& run, std::size_t width) {
  const std::vector<TableColumn> columns = {
      {"WORKER", 9, false}, {"HOST", 2, false}, {"STATE", 8, false}, {"PID", 3}, {"DECISIONS/S", 7},
      {"BUSY", 6},          {"SILENT", 4},      {"RESTARTS", 5},     {"CPU", 1}, {"MEMORY", 1}};
  std::vector<std::vector<std::string>> rows;
  for (const json& worker : part(run, "workers")) {
    const double silent_s = whole(worker, "silent_s");
    rows.push_back({text(worker, "worker"), text(worker, "host"), text(worker, "state"),
                    std::to_string(static_cast<int64_t>(whole(worker, "pid"))),
                    formatted("%.0f", whole(worker, "decisions_per_s")),
                    formatted("%.0f%%", 100 * whole(worker, "busy")),
                    silent_s < 2 ? "-" : duration_text(silent_s), count(worker, "restarts"),
                    duration_text(whole(worker, "cpu_s")),
                    bytes_text(static_cast<int64_t>(whole(worker, "resident_bytes")))});
  }
  return table_lines(columns, rows, width);
}

}  // namespace comrad::deploy
