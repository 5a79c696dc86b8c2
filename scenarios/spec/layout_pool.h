// Pools of layouts: directories of WADs with a registry, for training and for evaluation. The two never share
// a layout: a seed belongs to one of them by its hash, whatever the parameters are.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "scenarios/spec/registry.h"

namespace comrad::scenarios {

enum class PoolKind { kTrain, kEval };

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
};

/// Name of the list in a pool's folder.
constexpr const char* kPoolRegistryName = "batch_registry.json";

/// Draws a pool into `folder` (made if need be) and writes the registry last, so that a pool with a registry
/// is whole. `progress` hears of every layout. Two seeds that end in the same map (a retry that meets another
/// seed) are told apart: the later one is left out and replaced by the next seed.
/// Errors: as generate_layout(), kBadInput for a count outside 1..100000, kSystem.
Expected<std::vector<PoolEntry>> make_pool(const std::string& scenario, const PoolRequest& request,
                                           const std::string& folder,
                                           const std::function<void(const PoolEntry&)>& progress = nullptr);

/// The registry's text: a list of objects with id, filename, scenario, seed, attempt, content_hash, config,
/// axis_choices, split.
std::string pool_registry_text(PoolKind kind, const std::vector<PoolEntry>& entries);

/// Reads a pool's registry; without one, all .wad files of the folder in the order of their names. File names
/// come out as paths. Errors: kNotFound for an empty pool, kBadFormat naming the entry.
Expected<std::vector<PoolEntry>> read_pool(const std::string& folder);

}  // namespace comrad::scenarios
