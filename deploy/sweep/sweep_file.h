// The one file that states what a sweep is: which runs, with which settings, how many at once and where. Reading it checks
// every key and every value by itself; sweep_plan.h checks what they make together. Stage: before a run.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "deploy/sweep/search_space.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/settings_layer.h"

namespace comrad::deploy {

/// One setting and the values that the sweep gives it, in the order of the file.
struct SweepAxis {
  std::string setting;              ///< canonical name
  std::vector<std::string> values;  ///< as config.toml has them
  std::vector<int> lines;           ///< of each value in the file, from 1
  int line = 0;
};

/// Runs that are left out: those that have one of the values of every setting named here.
struct SweepExclusion {
  std::vector<SweepAxis> settings;
  int line = 0;
};

/// Settings of the runs that have one of the values of every axis named in `when`; they replace those of [settings].
struct SweepOverride {
  std::vector<SweepAxis> when;
  SettingValues values;
  int line = 0;
};

/// What one run gets.
struct SweepResources {
  int64_t cores = 0;     ///< 0: the machine's, shared evenly by the runs that run at once
  double memory_gb = 4;  ///< 1e9 bytes
  int64_t gpus = 0;
};

struct SlurmOptions {
  std::string partition, account, qos;  ///< empty: the cluster's own
  std::string gres;                     ///< empty: gpu:<gpus> where a run has any
  std::string time;                     ///< as sbatch --time takes it; empty: the partition's
  int64_t signal_before_s = 180;     ///< so long before the time limit a run saves, stops and is queued again
  int64_t at_once = 0;               ///< elements of the array that may run; 0: no limit
  std::vector<std::string> setup;    ///< lines of the batch script before the run
  std::vector<std::string> options;  ///< further words for #SBATCH, "--constraint=v100"
};

/// Where what a run gave is kept as small text files, and how it is evaluated for that.
struct SweepResults {
  std::string folder;      ///< empty: nothing is kept
  int64_t episodes = 100;  ///< of the evaluation of a finished run
  int64_t seed = 5000;     ///< of the evaluation
  bool greedy = false;     ///< most probable actions instead of drawn ones
};

enum class SweepBackend { kLocal, kSlurm };

struct SweepFile {
  std::string path;
  std::string name;
  std::string train_dir = "train_dir";  ///< the sweep's folder is <train_dir>/<name>
  SweepBackend backend = SweepBackend::kLocal;
  std::string report;  ///< shell command to run when all runs have ended, in the sweep's folder; empty: none
  std::vector<SweepAxis> axes;       ///< none: a search alone
  SettingsLayer settings;            ///< what all runs share
  std::map<std::string, int> lines;  ///< of every setting that the file names
  std::vector<SweepExclusion> exclusions;
  std::vector<SweepOverride> overrides;  ///< in the order of the file; a later one wins
  SweepResources resources;
  SweepResults results;
  SweepSearch search;
  int64_t local_at_once = 1;
  SlurmOptions slurm;

  /// "study.toml:12: ", for messages.
  std::string at(int line) const { return path + ":" + std::to_string(line) + ": "; }
};

/// Reads `text`, the contents of the file called `path`. Errors: kBadFormat where it is no TOML; kBadInput as "path:line:
/// what" for an unknown key (with the nearest known one), a value that cannot be used, a setting or value named twice.
Expected<SweepFile> parse_sweep_file(const std::string& text, const std::string& path);

/// Reads the file. Errors: those of read_short_file and parse_sweep_file.
Expected<SweepFile> read_sweep_file(const std::string& path);

}  // namespace comrad::deploy
