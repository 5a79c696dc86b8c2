// `comrad pack-policies` and `comrad fetch-policies`: kept policies as one archive, and back. Both become deploy/report/policies.py.

#include <string>
#include <vector>

#include "deploy/process/child_program.h"
#include "deploy/process/python_program.h"
#include "deploy/run/command.h"
#include "deploy/settings/command_line.h"
#include "deploy/settings/output_check.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::deploy {
namespace {

Expected<int> become(std::vector<std::string> words, const std::vector<std::string>& more) {
  COMRAD_TRY_ASSIGN(const std::string python, python_that_imports("tomllib", "install Python 3.11 or later"));
  words.insert(words.end(), more.begin(), more.end());
  return replace_process(python_command(python, "deploy/report/policies.py", words));
}

}  // namespace

int pack_policies_command(Arguments arguments) {
  std::vector<std::string> sweeps;
  std::string output;
  CommandLine line(
      "pack-policies SWEEP... --output FILE.tar.xz",
      "Puts the best checkpoint of each scenario, the winner of the evaluations that finished\n"
      "sweeps kept ([results]), into one archive of 40 MB at most, with their SHA-256. Weights are\n"
      "rounded to 7 significant bits. SWEEP is a sweep's folder, train_dir/<name>.");
  line.add_words("SWEEP", sweeps, "folders of sweeps");
  line.add_option("output", output, "FILE", "the archive: .tar.xz");
  return run_command("pack-policies", line, arguments, [&]() -> Expected<int> {
    if (sweeps.empty() || output.empty())
      return Error{ErrorCode::kBadInput,
                   "name sweeps and the archive: comrad pack-policies SWEEP... --output FILE.tar.xz"};
    COMRAD_TRY_ASSIGN(const std::string file, check_output_file("output", output, {".tar.xz"}));
    return become({"pack", "--learner", sibling_program("comrad-learner"), "--output", file}, sweeps);
  });
}

int fetch_policies_command(Arguments arguments) {
  std::vector<std::string> names;
  std::string train_dir = RunSettings().train_dir;
  CommandLine line(
      "fetch-policies [SCENARIO...]",
      "Checks the kept policies of these scenarios (all) and puts each into a run directory,\n"
      "<train_dir>/policy_<scenario>, for eval, watch and play: --policy policy_armory_siege. They come\n"
      "from COMRAD_POLICIES, the archive of a release or the folder where it was unpacked; without it\n"
      "they are the few that lie beside the scenarios.");
  line.add_words("SCENARIO", names, "scenarios whose policies to fetch");
  line.add_option("train_dir", train_dir, "DIR", "folder that holds the runs (default train_dir)");
  return run_command("fetch-policies", line, arguments, [&] {
    return become({"fetch", "--train_dir", train_dir, "--"}, names);
  });
}

}  // namespace comrad::deploy
