// `comrad plot`: finds the runs and hands them to deploy/report/plot.py, with a Python that has matplotlib.

#include <algorithm>
#include <cstdio>
#include <filesystem>

#include "deploy/process/child_program.h"
#include "deploy/process/python_program.h"
#include "deploy/run/command.h"
#include "deploy/settings/command_line.h"
#include "deploy/settings/existing_run.h"
#include "deploy/settings/output_check.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;

constexpr double kDrawingTimeoutS = 300;

struct PlotOptions {
  std::vector<std::string> runs;
  std::string output = "curves.png";
  std::string metric, x = "env_frames", title, baseline;
  std::string train_dir = RunSettings().train_dir;
  bool over_seeds = false;
};

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  for (std::size_t begin = 0, end; begin <= text.size(); begin = end + 1) {
    end = std::min(text.find(separator, begin), text.size());
    if (end > begin) parts.push_back(text.substr(begin, end - begin));
  }
  return parts;
}

/// A run's folder, or one that may hold runs, as a sweep's. Errors: those of find_run().
Expected<std::string> find_runs(const std::string& name, const std::string& train_dir) {
  Expected<std::string> run = find_run(name, train_dir);
  std::error_code ignored;
  for (const fs::path& folder : {fs::path(name), fs::path(train_dir) / name})
    if (!run && fs::is_directory(folder, ignored)) return folder.string();
  return run;
}

/// The words of one argument for the script: a run, a folder of runs, or NAME=RUN,RUN.
Expected<std::vector<std::string>> curve_words(const std::string& word, const std::string& train_dir) {
  if (const Expected<std::string> run = find_run(word, train_dir))
    return std::vector<std::string>{"--curve", fs::path(*run).filename().string(), *run};
  if (const Expected<std::string> folder = find_runs(word, train_dir))
    return std::vector<std::string>{"--folder", *folder};
  const std::size_t equals = word.find('=');
  const std::string runs = equals == std::string::npos ? word : word.substr(equals + 1);
  std::vector<std::string> words = {"--curve", word.substr(0, equals)};
  for (const std::string& name : split(runs, ',')) {
    COMRAD_TRY_ASSIGN(std::string run, find_runs(name, train_dir));
    words.push_back(std::move(run));
  }
  if (words.size() < 3) return Error{ErrorCode::kBadInput, word + " names no run; write RUN or NAME=RUN,RUN"};
  return words;
}

Expected<int> plot(const PlotOptions& options) {
  if (options.runs.empty()) return Error{ErrorCode::kBadInput, "name a run: comrad plot RUN..."};
  if (options.x != "env_frames" && options.x != "time_s")
    return Error{ErrorCode::kBadInput, "--x: " + unknown_word("axis", options.x, {"env_frames", "time_s"})};
  COMRAD_TRY_ASSIGN(const std::string output,
                    check_output_file("output", options.output, {".png", ".svg", ".pdf"}));
  std::vector<std::string> words = {"--output", output, "--x", options.x};
  for (const auto& [flag, value] :
       {std::pair{"--metric", options.metric}, std::pair{"--title", options.title}})
    if (!value.empty()) words.insert(words.end(), {flag, value});
  for (const std::string& baseline : split(options.baseline, ','))
    words.insert(words.end(), {"--baseline", baseline});
  if (options.over_seeds) words.emplace_back("--over_seeds");
  for (const std::string& run : options.runs) {
    COMRAD_TRY_ASSIGN(const std::vector<std::string> curve, curve_words(run, options.train_dir));
    words.insert(words.end(), curve.begin(), curve.end());
  }
  COMRAD_TRY_ASSIGN(const std::string python, python_that_imports(kReportModules));
  COMRAD_TRY_ASSIGN(const ProgramResult drawn,
                    run_program(python_command(python, "deploy/report/plot.py", words),
                                {.timeout_s = kDrawingTimeoutS, .echo_stderr = true}));
  if (drawn.exit_code != 0) return drawn.exit_code;
  std::printf("%s\n", output.c_str());
  return kExitDone;
}

}  // namespace

int plot_command(Arguments arguments) {
  PlotOptions options;
  CommandLine line(
      "plot RUN|FOLDER... [-o FILE] [--over_seeds]",
      "Draws learning curves as PNG, SVG or PDF: score J over env frames, and the evaluations of runs that\n"
      "have them. RUN is a run directory, an experiment below --train_dir, or several under one name,\n"
      "NAME=RUN,RUN,RUN: each is drawn thinly, and their mean, from four runs on with its 95% interval over\n"
      "the runs (Student t). Of a FOLDER with runs, as a sweep's, those that differ in their seed alone "
      "become\n"
      "one curve. Where all play one scenario on its default map, lines show the scores of "
      "random\n"
      "play and of the scripted team. A run in which no episode has ended yet is named and left out.");
  line.add_words("RUN", options.runs, "runs to draw, each a curve, or folders of runs");
  line.add_option("output", options.output, "FILE",
                  "the picture: .png, .svg or .pdf (default curves.png; also -o)");
  line.add_switch("over_seeds", options.over_seeds, "runs that differ in their seed alone become one curve");
  line.add_option("metric", options.metric, "NAME",
                  "another number of metrics.jsonl, for example train/entropy (learner/METRICS.md)");
  line.add_option("x", options.x, "WORD", "env_frames or time_s (default env_frames)");
  line.add_option("baseline", options.baseline, "NAME=VALUE,...", "dashed lines, for example random=649");
  line.add_option("title", options.title, "TEXT", "above the picture");
  line.add_option("train_dir", options.train_dir, "DIR", "folder that holds the runs (default train_dir)");
  std::vector<std::string> words(arguments.begin(), arguments.end());
  std::ranges::replace(words, std::string("-o"), std::string("--output"));
  return run_command("plot", line, words, [&] { return plot(options); });
}

}  // namespace comrad::deploy
