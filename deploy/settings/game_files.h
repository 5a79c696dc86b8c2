// The files a run plays: the IWAD with textures and sprites, and the scenario's map. Checked before any
// process starts, so that a missing or cut-off file is one message and not a worker that keeps dying.
#pragma once

#include <string>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/core/layout_list.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::deploy {

/// The IWAD that simulators will open: $COMRAD_IWAD, else Debian's Freedoom 2.
/// Errors: kNotFound saying how to get it.
Expected<std::string> find_iwad();

/// Checks header and directory of a WAD against the size of the file. Errors: kNotFound, kBadFormat naming
/// the offset.
Status check_wad(const std::string& path);

/// The map that `config` plays: its own `wad` if set (and checked), else
/// `<folder>/<scenario>_<layout_seed>.wad`, made by comrad-doomgen if it is not there yet. The path is
/// absolute. Errors: those of check_wad; kBadInput with the generator's words.
Expected<std::string> ensure_layout(const RunConfig& config, const std::string& folder);

/// Whether the map, or the first of a pool, can be drawn; it is removed again. For use before a run's folder is touched.
/// Errors: those of ensure_layout() and ensure_layout_pool().
Status check_layout(const RunConfig& config);

/// The pool that `config.environment.layout_pool` names, checked by comrad-doomgen, as the text of a run's
/// layouts/pool.toml. A folder is taken as it is; the maps of a WAD become a
/// file each in `<made_in>/<stem>_maps`; `train:<count>`, `eval:<count>` and the stages of the
/// scenario's `curriculum` are drawn into `<made_in>/<scenario>_<word>[_<count>]` unless such a pool is there
/// already. Training refuses layouts for evaluation. Errors: kBadInput with the generator's words.
Expected<std::string> ensure_layout_pool(const RunConfig& config, const std::string& made_in,
                                         bool for_training);

/// Layouts that a run is evaluated on unless its own are requested: fresh ones, which no training pool shares.
constexpr const char* kHeldOutPool = "eval:20";
/// Where a run that evaluates as it trains keeps their list.
constexpr const char* kHeldOutListFile = "layouts/held_out.toml";

/// The word for the stages that lead to the scenario's own map, which such runs are evaluated on.
constexpr const char* kCurriculumPool = "curriculum";

/// Whether a run is evaluated on one map by default: its own, or the one that its curriculum leads to.
bool is_evaluated_on_one_map(const RunConfig& config);

/// Whether `layout_pool` requests a pool to be drawn (`train:<count>`, `eval:<count>`, `curriculum`) rather than
/// naming a folder.
bool is_pool_to_draw(const std::string& layout_pool);
/// The same, or to be made of the maps of a WAD: it comes to lie in the run's folder.
bool is_pool_to_make(const std::string& layout_pool);

/// Errors: kBadInput for a pool to be drawn of no or too many layouts, or of those for evaluation where training is
/// meant; nothing is drawn yet.
Status check_pool_to_draw(const std::string& layout_pool, bool for_training);

/// Puts the list where a run's workers read it. Errors: kNoSpace, kSystem.
Status write_layout_list(const std::string& run_dir, const std::string& text,
                         const std::string& file = kLayoutListFile);

/// The scenario's name for files: the folder's or the .cfg's where the scenario is named by a path.
std::string scenario_file_name(const RunConfig& config);

/// Whether `wad` is a map that ensure_layout() made for `config` (rather than one that the user gave).
bool is_generated_layout(const RunConfig& config);

/// Clears `config.environment.wad` where it still names the map that was generated for `run` and another one is wanted
/// now (a new layout seed) or that map is gone (a run folder that moved), so that ensure_layout() makes it.
void forget_stale_layout(const RunConfig& run, RunConfig& config);

/// The map in words, for results: "seed 42", the path of the user's WAD, or "pool " and what
/// layout_pool states.
std::string layout_text(const RunConfig& config);

}  // namespace comrad::deploy
