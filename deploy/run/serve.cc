// `comrad serve RUN`: `comrad train --serve` by the run's name. A run that is at work and serves already prints how it is
// joined.

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>

#include "deploy/run/command.h"
#include "deploy/settings/existing_run.h"
#include "rollout_buffer/link/join/link_address.h"
#include "rollout_buffer/settings/layers.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;

/// Whether a supervisor holds the run's lock.
bool is_at_work(const std::string& run_dir) {
  const int lock = open((run_dir + "/.lock").c_str(), O_RDONLY | O_CLOEXEC);
  if (lock < 0) return false;
  const bool is_held = flock(lock, LOCK_SH | LOCK_NB) != 0;
  close(lock);
  return is_held;
}

/// Prints how other hosts join a run that is at work. Errors: kBadInput where it does not serve.
Expected<int> tell_address(const std::string& run_dir) {
  COMRAD_TRY_ASSIGN(const RunConfig config, load_run_config(run_dir + "/config.toml"));
  if (!config.hosts.serve)
    return Error{ErrorCode::kBadInput,
                 run_dir +
                     " is running without a join endpoint; its shared memory has no places "
                     "for other hosts. Stop it (Ctrl-C), and the same `comrad serve` continues "
                     "where it stopped, with a join endpoint"};
  COMRAD_TRY_ASSIGN(const link::LinkAddress address, link::kept_address(run_dir));
  std::fprintf(stderr, "%s is running and serves; other hosts join with:\n", run_dir.c_str());
  std::printf("comrad join %s\n", link::text_of(address).c_str());
  return kExitDone;
}

Expected<int> serve(const std::string& run, const CommandLine& line, Arguments arguments) {
  const RunConfig built_in;
  std::string train_dir = built_in.run.train_dir;
  for (const auto& [name, text] : line.typed().values)
    if (name == "train_dir") train_dir = text;
  std::string experiment = run;
  if (const Expected<std::string> found = find_run(run, train_dir)) {
    if (is_at_work(*found)) return tell_address(*found);
    std::error_code ignored;
    const fs::path folder = fs::absolute(*found, ignored).lexically_normal();
    experiment = folder.filename().string();
    train_dir = folder.parent_path().string();
  } else if (run.find('/') != std::string::npos) {
    return found.error();
  }
  std::vector<std::string> words(arguments.begin(), arguments.end());
  std::erase(words, run);
  words.insert(words.end(), {"--train_dir=" + train_dir, "--experiment=" + experiment, "--serve=True"});
  return train_command(words);
}

}  // namespace

int serve_command(Arguments arguments) {
  CommandLine line(
      "serve RUN [settings]",
      "Trains the run RUN, a folder or the name of an experiment, with a join endpoint: other hosts join "
      "with\n"
      "`comrad join` at any time, and leave. A run that was begun continues; another name begins a run, with "
      "the\n"
      "settings of `comrad train`. For a run that is at work it prints how other hosts join.\n"
      "Beyond loopback (--interface NAME) it needs keys, or --insecure_network.");
  std::string run;
  line.add_positional("RUN", run, "run folder, or experiment below --train_dir");
  std::string key_folder;  // read by train_command() again
  line.add_option("keys", key_folder, "FOLDER", "the run's keys, which `comrad keys` made, for a network");
  line.add_settings();
  if (const Status parsed = line.parse(arguments); !parsed) return report_error("serve", parsed.error());
  if (line.help_requested()) return print_settings_help("serve", line);
  const Expected<int> done = serve(run, line, arguments);
  return done ? *done : report_error("serve", done.error());
}

}  // namespace comrad::deploy
