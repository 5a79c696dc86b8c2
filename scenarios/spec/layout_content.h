// What distinguishes layouts in play: a hash of its geometry, its things and the numbers its script gets,
// which ignores the seed and everything that is written down beside the map. Pools are parted by it, so that
// no map is ever in a pool for training and in one for evaluation, whatever parameters drew them.
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "doomgen/wad/wad_reader.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::scenarios {

/// The content of a WAD's first map: lines with their sides, sectors and things, the same in the UDMF and in
/// the Hexen format, with and without nodes; and its script's numbers. Of a map that was drawn by a recipe
/// these are the numbers in front of script.acs that the script names, LAYOUT_SEED left out: a script may use
/// the seed to vary its episodes, but that makes no other map of it. Of any other map it is BEHAVIOR.
/// Fields that the Hexen format has no place for (light colours, line ids) do not count: maps that differ in
/// nothing else are one map. Errors: kNotFound without a map, kBadFormat.
Expected<uint64_t> layout_content(const wad::WadFile& wad);

/// Which contents of one scenario are for evaluation.
class ContentSplit {
 public:
  /// Draws the recipe's published maps to know their contents. Of a scenario without a recipe nothing is for
  /// evaluation. Errors: as generate_layout().
  static Expected<ContentSplit> of(const std::string& scenario);

  /// False for the stages of a curriculum; true for the maps of the held-out seeds with default
  /// parameters; of all others one in ten by their hash.
  bool is_for_evaluation(uint64_t content) const;

 private:
  bool has_recipe_ = false;
  std::set<uint64_t> stages_, held_out_;
};

/// Seeds that published results hold out: their maps with default parameters are for evaluation.
constexpr uint64_t kHeldOutSeeds[] = {1009, 2027, 3037, 4051, 5099};
bool is_held_out_seed(uint64_t seed);

/// How many maps a recipe can make, judged by what a sample of them shows.
struct DistinctMaps {
  enum class Kind {
    kAll,       ///< every map of the sample was drawn many times: there are no others
    kEstimate,  ///< some came twice: Chao's estimate from those that came once and twice
    kAtLeast,   ///< no map came twice: so many there are with 95 % confidence, by the birthday argument
  };
  Kind kind = Kind::kAll;
  int draws = 0, distinct = 0;
  int64_t count = 0;  ///< all, about, or at least
};

/// Judges contents as they were drawn. The birthday bound holds whatever the chances of the maps are: n draws
/// from D maps are all different with a probability of at most exp(-n (n - 1) / 2D), which is below 5 %
/// where D < n (n - 1) / 2 ln 20. Source of the estimate: Chao 1984, Scand. J. Statist. 11, 265 (with the
/// correction for samples in which no map came twice).
DistinctMaps distinct_maps(const std::vector<uint64_t>& contents);

/// "at least 14970 distinct maps (95 % confidence: 300 draws, all different)".
std::string distinct_maps_text(const DistinctMaps& maps);

}  // namespace comrad::scenarios
