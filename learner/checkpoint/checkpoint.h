// Everything a run needs to continue, as one file that Python's torch.load(path, weights_only=True) reads (PyTorch 2.0 or
// newer): a dict of sections ("network", "optimizer", "counters", ...), each a dict of tensors, integers, floats and
// texts. Files are written beside their place, fsynced and renamed, so that a crash never leaves half a
// checkpoint under its name.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::learn {

/// Raised whenever the sections or their meaning change; see Format history in learner/CHECKPOINTS.md.
constexpr int64_t kCheckpointVersion = 1;

/// Named values, keys spelled "section/name" ("network/encoder.conv1.weight", "counters/env_frames").
class StateDict {
 public:
  using Value = std::variant<torch::Tensor, int64_t, double, std::string>;

  /// Tensors are copied to the CPU, so that later training does not change them.
  void put(const std::string& key, const torch::Tensor& tensor);
  void put(const std::string& key, int64_t integer) { values_[key] = integer; }
  void put(const std::string& key, double number) { values_[key] = number; }
  void put(const std::string& key, std::string text) { values_[key] = std::move(text); }
  /// All of `other`, whose tensors are shared.
  void put_all(const StateDict& other) { values_.insert(other.values_.begin(), other.values_.end()); }

  bool has(const std::string& key) const { return values_.contains(key); }
  /// Errors: kBadFormat when the key is missing or holds something else.
  Expected<torch::Tensor> tensor(const std::string& key) const;
  Expected<int64_t> integer(const std::string& key) const;
  Expected<double> number(const std::string& key) const;
  Expected<std::string> text(const std::string& key) const;
  /// Copies the tensor at `key` into `target`, which keeps its device. Errors: kBadFormat (missing, other
  /// shape or dtype), naming both shapes.
  Status copy_tensor(const std::string& key, torch::Tensor target) const;

  const std::map<std::string, Value>& values() const { return values_; }

 private:
  std::map<std::string, Value> values_;
};

/// Writes `state` to `path` by way of a temporary file in the same folder, with fsync of file and folder.
/// Errors: kNoSpace (disk full), kSystem; what lay at `path` before is untouched then.
Status write_checkpoint(const std::string& path, const StateDict& state);

/// Reads a file that write_checkpoint made.
/// Errors: kNotFound; kBadFormat for a truncated or foreign file; kUnsupported for a newer version.
Expected<StateDict> read_checkpoint(const std::string& path);

/// Writes the checkpoint at `from` to `to` as an archive packs it small, to be played: with an optimizer that has made no step, and
/// weights of 7 significant bits (a bfloat16 has 8), statistics of pixels of 12, and with `settings`, TOML, for the run's. Errors: as read_checkpoint and write_checkpoint.
Status write_to_be_played(const std::string& from, const std::string& to, const std::string& settings);

/// One periodic checkpoint on disk.
struct CheckpointFile {
  std::string path;
  uint64_t version = 0;
  uint64_t env_frames = 0;
};

/// "<name>_<version>_<env_frames>.pt".
std::string checkpoint_file_name(const std::string& name, uint64_t version, uint64_t env_frames);

/// The checkpoints of one run: <run_dir>/checkpoint/checkpoint_<version>_<env_frames>.pt and best_<J>.pt.
class CheckpointStore {
 public:
  /// `keep` newest periodic checkpoints survive a save(); at least 1. The folder is made on the first save;
  /// temporary files that a crash left there are removed then.
  CheckpointStore(std::string folder, int64_t keep);

  /// Returns the path. Errors: as write_checkpoint.
  Expected<std::string> save(const StateDict& state, uint64_t version, uint64_t env_frames);
  /// Writes a checkpoint of that file name, which no later save() deletes. Returns the path. Errors: as write_checkpoint.
  Expected<std::string> save_beside(const StateDict& state, const std::string& file);
  /// Replaces the best checkpoint. Returns the path. Errors: as write_checkpoint.
  Expected<std::string> save_best(const StateDict& state, double score);

  /// Periodic checkpoints, newest first.
  std::vector<CheckpointFile> list() const;
  /// Path of the best checkpoint, highest score first when several lie there; empty if none.
  std::string best() const;

  /// Moves an unreadable checkpoint out of the way (adds ".broken"), so that it is not tried or
  /// counted again.
  void set_aside(const std::string& path) const;
  /// How many checkpoints lie there that were set aside.
  std::size_t set_aside_count() const;

 private:
  Status prepare_folder();
  std::string folder_;
  int64_t keep_;
  bool is_prepared_ = false;
};

}  // namespace comrad::learn
