// Pools of layouts: directories of WADs with a registry, for training and for evaluation. The two never share
// a layout: a seed belongs to one of them by its hash, whatever the parameters are.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/core/layout_list.h"
#include "scenarios/spec/registry.h"

namespace comrad::scenarios {

/// kCurriculum: the stages that a recipe names, in their order; they are for training.
/// kGrid: somebody's product of options, which belongs to neither.
enum class PoolKind { kTrain, kEval, kCurriculum, kGrid };

/// Seeds that published results hold out; in every evaluation pool, never in a training pool.
constexpr uint64_t kHeldOutSeeds[] = {1009, 2027, 3037, 4051, 5099};

/// Which pool a seed belongs to: held-out seeds and one in ten others (FNV-1a 64 of "<scenario>_<seed>"
/// modulo 10 is 0) are for evaluation. Retries of a seed (seed + 1000 * attempt) count as that seed.
PoolKind pool_of_seed(const std::string& scenario, uint64_t seed);

/// The first `count` seeds of a pool: held-out ones first (evaluation), then upwards from 0.
std::vector<uint64_t> pool_seeds(const std::string& scenario, PoolKind kind, int count);

struct PoolRequest {
  PoolKind kind = PoolKind::kTrain;
  int count = 10;
  bool vary = true;  ///< every layout draws an option of each axis of its recipe, from its seed
  /// What all layouts have in common; `seed` is not read.
  LayoutRequest layout = {};
};

/// One layout of a pool.
struct PoolEntry {
  std::string id;        ///< `<scenario>_<seed>`, the file's stem
  std::string filename;  ///< below the pool's folder
  uint64_t content_hash = 0;
  LayoutInfo info;
  std::vector<std::pair<std::string, std::string>> axis_choices;  ///< axis, option as "name=value name=value"
  int retries = 0;
  std::string split = {};     ///< "train" or "eval"; empty where nothing says so
  std::string stage = {};     ///< of a curriculum
  double metric_scale = 0.0;  ///< what scores are divided by to be compared between layouts; 0: nothing
};

/// Names of the list in a pool's folder and of the interestingness graph that may lie beside it: a JSON
/// object, layout -> (other layout -> is it still interesting once the first is mastered?).
constexpr const char* kPoolRegistryName = "batch_registry.json";
constexpr const char* kInterestingnessName = "interestingness.json";

/// Draws a pool into `folder` (made if need be) and writes the registry last, so that a pool with a registry
/// is whole. A seed whose options give the team too little to solve the map (check_resources()) is left out. `progress` hears of every layout. Two seeds that end in the same map (a retry that meets another
/// seed) are told apart: the later one is left out and replaced by the next seed.
/// Errors: as generate_layout(), kBadInput for a count outside 1..100000, kSystem.
Expected<std::vector<PoolEntry>> make_pool(const std::string& scenario, const PoolRequest& request,
                                           const std::string& folder,
                                           const std::function<void(const PoolEntry&)>& progress = nullptr);

/// Draws the stages of a recipe's curriculum into `folder`: registry with stage names and metric scales, and
/// the graph by which mastering a stage makes it and all before it uninteresting. `request.seed` and its
/// parameters are not read. Errors: kBadInput where the recipe names no stages; as make_pool().
Expected<std::vector<PoolEntry>> make_curriculum_pool(const std::string& scenario,
                                                      const LayoutRequest& request,
                                                      const std::string& folder);

/// A full product of options, the last axis fastest.
struct GridRequest {
  struct Axis {
    std::string name;
    /// Each option sets one or more parameters; `seed` is the layout's seed.
    std::vector<std::vector<std::pair<std::string, int64_t>>> options = {};
  };
  std::vector<Axis> axes = {};  ///< empty: the recipe's own
  int64_t start = 0;            ///< first place of the product that is drawn
  int64_t limit = 100'000;      ///< layouts drawn at most
  LayoutRequest layout = {};    ///< what they have in common
  /// Hears of places that are left out because their parameters give the team too little (check_resources()).
  std::function<void(int64_t place, const Error& why)> left_out = nullptr;
};

/// Draws a product into `folder` as `<scenario>_<place>.wad`, places counted from 0 with four digits. Its
/// registry belongs to no split: the seeds are whoever asks for them's, and are not those of another pool by
/// construction. Errors: kBadInput where two axes set one parameter, or nothing is left to draw; as
/// make_pool().
Expected<std::vector<PoolEntry>> make_grid_pool(const std::string& scenario, const GridRequest& request,
                                                const std::string& folder);

/// What a pool is wanted for.
struct PoolUse {
  std::string scenario = {};  ///< name or folder; empty: any
  int num_agents = 0;         ///< every layout must have so many starts; 0: not asked
  bool for_training = false;  ///< layouts for evaluation are refused then
};

/// Reads a pool and every file of it: that they are there, have the registry's hashes, hold a map of the
/// scenario with enough starts and resources, and are nobody's evaluation layouts where training is meant. Gives what a run
/// reads. Errors: those of read_pool(); kNotFound, kBadFormat and kBadInput naming layout and file.
Expected<LayoutList> check_pool(const std::string& folder, const PoolUse& use);

/// The registry's text: a list of objects with id, filename, scenario, seed, attempt, content_hash, config,
/// axis_choices, split (none of a grid), ceiling (team size -> the best score); of a curriculum also curriculum_stage and curriculum_metric_scale.
std::string pool_registry_text(PoolKind kind, const std::vector<PoolEntry>& entries);

/// Reads a pool's registry; without one, all .wad files of the folder in the order of their names. File names
/// come out as paths. Errors: kNotFound for an empty pool, kBadFormat naming the entry.
Expected<std::vector<PoolEntry>> read_pool(const std::string& folder);

}  // namespace comrad::scenarios
