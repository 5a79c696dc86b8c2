#include "deploy/sweep/slurm_backend.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <span>
#include <sstream>

#include "deploy/process/child_program.h"
#include "deploy/sweep/report_step.h"
#include "deploy/sweep/sweep_table.h"
#include "rollout_buffer/core/checksum.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

struct Submission {
  int number = 0;
  std::vector<std::string> runs;
};

std::string records(const SweepFolder& folder, int number, const std::string& ending) {
  return fmt::format("{}/records/slurm_{}{}", folder.path(), number, ending);
}

/// Every submission of the folder, by number. One whose sbatch failed, or was never asked, has no job of its name.
std::vector<Submission> submissions(const SweepFolder& folder) {
  std::vector<Submission> found;
  for (int number = 1; const std::optional<std::string> text = read_file(records(folder, number, ".json"));
       ++number) {
    Submission one{number, {}};
    const ordered_json json = ordered_json::parse(*text, nullptr, false);
    if (json.is_object() && json.contains("runs") && json["runs"].is_array())
      for (const ordered_json& run : json["runs"])
        if (run.is_string()) one.runs.push_back(run.get<std::string>());
    found.push_back(std::move(one));
  }
  return found;
}

std::string report_name(const std::string& job_name) { return job_name + ".report"; }

/// Runs a program of Slurm. Errors: kNotFound, kSystem in its words.
Expected<std::string> ask(const std::vector<std::string>& command) {
  const Expected<ProgramResult> done = run_program(command, {.timeout_s = 120});
  if (!done) return Error{done.error().code, done.error().message + "; is this a host of a Slurm cluster?"};
  if (done->exit_code != 0) return Error{ErrorCode::kSystem, command[0] + ": " + last_words(*done)};
  return done->output;
}

/// The lines of "#SBATCH" that array and report share.
std::string shared_lines(const SweepPlan& plan, const std::string& job_name, const std::string& output) {
  const SlurmOptions& slurm = plan.file.slurm;
  std::string text = "#!/bin/bash\n#SBATCH --job-name=" + job_name + "\n#SBATCH --output=\"" + output +
                     "\"\n#SBATCH --open-mode=append\n#SBATCH --nodes=1\n#SBATCH --ntasks=1\n";
  for (const auto& [flag, value] : {std::pair("partition", slurm.partition),
                                    std::pair("account", slurm.account), std::pair("qos", slurm.qos)})
    if (!value.empty()) text += "#SBATCH --" + std::string(flag) + "=" + value + "\n";
  return text;
}

std::string setup_lines(const SweepPlan& plan) {
  std::string text;
  for (const std::string& line : plan.file.slurm.setup) text += line + "\n";
  return text;
}

/// The jobs of these names that Slurm has: "%i|%T" lines.
Expected<std::string> squeue(const std::vector<std::string>& names, const std::string& format) {
  return ask({"squeue", "--noheader", "--array", "--name=" + joined(names, ","), "--format=" + format});
}

std::vector<std::string> job_names(const SweepFolder& folder, const std::vector<Submission>& all) {
  std::vector<std::string> names;
  for (const Submission& one : all) names.push_back(slurm_job_name(folder, one.number));
  return names;
}

/// "123" of "123;cluster\n".
std::string job_id_in(const std::string& output) {
  return std::string(trimmed(output.substr(0, output.find_first_of(";\n"))));
}

}  // namespace

std::string slurm_job_name(const SweepFolder& folder, int number) {
  char mark[16];
  std::snprintf(mark, sizeof mark, "%08x",
                static_cast<unsigned>(checksum64(std::as_bytes(std::span(folder.path())))));
  return fmt::format("{}.{}.{}", folder.name(), number, mark);
}

std::string slurm_script(const SweepPlan& plan, const SweepFolder& folder, int number,
                         const std::vector<std::string>& runs, const std::string& program) {
  const SlurmOptions& slurm = plan.file.slurm;
  const std::string throttle = slurm.at_once > 0 ? fmt::format("%{}", slurm.at_once) : "";
  const double mebibytes = std::ceil(plan.file.resources.memory_gb * 1e9 / (1 << 20));
  std::string text = shared_lines(plan, slurm_job_name(folder, number), records(folder, number, "_%a.log"));
  const auto add = [&text](const std::string& option) { text += "#SBATCH " + option + "\n"; };
  add(fmt::format("--array=0-{}{}", runs.size() - 1, throttle));
  add(fmt::format("--cpus-per-task={}", plan.cores));
  add(fmt::format("--mem={}M", static_cast<int64_t>(mebibytes)));
  if (!slurm.gres.empty())
    add("--gres=" + slurm.gres);
  else if (plan.file.resources.gpus > 0)
    add(fmt::format("--gres=gpu:{}", plan.file.resources.gpus));
  if (!slurm.time.empty()) add("--time=" + slurm.time);
  add("--requeue");
  add(fmt::format("--signal=B:USR1@{}", slurm.signal_before_s));  // the run saves, stops and is queued again
  for (const std::string& option : slurm.options) add(option);
  text += setup_lines(plan) + "runs=(\n";
  for (const std::string& run : runs) text += "  " + run + "\n";
  // exec: the signal goes to the batch shell's process alone.
  return text + ")\nexec " + shell_word(program) + " sweep element " + shell_word(folder.path()) +
         " \"${runs[SLURM_ARRAY_TASK_ID]}\"\n";
}

std::string slurm_report_script(const SweepPlan& plan, const SweepFolder& folder, int number,
                                const std::string& array) {
  return shared_lines(plan, report_name(slurm_job_name(folder, number)),
                      folder.path() + "/records/report.log") +
         "#SBATCH --cpus-per-task=1\n#SBATCH --mem=2G\n#SBATCH --dependency=afterany:" + array + "\n" +
         setup_lines(plan) + report_lines(folder, plan.file.report);
}

std::string slurm_dry_run(const SweepPlan& plan, const std::string& program) {
  const SweepFolder folder = SweepFolder::planned(plan);
  const int number = static_cast<int>(submissions(folder).size()) + 1;
  std::vector<std::string> runs;
  for (const SweepRun& run : plan.runs) runs.push_back(run.name);
  std::string text =
      "# " + records(folder, number, ".sh") + "\n" + slurm_script(plan, folder, number, runs, program);
  if (!plan.file.report.empty())
    text += "\n# " + records(folder, number, "_report.sh") + "\n" +
            slurm_report_script(plan, folder, number, "<the array's job>");
  return text;
}

QueuedElements parse_queue(const std::string& text,
                           const std::vector<std::pair<std::string, std::vector<std::string>>>& runs_of_job) {
  static const std::set<std::string> kPending = {"PENDING",      "REQUEUED",     "REQUEUE_FED",
                                                 "REQUEUE_HOLD", "SPECIAL_EXIT", "RESV_DEL_HOLD",
                                                 "SUSPENDED",    "STOPPED"};
  static const std::set<std::string> kRunning = {"RUNNING", "CONFIGURING", "RESIZING", "SIGNALING",
                                                 "STAGE_OUT"};
  QueuedElements queued;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    const std::size_t first = line.find('|'), second = line.find('|', first + 1);
    if (first == std::string::npos || second == std::string::npos) continue;
    const std::string name = line.substr(0, first), index_text = line.substr(first + 1, second - first - 1),
                      state(trimmed(std::string_view(line).substr(second + 1)));
    const auto job =
        std::ranges::find(runs_of_job, name, &std::pair<std::string, std::vector<std::string>>::first);
    char* end = nullptr;
    const unsigned long index = std::strtoul(index_text.c_str(), &end, 10);
    if (job == runs_of_job.end() || index_text.empty() || *end != '\0' || index >= job->second.size())
      continue;
    if (kPending.contains(state)) queued.pending_runs.insert(job->second[index]);
    if (kRunning.contains(state)) queued.running_runs.insert(job->second[index]);
  }
  return queued;
}

Expected<QueuedElements> queued_elements(const SweepFolder& folder) {
  const std::vector<Submission> all = submissions(folder);
  if (all.empty()) return QueuedElements{};
  std::vector<std::pair<std::string, std::vector<std::string>>> runs_of_job;
  for (const Submission& one : all) runs_of_job.emplace_back(slurm_job_name(folder, one.number), one.runs);
  COMRAD_TRY_ASSIGN(const std::string text, squeue(job_names(folder, all), "%j|%K|%T"));
  return parse_queue(text, runs_of_job);
}

Expected<int> run_slurm(const SweepPlan& plan, const SweepFolder& folder, const std::string& program) {
  COMRAD_TRY_ASSIGN(const QueuedElements queued, queued_elements(folder));
  const std::vector<RunView> views = folder.look(queued);
  std::vector<std::string> runs;
  for (const RunView& view : views)
    if (view.is_to_do()) runs.push_back(view.name);
  if (runs.empty()) {
    std::fprintf(stderr, "nothing to submit: %s\n", sweep_line(views).c_str());
    return kExitDone;
  }
  const int number = static_cast<int>(submissions(folder).size()) + 1;
  const std::string script = records(folder, number, ".sh");
  COMRAD_TRY(
      write_file_atomically(script, slurm_script(plan, folder, number, runs, program), /*durable=*/true));
  COMRAD_TRY(write_file_atomically(records(folder, number, ".json"),
                                   ordered_json{{"runs", runs}}.dump(2) + "\n",
                                   /*durable=*/true));
  COMRAD_TRY_ASSIGN(const std::string answer, ask({"sbatch", "--parsable", script}));
  const std::string job = job_id_in(answer);
  std::fprintf(stderr, "job array %s: %zu runs (%s)\n", job.c_str(), runs.size(), script.c_str());
  if (!plan.file.report.empty()) {
    const std::string report = records(folder, number, "_report.sh");
    COMRAD_TRY(
        write_file_atomically(report, slurm_report_script(plan, folder, number, job), /*durable=*/true));
    COMRAD_TRY_ASSIGN(const std::string report_answer, ask({"sbatch", "--parsable", report}));
    std::fprintf(stderr, "job %s: the report, when all of them have ended\n",
                 job_id_in(report_answer).c_str());
  }
  return kExitDone;
}

Expected<int> stop_slurm(const SweepFolder& folder) {
  const std::vector<Submission> all = submissions(folder);
  if (all.empty()) return 0;
  std::vector<std::string> names = job_names(folder, all), reports;
  for (const std::string& name : names) reports.push_back(report_name(name));
  const auto jobs_of = [](const std::vector<std::string>& of) -> Expected<std::vector<std::string>> {
    COMRAD_TRY_ASSIGN(const std::string text, squeue(of, "%F"));
    std::set<std::string> ids;
    std::istringstream lines(text);
    for (std::string id; lines >> id;) ids.insert(id);
    return std::vector<std::string>(ids.begin(), ids.end());
  };
  const auto cancel = [](std::vector<std::string> flags, const std::vector<std::string>& jobs) -> Status {
    if (jobs.empty()) return {};
    flags.insert(flags.begin(), "scancel");
    flags.insert(flags.end(), jobs.begin(), jobs.end());
    COMRAD_TRY(ask(flags));
    return {};
  };
  COMRAD_TRY_ASSIGN(const std::vector<std::string> waiting_reports, jobs_of(reports));
  COMRAD_TRY(cancel({}, waiting_reports));  // before what they wait for ends
  COMRAD_TRY_ASSIGN(const std::vector<std::string> jobs, jobs_of(names));
  COMRAD_TRY(cancel({"--state=PENDING"}, jobs));
  COMRAD_TRY(cancel({"--state=RUNNING", "--batch", "--signal=TERM"}, jobs));
  return static_cast<int>(jobs.size());
}

}  // namespace comrad::deploy
