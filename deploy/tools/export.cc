// `comrad export`: finds the runs and hands them to deploy/report/export.py, with a Python that has wandb where that is asked.

#include <algorithm>
#include <cstdio>
#include <filesystem>

#include "deploy/process/child_program.h"
#include "deploy/process/python_program.h"
#include "deploy/run/command.h"
#include "deploy/settings/command_line.h"
#include "deploy/settings/existing_run.h"
#include "deploy/settings/output_check.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;

struct ExportOptions {
  std::vector<std::string> runs;
  std::string csv, wandb, project = "comrad";
  std::string train_dir = RunSettings().train_dir;
};

/// The runs that a word means: one, or all that lie in a folder, as a sweep's.
Expected<std::vector<std::string>> runs_of(const std::string& word, const std::string& train_dir) {
  const Expected<std::string> run = find_run(word, train_dir);
  if (run) return std::vector<std::string>{*run};
  std::error_code ignored;
  for (const fs::path& folder : {fs::path(word), fs::path(train_dir) / word}) {
    std::vector<std::string> runs;
    for (const auto& entry : fs::directory_iterator(folder, ignored))
      if (fs::is_regular_file(entry.path() / "config.toml", ignored))
        runs.push_back(fs::absolute(entry.path(), ignored).lexically_normal().string());
    std::ranges::sort(runs);
    if (!runs.empty()) return runs;
  }
  return run.error();
}

Expected<int> export_runs(const ExportOptions& options) {
  if (options.runs.empty()) return Error{ErrorCode::kBadInput, "name a run: comrad export RUN... --csv FILE"};
  if (options.csv.empty() == options.wandb.empty())
    return Error{ErrorCode::kBadInput, "say where to: --csv FILE or --wandb FOLDER"};
  std::vector<std::string> words;
  if (!options.csv.empty()) {
    COMRAD_TRY_ASSIGN(const std::string file, check_output_file("csv", options.csv, {".csv"}));
    words.insert(words.end(), {"--csv", file});
  } else {
    std::error_code ignored;
    const std::string folder = fs::absolute(options.wandb, ignored).lexically_normal().string();
    if (fs::exists(folder, ignored) && !fs::is_directory(folder, ignored))
      return bad_value("wandb", options.wandb, "it is a file; name a folder");
    words.insert(words.end(), {"--wandb", folder, "--project", options.project});
  }
  for (const std::string& word : options.runs) {
    COMRAD_TRY_ASSIGN(const std::vector<std::string> runs, runs_of(word, options.train_dir));
    words.insert(words.end(), runs.begin(), runs.end());
  }
  std::string python;
  if (options.csv.empty()) {
    COMRAD_TRY_ASSIGN(
        python, python_that_imports("tomllib, wandb",
                                    "install it into a Python environment (python3 -m venv ENV; ENV/bin/pip "
                                    "install wandb) and start comrad with it active (. ENV/bin/activate)"));
  } else {
    COMRAD_TRY_ASSIGN(python, python_that_imports("tomllib", "install Python 3.11 or later"));
  }
  return replace_process(python_command(python, "deploy/report/export.py", words));
}

}  // namespace

int export_command(Arguments arguments) {
  ExportOptions options;
  CommandLine line(
      "export RUN... (--csv FILE | --wandb FOLDER)",
      "Hands what runs reported to other programs. --csv: one table for all, one row a report, with\n"
      "run, scenario, algo and seed before the numbers (learner/METRICS.md). --wandb: offline runs of\n"
      "Weights & Biases, made by its own Python package, which `wandb sync FOLDER` uploads. RUN is a run\n"
      "directory, an experiment below --train_dir, or a folder that holds runs, as a sweep's.");
  line.add_words("RUN", options.runs, "runs to export");
  line.add_option("csv", options.csv, "FILE", "the table: .csv");
  line.add_option("wandb", options.wandb, "FOLDER", "where wandb makes its folder wandb/");
  line.add_option("project", options.project, "NAME", "project of the W&B runs (default comrad)");
  line.add_option("train_dir", options.train_dir, "DIR", "folder that holds the runs (default train_dir)");
  return run_command("export", line, arguments, [&] { return export_runs(options); });
}

}  // namespace comrad::deploy
