#include "deploy/bench/bench_report.h"

#include <spdlog/fmt/fmt.h>

#include <cstdio>
#include <ctime>
#include <fstream>
#include <iterator>
#include <sstream>
#include <thread>

#include "deploy/bench/bench_table.h"
#include "deploy/process/child_program.h"
#include "rollout_buffer/core/cores.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

using nlohmann::ordered_json;

std::string output_of(const std::vector<std::string>& command) {
  const Expected<ProgramResult> result = run_program(command, {.timeout_s = 20});
  return result && result->exit_code == 0 ? std::string(trimmed(result->output)) : "";
}

std::string command_of(const ordered_json& bench) {
  const std::string name = bench["bench"];
  if (bench["scenario"] == "none") return "./comrad bench " + name;
  std::string command = "./comrad bench " + name + " --scenario " + bench["scenario"].get<std::string>();
  if (name == "learner" || name == "train")
    command += " --algo " + (bench.contains("algorithms") ? "all" : bench["algo"].get<std::string>());
  if (bench.contains("precision")) command += " --precision " + bench["precision"].get<std::string>();
  return command;
}

std::string row(const std::vector<std::string>& cells) { return "| " + joined(cells, " | ") + " |\n"; }

std::string table(const std::vector<std::string>& heads, const std::string& rows) {
  return "\n" + row(heads) + row(std::vector<std::string>(heads.size(), "---")) + rows;
}

/// A table of the objects in an array, with their own keys as heads.
std::string table_of(const ordered_json& objects) {
  std::vector<std::string> heads;
  for (const auto& [key, value] : objects.front().items()) heads.push_back(key);
  std::string rows;
  for (const ordered_json& object : objects) {
    std::vector<std::string> cells;
    for (const std::string& head : heads)
      cells.push_back(object.contains(head) ? bench_cell(object[head]) : "");
    rows += row(cells);
  }
  return table(heads, rows);
}

}  // namespace

std::string machine_text(const std::string& cpuinfo, int usable_cores) {
  std::istringstream lines(cpuinfo);
  std::string model = "unknown processor", features;
  int count = 0;
  for (std::string line; std::getline(lines, line);) {
    const std::size_t colon = line.find(':');
    if (colon == std::string::npos) continue;
    const std::string key(trimmed(line.substr(0, colon))), value(trimmed(line.substr(colon + 1)));
    if (key == "processor") ++count;
    if (key == "model name") model = value;
    if (key == "flags") features = " " + value + " ";
  }
  std::string text = fmt::format("{}, {} of {} cores", model, usable_cores, count);
  for (const auto& [flag, name] : {std::pair{"avx2", "AVX2"}, std::pair{"avx512f", "AVX-512"},
                                   std::pair{"avx512_bf16", "AVX-512 BF16"}, std::pair{"amx_bf16", "AMX"}})
    if (features.find(" " + std::string(flag) + " ") != std::string::npos) text += std::string(", ") + name;
  return text;
}

BenchOrigin bench_origin() {
  // The checkout that this build was made from: build folders lie in it.
  const std::string folder = build_folder();
  BenchOrigin origin{
      .commit = output_of({"git", "-C", folder, "rev-parse", "--short", "HEAD"}), .machine = {}, .date = {}};
  if (origin.commit.empty())
    origin.commit = "unknown";
  else if (!output_of({"git", "-C", folder, "status", "--porcelain", "--untracked-files=no"}).empty())
    origin.commit += "+changes";
  std::ifstream cpuinfo("/proc/cpuinfo");
  origin.machine = machine_text({std::istreambuf_iterator<char>(cpuinfo), {}}, usable_cores());
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  char date[16];
  std::strftime(date, sizeof date, "%Y-%m-%d", &utc);
  origin.date = date;
  return origin;
}

Expected<std::vector<ordered_json>> measure_everything(const BenchRequest& request) {
  std::vector<ordered_json> all;
  const auto tell = [&](const std::string& what) {
    if (!request.is_quiet) std::fprintf(stderr, "comrad bench report: %s\n", what.c_str());
  };
  for (const char* what : {"engine", "render", "sim", "inference"}) {
    tell(what);
    COMRAD_TRY_ASSIGN(ordered_json one, measure_bench({what, request.user, request.seconds, true}));
    all.push_back(std::move(one));
  }
  tell("learner, all algorithms");
  COMRAD_TRY_ASSIGN(ordered_json learner,
                    measure_all_algorithms({"learner", request.user, request.seconds, true}));
  all.push_back(std::move(learner));
  for (const char* program : {"transport", "replay"}) {
    tell(program);
    COMRAD_TRY_ASSIGN(ordered_json one, measure_with_program({std::string("comrad-bench-") + program,
                                                              "--seconds", std::to_string(request.seconds)},
                                                             8 * request.seconds));
    all.push_back(std::move(one));
  }
  for (const char* precision : {"fp32", "bf16"}) {
    tell(std::string("train, ") + precision);
    COMRAD_TRY_ASSIGN(
        ordered_json one,
        measure_bench({"train", user_with(request.user, {{"precision", precision}}), request.seconds, true}));
    all.push_back(std::move(one));
  }
  return all;
}

std::string report_tables(const std::vector<ordered_json>& benches, const BenchOrigin& origin) {
  std::string rows, rest;
  for (const ordered_json& bench : benches) {
    rows += row({bench["bench"], "`" + command_of(bench) + "`", bench_cell(bench["decisions_per_s"]),
                 bench_cell(bench["env_frames_per_s"]),
                 bench.contains("spread") ? bench_cell(bench["spread"]) : ""});
    const std::string name =
        bench["bench"].get<std::string>() +
        (bench.contains("precision") ? ", " + bench["precision"].get<std::string>() : "");
    for (const char* key : {"batches", "algorithms"})
      if (bench.contains(key)) rest += "\n`" + name + "`, " + key + ":\n" + table_of(bench[key]);
    if (bench.contains("round_trip_us"))
      rest += "\n`" + name + "`, microseconds from commit to answer:\n" +
              table_of(ordered_json::array({bench["round_trip_us"]}));
    if (bench.contains("bottleneck"))
      rest += "\n`" + name + "`, processor seconds for 1 000 decisions:\n" +
              table_of(ordered_json::array({bench["cpu_seconds_per_1000_decisions"]})) + "\n" +
              bench["bottleneck"].get<std::string>() +
              " Bytes copied a decision: " + bench_cell(bench["bytes_copied_per_decision"]) +
              ". Cores busy: " + bench_cell(bench["cores_busy"]) + ".\n";
  }
  return "`comrad bench report` wrote this on " + origin.date + " at commit " + origin.commit + " on " +
         origin.machine + ": medians of windows; the spread is their range over the median.\n" +
         table({"bench", "command", "decisions/s", "env frames/s", "spread"}, rows) + rest;
}

Expected<std::string> with_tables(const std::string& text, const std::string& tables) {
  const std::size_t begin = text.find(kReportBegin), end = text.find(kReportEnd);
  const auto bad = [](const std::string& what) { return Error{ErrorCode::kBadFormat, what}; };
  if (begin == std::string::npos) return bad("there is no line " + kReportBegin);
  if (end == std::string::npos) return bad("there is no line " + kReportEnd);
  if (end < begin) return bad(kReportEnd + " stands before " + kReportBegin);
  if (text.find(kReportBegin, begin + 1) != std::string::npos ||
      text.find(kReportEnd, end + 1) != std::string::npos)
    return bad("a mark of comrad bench report stands there twice");
  return text.substr(0, begin) + kReportBegin + "\n" + tables + text.substr(end);
}

}  // namespace comrad::deploy
