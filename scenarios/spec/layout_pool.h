// Pools of layouts: directories of WADs with a registry, for training and for evaluation. The two never share
// a map: its content (layout_content.h) decides which of them it belongs to, whatever seed and parameters drew it.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/core/layout_list.h"
#include "scenarios/spec/layout_content.h"
#include "scenarios/spec/registry.h"

namespace comrad::scenarios {

/// kCurriculum: the stages that a recipe names, in their order; they are for training.
/// kGrid: a user's product of options, which belongs to neither.
enum class PoolKind { kTrain, kEval, kCurriculum, kGrid };

struct PoolRequest {
  PoolKind kind = PoolKind::kTrain;
  int count = 10;
  /// Every layout draws an option of each axis of its recipe, from its seed, and has the recipe's
  /// `pool_values`; what `layout` sets stays as it is.
  bool vary = true;
  /// What all layouts have in common; `seed` is not read.
  LayoutRequest layout = {};
};

/// One layout of a pool.
struct PoolEntry {
  std::string id;             ///< `<scenario>_<seed>`, the file's stem
  std::string filename;       ///< below the pool's folder
  uint64_t content_hash = 0;  ///< of the file
  uint64_t map_hash = 0;      ///< layout_content() of it; 0 where the registry does not report it
  LayoutInfo info;
  std::vector<std::pair<std::string, std::string>> axis_choices;  ///< axis, option as "name=value name=value"
  int retries = 0;
  std::string split = {};     ///< "train" or "eval"; empty where it is unknown
  std::string stage = {};     ///< of a curriculum
  double metric_scale = 0.0;  ///< what scores are divided by to be compared between layouts; 0: nothing
};

/// Names of the list in a pool's folder and of the interestingness graph that may lie beside it: a JSON
/// object, layout -> (other layout -> is it still interesting once the first is mastered?).
constexpr const char* kPoolRegistryName = "batch_registry.json";
constexpr const char* kInterestingnessName = "interestingness.json";

/// What make_pool() drew to find a pool's maps.
struct PoolTally {
  int draws = 0;
  int other_pool = 0;  ///< belong to the other pool by their content
  int repeated = 0;    ///< were in the pool already
};

/// Draws a pool into `folder` (made if need be) and writes the registry last, so that a pool with a registry
/// is whole. `progress` hears of every layout. Seeds go upwards from 0 (evaluation: held-out ones first;
/// training: without those); a seed whose map belongs to the other pool or is in this one already, or whose options
/// give the team too little to solve the map (check_resources()), is left out.
/// Errors: as generate_layout(); kBadInput for a count outside 1..100000, and where the recipe runs out of
/// maps, with how many there are and what gives more (nothing is left in the folder then); kSystem.
Expected<std::vector<PoolEntry>> make_pool(const std::string& scenario, const PoolRequest& request,
                                           const std::string& folder,
                                           const std::function<void(const PoolEntry&)>& progress = nullptr,
                                           PoolTally* tally = nullptr);

/// Draws `draws` maps as make_pool() does, for neither pool, and judges how many there are. Writes nothing.
/// Errors: as generate_layout(); kBadInput for fewer than 2 draws or more than 100000.
Expected<DistinctMaps> count_distinct_maps(const std::string& scenario, const PoolRequest& request,
                                           int draws);

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
  bool for_training = false;    ///< leave out maps that belong to evaluation
  LayoutRequest layout = {};    ///< what they have in common
  /// Hears of places that are left out because their parameters give the team too little (check_resources()).
  std::function<void(int64_t place, const Error& why)> left_out = nullptr;
};

/// Draws a product into `folder` as `<scenario>_<place>.wad`, places counted from 0 with four digits. Its
/// registry belongs to no split: check_pool() refuses maps in it that belong to evaluation where training is
/// meant, and one map may be in it twice. Errors: kBadInput where two axes set one parameter, or nothing is
/// left to draw; as make_pool().
Expected<std::vector<PoolEntry>> make_grid_pool(const std::string& scenario, const GridRequest& request,
                                                const std::string& folder);

/// What a pool is wanted for.
struct PoolUse {
  std::string scenario = {};  ///< name or folder; empty: any
  int num_agents = 0;         ///< every layout must have so many starts; 0: not asked
  bool for_training = false;  ///< layouts for evaluation are refused then
};

/// Reads a pool and every file of it: that they are there, have the registry's hashes, hold a map of the
/// scenario with enough starts and resources, are no evaluation layouts where training is meant (by what the
/// registry lists and by their content), and are all different where the pool is one for training or evaluation.
/// Gives what a run reads. Errors: those of read_pool(); kNotFound, kBadFormat and kBadInput naming layout and file.
Expected<LayoutList> check_pool(const std::string& folder, const PoolUse& use);

/// The registry's text: a list of objects with id, filename, scenario, scenario_version, seed, attempt, content_hash,
/// map_hash, config, axis_choices, split (none of a grid), ceiling (team size -> the best score); of a curriculum
/// also curriculum_stage and curriculum_metric_scale.
std::string pool_registry_text(PoolKind kind, const std::vector<PoolEntry>& entries);

/// Reads a pool's registry; without one, all .wad files of the folder in the order of their names. File names
/// come out as paths. Errors: kNotFound for an empty pool, kBadFormat naming the entry.
Expected<std::vector<PoolEntry>> read_pool(const std::string& folder);

}  // namespace comrad::scenarios
